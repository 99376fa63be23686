"""Every route against its own description: requests made up from the OpenAPI document, right ones and wrong ones."""

from __future__ import annotations

import subprocess
import sys

import pytest
from running import Clinic, serving, settings_for

CHECKS = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_headers_conformance",
    "response_schema_conformance",
    "negative_data_rejection",
    "missing_required_header",
    "unsupported_method",
    "allow_header_conformance",
    "ignored_auth",
)


@pytest.mark.slow
def test_every_answer_is_one_that_the_openapi_document_promises(database, tmp_path, recording):
    """Some 1,300 requests by an administrator; revoking keys is left out, for it would revoke the one in use."""
    settings = settings_for(tmp_path / "data", database(), workers=1, key_requests_per_minute=1_000_000)
    with serving(settings) as server:
        clinic = Clinic(server, "walked")
        key = clinic.key("administrator")
        with server.client(key) as client:
            sent = client.post(
                "/v1/sessions?device=pmdi", content=recording(seed=1), headers={"content-type": "text/csv"}
            )
            assert sent.status_code == 201
        command = [sys.executable, "-m", "schemathesis.cli", "run", f"{server.url}/openapi.json"]
        options = {
            "--header": f"Authorization: Bearer {key}",
            "--checks": ",".join(CHECKS),
            "--phases": "examples,coverage,fuzzing",
            "--exclude-path": "/v1/keys/{key_id}",
            "--max-examples": "5",
            "--seed": "1",
            "--warnings": "off",
        }
        arguments = [each for option in options.items() for each in option]
        told = subprocess.run(
            [*command, *arguments, "--continue-on-failure", "--no-shrink"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
            timeout=240,
        )
        assert told.returncode == 0, told.stdout[-6000:]
        assert "No issues found" in told.stdout
