"""Reports as JSON documents, `inhalemon-report/1` and `inhalemon-error/1`, and back.

Times and measures are written to the microsecond and the millionth: far below what the sensors can know.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import orjson

from inhalemon.exceptions import InhalemonError, RecordingError
from inhalemon.formats import ERROR_FORMAT, REPORT_FORMAT
from inhalemon.measures import INTERNAL_MEASURES
from inhalemon.values import (
    DeviceKind,
    Dose,
    Event,
    EventKind,
    Finding,
    Flag,
    Grade,
    Measure,
    Phase,
    PhaseKind,
    Quality,
    Report,
    Score,
    SensorName,
    Severity,
    Verdict,
)

_DECIMALS: Final = 6

Document = dict[str, Any]  # JSON: any value that orjson reads and writes


def to_dict(report: Report) -> Document:
    """The report as an `inhalemon-report/1` document; measures that only the rules need are left out."""
    return {
        "format": REPORT_FORMAT,
        "session_id": report.session_id,
        "device": str(report.device),
        "pipeline_version": report.pipeline_version,
        "settings_digest": report.settings_digest,
        "rules_digest": report.rules_digest,
        "duration_s": _number(report.duration_s),
        "quality": quality_to_dict(report.quality),
        "phases": [
            {
                "kind": str(phase.kind),
                "start_s": _number(phase.start_s),
                "end_s": _number(phase.end_s),
                "confidence": _number(phase.confidence),
            }
            for phase in report.phases
        ],
        "events": _events(report.events),
        "measures": _measures(report.measures),
        "findings": _findings(report.findings),
        "doses": [
            {
                "start_s": _number(dose.start_s),
                "end_s": _number(dose.end_s),
                "events": _events(dose.events),
                "measures": _measures(dose.measures),
                "findings": _findings(dose.findings),
                "score": _score(dose.score),
            }
            for dose in report.doses
        ],
        "score": _score(report.score),
    }


def quality_to_dict(quality: Quality) -> Document:
    """Whether a recording is usable, and what is doubtful about it."""
    flags = [
        {"code": flag.code, "sensor": str(flag.sensor) if flag.sensor else None, "detail": flag.detail}
        for flag in quality.flags
    ]
    return {"usable": quality.usable, "flags": flags}


def to_json(report: Report, *, indent: bool = False) -> bytes:
    """The report's document as UTF-8 JSON, on one line unless `indent`."""
    return orjson.dumps(to_dict(report), option=orjson.OPT_INDENT_2 if indent else None)


def error_to_dict(error: InhalemonError, *, file: str | None = None) -> Document:
    """What stands in a report's place for a recording that cannot be used: an `inhalemon-error/1` document."""
    fields: Document = dict.fromkeys(("code", "line", "column", "found", "wanted", "detail"))
    if isinstance(error, RecordingError):
        fields |= {name: getattr(error, name) for name in fields}
        file = file or error.file
    else:
        fields |= {"code": "cannot_be_scored", "detail": str(error)}
    return {"format": ERROR_FORMAT, "file": file, "error": fields}


def from_dict(document: Mapping[str, Any]) -> Report:
    """The `Report` of an `inhalemon-report/1` document. Raises `ValueError` for anything else."""
    if document.get("format") != REPORT_FORMAT:
        raise ValueError(f"format is {document.get('format')!r}; expected {REPORT_FORMAT!r}")
    try:
        return _report(document)
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"not a whole {REPORT_FORMAT} document: {error!r}") from error


def _report(document: Mapping[str, Any]) -> Report:
    quality = document["quality"]
    flags = (Flag(f["code"], SensorName(f["sensor"]) if f["sensor"] else None, f["detail"]) for f in quality["flags"])
    return Report(
        session_id=document["session_id"],
        device=DeviceKind(document["device"]),
        pipeline_version=document["pipeline_version"],
        settings_digest=document["settings_digest"],
        rules_digest=document["rules_digest"],
        duration_s=document["duration_s"],
        quality=Quality(quality["usable"], tuple(flags)),
        phases=tuple(
            Phase(PhaseKind(p["kind"]), p["start_s"], p["end_s"], p["confidence"]) for p in document["phases"]
        ),
        events=_events_of(document["events"]),
        measures=_measures_of(document["measures"]),
        findings=_findings_of(document["findings"]),
        doses=tuple(
            Dose(
                dose["start_s"],
                dose["end_s"],
                _events_of(dose["events"]),
                _measures_of(dose["measures"]),
                _findings_of(dose["findings"]),
                _score_of(dose["score"]),
            )
            for dose in document["doses"]
        ),
        score=_score_of(document["score"]),
    )


def _number(value: float | None) -> float | None:
    if value is None or not math.isfinite(value):
        return None
    return round(float(value), _DECIMALS) + 0.0  # no negative zero


def _events(events: Sequence[Event]) -> list[Document]:
    numbers = ("start_s", "peak_s", "end_s", "angle_deg")
    return [{"kind": str(event.kind)} | {name: _number(getattr(event, name)) for name in numbers} for event in events]


def _measures(measures: Mapping[str, Measure]) -> Document:
    return {name: _measure(measure) for name, measure in measures.items() if name not in INTERNAL_MEASURES}


def _measure(measure: Measure) -> Document:
    written = {"value": _number(measure.value), "sd": _number(measure.sd)}
    if written["value"] is None:
        return written | {"reason": measure.reason or "not_finite"}
    return written


def _findings(findings: Sequence[Finding]) -> list[Document]:
    return [
        {
            "rule": finding.rule,
            "verdict": str(finding.verdict),
            "severity": str(finding.severity) if finding.severity else None,
            "value": _number(finding.value),
            "limit": _number(finding.limit),
            "unit": finding.unit,
            "start_s": _number(finding.start_s),
            "end_s": _number(finding.end_s),
            "reason": finding.reason,
            "message": finding.message,
        }
        for finding in findings
    ]


def _score(score: Score) -> Document:
    return {"points": score.points, "grade": str(score.grade)}


def _events_of(events: Sequence[Document]) -> tuple[Event, ...]:
    return tuple(Event(EventKind(e["kind"]), e["start_s"], e["peak_s"], e["end_s"], e["angle_deg"]) for e in events)


def _measures_of(measures: Document) -> dict[str, Measure]:
    return {name: Measure(m["value"], m["sd"], m.get("reason")) for name, m in measures.items()}


def _findings_of(findings: Sequence[Document]) -> tuple[Finding, ...]:
    numbers = ("value", "limit", "unit", "start_s", "end_s", "reason", "message")
    return tuple(
        Finding(
            f["rule"],
            Verdict(f["verdict"]),
            Severity(f["severity"]) if f["severity"] else None,
            **{name: f[name] for name in numbers},
        )
        for f in findings
    )


def _score_of(score: Document) -> Score:
    return Score(score["points"], Grade(score["grade"]))
