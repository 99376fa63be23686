"""What the service says of itself: OpenAPI, its page, rules and devices."""

from __future__ import annotations

import json
import re
from urllib.parse import quote

import jsonschema
import pytest

from inhalemon.rules import load_rules


@pytest.fixture(scope="module")
def document(server):
    with server.client() as client:
        return client.get("/openapi.json").json()


def test_every_operation_has_a_summary_a_typed_answer_and_its_problems(document):
    for path, methods in document["paths"].items():
        for method, told in methods.items():
            where = f"{method} {path}"
            assert told["summary"], where
            assert any(status.startswith("2") for status in told["responses"]), where
            if path.startswith("/v1"):
                assert "401" in told["responses"], where
                assert told["responses"]["401"]["content"]["application/problem+json"]["schema"]["$ref"], where


def test_a_real_session_is_as_the_document_says(document, clinic, upload):
    session = upload(clinic, seed=130, patient_ref="P-1")
    schema = {"$ref": "#/components/schemas/SessionDetail", "components": document["components"]}
    jsonschema.validate(session, schema)
    page = clinic.client("clinician").get("/v1/sessions").json()
    jsonschema.validate(page, {"$ref": "#/components/schemas/SessionPage", "components": document["components"]})


def test_the_reference_page_shows_every_route_and_loads_nothing_from_elsewhere(server, document):
    with server.client() as client:
        page = client.get("/docs")
    assert page.status_code == 200
    for path in document["paths"]:
        assert path in page.text
    assert re.findall(r'(?:src|href)="(?:https?:)?//', page.text) == []
    assert re.findall(r"<script(?![^>]* src=)", page.text) == []
    assert "style=" not in page.text


def test_every_rule_is_told_with_its_source(clinic):
    told = clinic.client("uploader").get("/v1/rules").json()
    rules = load_rules()
    assert told["digest"] == rules.digest
    assert [each["rule"] for each in told["items"]] == [rule.id for rule in rules.rules]
    assert all(each["source"] or each["never_decided"] for each in told["items"])


def test_every_device_is_told(clinic):
    told = clinic.client("uploader").get("/v1/devices").json()
    assert {each["device"] for each in told["items"]} >= {"pmdi", "ellipta", "hinge"}


def test_numbers_for_prometheus_hold_nothing_of_patients_or_clinics(server, clinic, upload):
    upload(clinic, seed=131, patient_ref="P-777")
    with server.client() as client:
        text = client.get("/metrics").text
    assert "inhalemon_request_seconds_count" in text
    assert 'route="/v1/sessions"' in text
    assert "P-777" not in text
    assert clinic.slug not in text


@pytest.mark.parametrize("path", ["/nothing", "/v1/nothing", "/v1/sessions/nothing"])
def test_every_error_is_a_problem_document(clinic, path):
    answer = clinic.client("clinician").get(path)
    assert answer.status_code in {404, 422}
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json()["status"] == answer.status_code


def test_a_wrong_method_is_a_problem_document_too(clinic):
    answer = clinic.client("clinician").put("/v1/sessions")
    assert answer.status_code == 405
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["allow"]


def test_every_answer_carries_the_security_headers(server):
    with server.client() as client:
        for path in ("/livez", "/login", "/docs", "/nothing", "/static/pages.css"):
            headers = client.get(path).headers
            assert "default-src 'none'" in headers["content-security-policy"], path
            assert "unsafe" not in headers["content-security-policy"], path
            assert headers["x-content-type-options"] == "nosniff"
            assert headers["referrer-policy"] == "no-referrer"


@pytest.mark.parametrize(
    "odd", ["\x00", "\ud800", "\u202e", "'; DROP TABLE sessions; --", "%", "\U0001f4a8", "A" * 5000, "../../x"]
)
def test_odd_text_is_stored_or_refused_and_never_a_fault_of_ours(clinic, upload, odd):
    client = clinic.client("administrator")
    session = upload(clinic, seed=132)["id"]
    headers = {"content-type": "application/json"}
    body = json.dumps({"kind": "comment", "reason": f"a{odd}b"}).encode()
    quoted = quote(odd.encode("utf-8", "surrogatepass"), safe="")
    answers = [
        client.post(f"/v1/sessions/{session}/reviews", content=body, headers=headers),
        client.patch(
            f"/v1/sessions/{session}", content=json.dumps({"patient_ref": f"P{odd}1"}).encode(), headers=headers
        ),
        client.post("/v1/keys", content=json.dumps({"role": "uploader", "label": odd}).encode(), headers=headers),
        client.get(f"/v1/sessions?patient={quoted}"),
        client.get(f"/v1/sessions?rule={quoted}&verdict=fail"),
        client.get(f"/v1/sessions?clinic={quoted}"),
        client.get(f"/v1/sessions?cursor={quoted}"),
        client.get(f"/v1/patients/{quoted}/progress"),
        client.get(f"/v1/sessions/{quoted}"),
        client.patch(f"/v1/users/{quoted}", content=b"{}", headers=headers),
        client.post(
            f"/v1/sessions?device=pmdi&patient_ref=P1{quoted}", content=b"x", headers={"content-type": "text/csv"}
        ),
        client.post("/v1/sessions?device=pmdi", content=b"x", headers={"idempotency-key": "k", "content-type": quoted}),
        client.get("/v1/me", headers={"authorization": f"Bearer inh_{quoted}_x"}),
    ]
    for answer in answers:
        assert answer.status_code < 500, f"{answer.request.method} {answer.request.url}: {answer.text}"
    for answer in answers:
        if answer.status_code >= 400:
            assert answer.headers["content-type"] == "application/problem+json"
    with clinic.server.client() as visitor:
        page = visitor.get("/login")
        token = re.search(r'name="csrf_token" value="([0-9a-f]+)"', page.text)[1]
        form = f"name={quoted}&password={quoted}&csrf_token={token}".encode()
        kind = {"content-type": "application/x-www-form-urlencoded"}
        assert visitor.post("/login", content=form, headers=kind).status_code < 500
        assert visitor.post("/login", content=f"name=a&password=b&csrf_token={quoted}", headers=kind).status_code < 500
