"""A session as HL7 FHIR R4B: what the machine found, what people made of it, and where both came from.

Rules, measures and verdicts have codes of this project's own, published as CodeSystems. Of SNOMED CT and HL7's own
vocabularies only codes that were looked up are used: 170614009 (inhaler technique observed; browser of tx-dev.fhir.org)
and INH (inhaler; HL7 v3 EntityCode). No LOINC code for an inhaler's technique was found; none is used.
"""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from typing import Any

import orjson
from fhir.resources.R4B.bundle import Bundle
from fhir.resources.R4B.codesystem import CodeSystem

import inhalemon
from api.moments import now_us, to_iso
from api.store.reviews import Review, ReviewKind
from api.store.sessions import Outcome, Session, StoredReport
from api.verdicts import is_amended, outcome, report_of, sign_offs, standing
from inhalemon.measures import MEASURES
from inhalemon.rules import RuleSet
from inhalemon.values import Finding, Score, Verdict

RULES = "urn:inhalemon:rules"
MEASURE_CODES = "urn:inhalemon:measures"
VERDICTS = "urn:inhalemon:verdicts"
GRADES = "urn:inhalemon:grades"
DEVICES = "urn:inhalemon:devices"
MEDIA_TYPE = "application/fhir+json"
_SNOMED = "http://snomed.info/sct"
_ENTITY = "http://terminology.hl7.org/CodeSystem/v3-EntityCode"
_ABSENT = "http://terminology.hl7.org/CodeSystem/data-absent-reason"
_PARTICIPANT = "http://terminology.hl7.org/CodeSystem/provenance-participant-type"
_CATEGORY = "http://terminology.hl7.org/CodeSystem/observation-category"
_UCUM = "http://unitsofmeasure.org"
_NAMESPACE = uuid.UUID("6f1f2f0e-6f0c-4e3c-9a53-6e2b1c1f5c57")  # names within it are this service's identifiers
_UNITS = (("_s", "s", "s"), ("_deg", "deg", "degree"))  # a measure's name ends in its unit; other measures are counts
_REVIEWED = "as a reviewer says"

Json = dict[str, Any]  # FHIR's JSON; the models check its shape


def bundle(session: Session, report: StoredReport, entries: Sequence[Review], rules: RuleSet) -> bytes:
    """The session's Bundle as JSON, checked by fhir.resources.

    Devices: the inhaler with its two sensors, and the program. Observation: one component for each measure and rule,
    with the reason where there is no value. DiagnosticReport: preliminary while nobody has signed this report and this
    review off, then final, or amended when something else was signed off before. Provenance: versions, the recording's
    digest, who reviewed. Raises `ValueError` when it would not be valid.
    """
    told = orjson.loads(report.body)
    held = outcome(report_of(report.body), entries, rules)
    status = _status(entries, report)
    resources = {
        "inhaler": _inhaler(session),
        "program": _program(report),
        "observation": _observation(session, told, held, rules, status),
        "report": _diagnostic_report(session, report, held.score, entries, status),
        "provenance": _provenance(session, report, entries),
    }
    content = {
        "resourceType": "Bundle",
        "type": "collection",
        "identifier": {"system": "urn:inhalemon:sessions", "value": session.id},
        "timestamp": to_iso(now_us()),
        "entry": [
            {"fullUrl": _url(session, name), "resource": {"id": _uuid(session, name)} | resource}
            for name, resource in resources.items()
        ],
    }
    return Bundle.model_validate(content).model_dump_json(exclude_none=True).encode()


def code_systems(rules: RuleSet) -> bytes:
    """A Bundle with the codes of rules and measures, and what each means."""
    concepts = {
        RULES: [(rule.id, rule.title) for rule in rules.rules],
        MEASURE_CODES: list(MEASURES.items()),
    }
    systems = [
        {
            "resourceType": "CodeSystem",
            "url": url,
            "name": f"Inhalemon{url.rpartition(':')[2].title()}",
            "version": inhalemon.__version__,
            "status": "active",
            "content": "complete",
            "caseSensitive": True,
            "concept": [{"code": code, "display": display} for code, display in found],
        }
        for url, found in concepts.items()
    ]
    for each in systems:
        CodeSystem.model_validate(each)
    content = {"resourceType": "Bundle", "type": "collection", "entry": [{"resource": each} for each in systems]}
    return Bundle.model_validate(content).model_dump_json(exclude_none=True).encode()


# ------------------------------------------------------------------------------------------ resources


def _inhaler(session: Session) -> Json:
    return {
        "resourceType": "Device",
        "type": {
            "coding": [
                _coding(_ENTITY, "INH", "Inhaler"),
                _coding(DEVICES, session.device or "unknown"),
            ]
        },
        "note": [{"text": "with one inertial sensor on its body and one on its lever or cover"}],
    }


def _program(report: StoredReport) -> Json:
    versions = {
        "program": inhalemon.__version__,
        "pipeline": report.pipeline_version,
        "settings": report.settings_digest,
        "rules": report.rules_digest,
    }
    return {
        "resourceType": "Device",
        "deviceName": [{"name": "inhalemon", "type": "model-name"}],
        "type": {"text": "program that scores recorded inhaler sessions; decision support, not a medical device"},
        "version": [{"type": {"text": name}, "value": value} for name, value in versions.items()],
    }


def _status(entries: Sequence[Review], report: StoredReport) -> str:
    if not sign_offs(entries, report.id):
        return "preliminary"
    return "amended" if is_amended(entries, report.id) else "final"


def _observation(session: Session, told: Json, held: Outcome, rules: RuleSet, status: str) -> Json:
    titles = {rule.id: rule.title for rule in rules.rules}
    findings = {each["rule"]: each for each in told["findings"]}
    components = [_measure(name, measure) for name, measure in told["measures"].items()]
    components += [
        _finding(each, findings.get(each.rule, {}), titles.get(each.rule, each.rule)) for each in held.findings
    ]
    return {
        "resourceType": "Observation",
        "status": status,
        "category": [{"coding": [_coding(_CATEGORY, "procedure", "Procedure")]}],
        "code": _technique(),
        **_subject(session),
        "effectiveDateTime": to_iso(session.happened_at_us),
        "device": {"reference": _url(session, "program")},
        "valueCodeableConcept": {"coding": [_coding(GRADES, str(held.score.grade))]},
        "component": components,
    }


def _measure(name: str, measure: Json) -> Json:
    found: Json = {"code": {"coding": [_coding(MEASURE_CODES, name, MEASURES.get(name))]}}
    if measure["value"] is None:
        return found | _absent("unknown", measure.get("reason"))
    code, unit = next(((code, unit) for ending, code, unit in _UNITS if name.endswith(ending)), ("1", "count"))
    quantity = {"value": measure["value"], "unit": unit, "system": _UCUM, "code": code}
    return found | {"valueQuantity": quantity}


def _finding(held: Finding, by_machine: Json, title: str) -> Json:
    found: Json = {"code": {"coding": [_coding(RULES, held.rule, title)]}}
    is_the_machines = by_machine.get("verdict") == held.verdict
    if held.verdict is Verdict.NOT_ASSESSABLE:
        reason = held.reason if is_the_machines else _REVIEWED
        is_implied = reason is not None and reason.startswith("implied_by:")
        return found | _absent("not-applicable" if is_implied else "unknown", reason)
    text = held.message if is_the_machines else _REVIEWED
    return found | {"valueCodeableConcept": {"coding": [_coding(VERDICTS, held.verdict)], "text": text}}


def _absent(code: str, reason: object) -> Json:
    told = {"text": reason} if isinstance(reason, str) and reason else {}
    return {"dataAbsentReason": {"coding": [_coding(_ABSENT, code)], **told}}


def _diagnostic_report(
    session: Session, report: StoredReport, held: Score, entries: Sequence[Review], status: str
) -> Json:
    comments = [entry.reason for entry in standing(entries) if entry.kind == ReviewKind.COMMENT and entry.reason]
    conclusion = f"{_in_words(report.grade)}, {report.points} of 100 points by the machine"
    if (held.grade, held.points) != (report.grade, report.points):
        after = f"{_in_words(held.grade)}, {held.points} of 100 points after review"
        conclusion = f"{after}; by the machine {_in_words(report.grade)}, {report.points} of 100 points"
    return {
        "resourceType": "DiagnosticReport",
        "identifier": [{"system": "urn:inhalemon:reports", "value": report.id}],
        "status": status,
        "code": _technique(),
        **_subject(session),
        "effectiveDateTime": to_iso(session.happened_at_us),
        "issued": to_iso(session.signed_off_us or report.created_at_us),
        "result": [{"reference": _url(session, "observation")}],
        "conclusion": ". ".join([conclusion, *comments]),
    }


def _in_words(grade: str) -> str:
    return grade.replace("_", " ")


def _provenance(session: Session, report: StoredReport, entries: Sequence[Review]) -> Json:
    reviewers = sorted({entry.reviewer for entry in standing(entries)})
    return {
        "resourceType": "Provenance",
        "target": [{"reference": _url(session, name)} for name in ("observation", "report")],
        "recorded": to_iso(max([report.created_at_us, *(entry.at_us for entry in entries)])),
        "agent": [
            {
                "type": {"coding": [_coding(_PARTICIPANT, "assembler", "Assembler")]},
                "who": {"reference": _url(session, "program")},
            },
            *(
                {
                    "type": {"coding": [_coding(_PARTICIPANT, "verifier", "Verifier")]},
                    "who": {"identifier": {"system": f"urn:inhalemon:clinics:{session.clinic}", "value": reviewer}},
                }
                for reviewer in reviewers
            ),
        ],
        "entity": [
            {
                "role": "source",
                "what": {"identifier": {"system": "urn:inhalemon:recordings:sha256", "value": session.sha256}},
            }
        ],
    }


# ------------------------------------------------------------------------------------------ parts


def _technique() -> Json:
    return {"coding": [_coding(_SNOMED, "170614009", "Inhaler technique observed")], "text": "Inhaler technique"}


def _subject(session: Session) -> Json:
    """The patient by pseudonym: an identifier of this clinic, no Patient resource."""
    if session.patient_ref is None:
        return {}
    system = f"urn:inhalemon:clinics:{session.clinic}:patients"
    return {"subject": {"type": "Patient", "identifier": {"system": system, "value": session.patient_ref}}}


def _coding(system: str, code: str, display: str | None = None) -> Json:
    return {"system": system, "code": code} | ({} if display is None else {"display": display})


def _uuid(session: Session, name: str) -> str:
    return str(uuid.uuid5(_NAMESPACE, f"{session.id}/{name}"))


def _url(session: Session, name: str) -> str:
    return f"urn:uuid:{_uuid(session, name)}"
