"""What the documents say about the service is tried, and their lists are those of the program."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from api import settings

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLES = README.partition("<!-- service:begin -->")[2].partition("<!-- service:end -->")[0]


def _blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", EXAMPLES, re.DOTALL)


@pytest.fixture
def environment(clinic):
    return os.environ | {"KEY": clinic.key("clinician"), "NO_PROXY": "127.0.0.1"}


def test_the_curl_lines_of_the_readme_work(server, environment):
    if shutil.which("curl") is None:
        pytest.skip("curl is not installed: apt-get install curl")
    (block,) = _blocks("sh")
    lines = block.strip().splitlines()
    assert len(lines) == 3
    answers = []
    for line in lines:
        command = line.replace("http://127.0.0.1:8000", server.url).replace("curl ", "curl -sS --fail-with-body ", 1)
        done = subprocess.run(
            command, shell=True, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        answers.append(done.stdout)
    assert '"state":"scored"' in answers[0]
    assert '"press_late"' in answers[1], "the session of the first line is found by the second"
    assert "machine_and_reviewers" in answers[2]


def test_the_python_client_of_the_readme_works(server, environment):
    (program,) = _blocks("python")
    program = program.replace("http://127.0.0.1:8000", server.url)
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "direction" in done.stdout.splitlines()[-1]


def test_the_list_of_settings_is_that_of_the_program():
    """docs/deploy.md holds what `settings.as_table()` gives, word for word."""
    text = (ROOT / "docs" / "deploy.md").read_text(encoding="utf-8")
    shown = text.partition("<!-- settings:begin -->")[2].partition("<!-- settings:end -->")[0]
    assert shown.strip() == settings.as_table(), "copy it anew from api.settings.as_table()"


def test_every_route_is_in_the_document(server):
    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    with server.client() as client:
        paths = client.get("/openapi.json").json()["paths"]
    for path in paths:
        fixed = [part for part in path.split("/") if part and not part.startswith("{")]
        assert fixed[-1] in text, path
