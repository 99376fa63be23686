"""Sessions as FHIR, read back by fhir.resources: another program's idea of what is valid."""

from __future__ import annotations

from fhir.resources.R4B.bundle import Bundle


def parts(clinic, session):
    answer = clinic.client("clinician").get(f"/v1/sessions/{session['id']}/fhir")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/fhir+json"
    found: dict[str, list] = {}
    for entry in Bundle.model_validate_json(answer.content).entry:
        found.setdefault(entry.resource.get_resource_type(), []).append(entry.resource)
    return found


def test_the_bundle_says_of_every_rule_a_verdict_or_why_there_is_none(clinic, upload):
    session = upload(clinic, seed=110, patient_ref="P-12", recorded_at="2025-11-20T08:30:00+09:00")
    found = parts(clinic, session)
    assert {name: len(each) for name, each in found.items()} == {
        "Device": 2,
        "Observation": 1,
        "DiagnosticReport": 1,
        "Provenance": 1,
    }
    (observation,) = found["Observation"]
    said = {}
    for component in observation.component:
        (coding,) = component.code.coding
        assert (component.dataAbsentReason is None) == (
            component.valueQuantity is not None or component.valueCodeableConcept is not None
        )
        if coding.system == "urn:inhalemon:rules":
            said[coding.code] = component
    for finding in session["report"]["findings"]:
        component = said[finding["rule"]]
        if finding["verdict"] == "not_assessable":
            assert component.dataAbsentReason is not None
        else:
            assert component.valueCodeableConcept.coding[0].code == finding["verdict"]
    assert observation.subject.identifier.value == "P-12"
    assert observation.effectiveDateTime.isoformat().startswith("2025-11-19T23:30:00")


def test_every_reference_within_the_bundle_leads_somewhere(clinic, upload):
    session = upload(clinic, seed=111)
    content = clinic.client("clinician").get(f"/v1/sessions/{session['id']}/fhir").json()
    urls = {entry["fullUrl"] for entry in content["entry"]}

    def references(part):
        if isinstance(part, dict):
            if isinstance(part.get("reference"), str):
                yield part["reference"]
            for each in part.values():
                yield from references(each)
        elif isinstance(part, list):
            for each in part:
                yield from references(each)

    assert set(references(content)) <= urls
    assert len(list(references(content))) >= 4


def test_a_sign_off_makes_the_report_final_and_an_override_changes_the_verdict(clinic, upload):
    session = upload(clinic, seed=112)
    assert parts(clinic, session)["DiagnosticReport"][0].status == "preliminary"
    finding = session["report"]["findings"][0]
    verdict = "pass" if finding["verdict"] == "fail" else "fail"
    for entry in (
        {"kind": "override", "rule": finding["rule"], "verdict": verdict, "reason": "seen"},
        {"kind": "sign_off"},
    ):
        assert clinic.client("clinician").post(f"/v1/sessions/{session['id']}/reviews", json=entry).status_code == 201
    found = parts(clinic, session)
    assert found["DiagnosticReport"][0].status == found["Observation"][0].status == "final"
    component = next(each for each in found["Observation"][0].component if each.code.coding[0].code == finding["rule"])
    assert component.valueCodeableConcept.coding[0].code == verdict
    agents = [each.type.coding[0].code for each in found["Provenance"][0].agent]
    assert agents == ["assembler", "verifier"]
    versions = {each.type.text: each.value for each in found["Device"][1].version}
    assert versions["pipeline"] == session["report"]["pipeline_version"]
    assert versions["rules"] == session["report"]["rules_digest"]


def test_every_code_of_ours_is_published(clinic, upload):
    session = upload(clinic, seed=113)
    content = clinic.client("clinician").get("/v1/fhir/code-systems").json()
    systems = [entry["resource"] for entry in content["entry"]]
    published = {(system["url"], concept["code"]) for system in systems for concept in system["concept"]}
    (observation,) = parts(clinic, session)["Observation"]
    used = {(coding.system, coding.code) for each in observation.component for coding in each.code.coding}
    assert used <= published
