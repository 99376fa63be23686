"""README shows what really comes out."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def fill():
    spec = importlib.util.spec_from_file_location("fill_readme", ROOT / "docs" / "fill_readme.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow  # it runs the whole program, and scores move while the stages are worked on
@pytest.mark.parametrize("part", ["demo", "example", "results"])
def test_marked_parts_are_the_real_ones(fill, part):
    """After a change that moves them: `make docs`, and read what it wrote."""
    assert shown(TEXT, part) == getattr(fill, part)()


@pytest.mark.slow  # only a full validation writes it
def test_the_profile_is_that_of_the_last_validation(fill):
    assert shown((ROOT / "docs" / "speed.md").read_text(encoding="utf-8"), "profile") == fill.profile()


def shown(text, part):
    return re.search(rf"<!-- {part}:begin -->\n(.*?)<!-- {part}:end -->", text, re.DOTALL)[1]


@pytest.mark.parametrize("document", sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("docs/*.md")))
def test_links_of_the_documents_lead_somewhere(document):
    assert broken_links(ROOT / document) == []


@pytest.mark.parametrize("document", ["README.md", "CONTRIBUTING.md"])
def test_links_of_the_front_pages_lead_somewhere(document):
    assert broken_links(ROOT / document) == []


def broken_links(path):
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    targets = [target.partition("#")[0] for target in re.findall(r"\]\(([^)\s]+)\)", text)]
    return [target for target in targets if target and "://" not in target and not (path.parent / target).exists()]
