"""Writes the JSON Schemas beside this file: `python docs/schema/make_schema.py`. A test holds them to be current."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from inhalemon.measures import MEASURES, unit_of
from inhalemon.values import DeviceKind, EventKind, Grade, PhaseKind, SensorName, Severity, Verdict

Schema = dict[str, Any]

DRAFT = "https://json-schema.org/draft/2020-12/schema"
TEXT: Schema = {"type": "string"}
OPTIONAL_TEXT: Schema = {"type": ["string", "null"]}
NUMBER: Schema = {"type": "number"}
OPTIONAL_NUMBER: Schema = {"type": ["number", "null"]}
OPTIONAL_COUNT: Schema = {"type": ["integer", "null"]}
DIGEST: Schema = {"type": "string", "pattern": "^[0-9a-f]{64}$"}
UNITS = {"s": "seconds", "deg": "degrees", "count": "a count"}


def schemas() -> dict[str, Schema]:
    """File name to schema."""
    return {
        "report-1.json": {**_head("report", "One scored session"), **_report(), "$defs": _parts()},
        "error-1.json": {**_head("error", "A recording that could not be used"), **_error()},
        "labels-1.json": {
            **_head("labels", "What is known to have happened in a session, for `inhalemon evaluate`"),
            **_labels(),
            "$defs": {name: _parts()[name] for name in ("phase", "event")},
        },
    }


def as_text(schema: Schema) -> str:
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def _head(name: str, title: str) -> Schema:
    return {"$schema": DRAFT, "$id": f"inhalemon-{name}-1", "title": f"inhalemon-{name}/1: {title}"}


def _object(properties: Schema, *, optional: tuple[str, ...] = (), is_open: bool = False) -> Schema:
    required = [name for name in properties if name not in optional]
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": is_open}


def _one_of(choices: Any) -> Schema:
    return {"type": "string", "enum": [str(choice) for choice in choices]}


def _list_of(name: str) -> Schema:
    return {"type": "array", "items": {"$ref": f"#/$defs/{name}"}}


def _report() -> Schema:
    return _object(
        {
            "format": {"const": "inhalemon-report/1"},
            "session_id": TEXT,
            "device": _one_of(DeviceKind),
            "pipeline_version": TEXT,
            "settings_digest": DIGEST,
            "rules_digest": DIGEST,
            "duration_s": {"type": "number", "minimum": 0},
            "quality": {"$ref": "#/$defs/quality"},
            "phases": {
                **_list_of("phase"),
                "description": "in order of time, without overlap, covering the session",
            },
            "events": _list_of("event"),
            "measures": {"$ref": "#/$defs/measures", "description": "of the worst dose"},
            "findings": {**_list_of("finding"), "description": "the worst verdict of each rule over the doses"},
            "doses": _list_of("dose"),
            "score": {"$ref": "#/$defs/score"},
        }
    )


def _parts() -> dict[str, Schema]:
    flag = _object({"code": TEXT, "sensor": {"enum": [*map(str, SensorName), None]}, "detail": TEXT})
    measured = _object({"value": NUMBER, "sd": OPTIONAL_NUMBER})
    missing = _object({"value": {"type": "null"}, "sd": OPTIONAL_NUMBER, "reason": TEXT})
    named = {
        name: {"$ref": "#/$defs/measure", "description": f"{meaning}; {UNITS[unit_of(name)]}"}
        for name, meaning in MEASURES.items()
    }
    span = {"start_s": OPTIONAL_NUMBER, "end_s": OPTIONAL_NUMBER}
    finding = _object(
        {
            "rule": TEXT,
            "verdict": _one_of(Verdict),
            "severity": {"enum": [*map(str, Severity), None]},
            "value": OPTIONAL_NUMBER,
            "limit": OPTIONAL_NUMBER,
            "unit": {"enum": ["s", "deg", "count", None]},
            **span,
            "reason": {**OPTIONAL_TEXT, "description": "why nothing was decided; null for pass and fail"},
            "message": TEXT,
        }
    )
    decided = {"properties": {"verdict": {"enum": ["pass", "fail"]}}}
    finding |= {
        "if": decided,
        "then": {"properties": {"reason": {"type": "null"}}},
        "else": {"properties": {"reason": {"type": "string"}}},
    }
    return {
        "quality": _object({"usable": {"type": "boolean"}, "flags": {"type": "array", "items": flag}}),
        "phase": _object(
            {
                "kind": _one_of(PhaseKind),
                "start_s": NUMBER,
                "end_s": NUMBER,
                "confidence": {"type": "number", "minimum": 0, "maximum": 1},
            },
            optional=("confidence",),
        ),
        "event": _object(
            {"kind": _one_of(EventKind), "start_s": NUMBER, "peak_s": NUMBER, "end_s": NUMBER, "angle_deg": NUMBER}
        ),
        "measure": {"oneOf": [measured, missing]},
        "measures": _object(named, optional=tuple(named)),
        "finding": finding,
        "dose": _object(
            {
                "start_s": NUMBER,
                "end_s": NUMBER,
                "events": _list_of("event"),
                "measures": {"$ref": "#/$defs/measures"},
                "findings": _list_of("finding"),
                "score": {"$ref": "#/$defs/score"},
            }
        ),
        "score": _object({"points": {"type": "integer", "minimum": 0, "maximum": 100}, "grade": _one_of(Grade)}),
    }


def _error() -> Schema:
    error = _object(
        {
            "code": TEXT,
            "line": {**OPTIONAL_COUNT, "description": "counts from 1, the header included"},
            "column": OPTIONAL_TEXT,
            "found": OPTIONAL_TEXT,
            "wanted": OPTIONAL_TEXT,
            "detail": {**OPTIONAL_TEXT, "description": "what to do"},
        }
    )
    return _object({"format": {"const": "inhalemon-error/1"}, "file": OPTIONAL_TEXT, "error": error})


def _labels() -> Schema:
    measure = {"type": ["number", "null"]}
    properties: Schema = {
        "format": {"const": "inhalemon-labels/1"},
        "session_id": TEXT,
        "mistakes": {"type": "array", "items": TEXT, "uniqueItems": True, "description": "rule ids"},
        "phases": _list_of("phase"),
        "events": _list_of("event"),
        "measures": {
            "type": "object",
            "additionalProperties": {"anyOf": [measure, {"type": "object", "required": ["value"]}]},
        },
    }
    return _object(properties, optional=("phases", "events", "measures"), is_open=True)


if __name__ == "__main__":
    for name, schema in schemas().items():
        Path(__file__).with_name(name).write_text(as_text(schema), encoding="utf-8")
