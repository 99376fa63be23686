"""Report and label documents as sessions that can be compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import cast

from inhalemon.exceptions import LabelsError
from inhalemon.formats import ERROR_FORMAT, LABELS_FORMAT, REPORT_FORMAT
from inhalemon.recording import session_id_of
from inhalemon.values import Event, EventKind, Measure, Phase, PhaseKind, Report, Verdict


@dataclass(frozen=True, slots=True)
class Session:
    """What a report or a label says of one session.

    In labels `verdicts` holds `fail` for each mistake and nothing else. `is_scored` is false for a recording that
    could not be used.
    """

    session_id: str
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
    not_observable: frozenset[str] = frozenset()  # rules that no recording of these sensors can decide
    phases: tuple[Phase, ...] = ()
    events: tuple[Event, ...] = ()
    measures: Mapping[str, Measure] = field(default_factory=dict)
    is_scored: bool = True


def session_from_report(report: Report | Mapping[str, object]) -> Session:
    """The session of a `Report`, an `inhalemon-report/1` or an `inhalemon-error/1` document. Raises `LabelsError`.

    An error names a file and no session: its id is the one in the sidecar that stands beside the file, or its stem.
    """
    if isinstance(report, Report):
        return Session(
            session_id=report.session_id,
            verdicts={finding.rule: finding.verdict for finding in report.findings},
            not_observable=frozenset(f.rule for f in report.findings if f.reason == "not_observable"),
            phases=report.phases,
            events=report.events,
            measures=report.measures,
        )
    kind = report.get("format")
    if kind == ERROR_FORMAT:
        return Session(session_id=session_id_of(str(report.get("file") or "")), is_scored=False)
    if kind != REPORT_FORMAT:
        raise LabelsError(f"report: format is {kind!r}; expected {REPORT_FORMAT}")
    session_id = str(report.get("session_id"))
    return _guarded(f"report {session_id}", lambda: _report(report, session_id))


def session_from_labels(labels: Mapping[str, object]) -> Session:
    """The session of an `inhalemon-labels/1` document. Raises `LabelsError`."""
    kind = labels.get("format")
    if kind != LABELS_FORMAT:
        raise LabelsError(f"labels: format is {kind!r}; expected {LABELS_FORMAT}")
    session_id = str(labels.get("session_id"))
    return _guarded(f"labels {session_id}", lambda: _labels(labels, session_id))


def _report(document: Mapping[str, object], session_id: str) -> Session:
    findings = _dicts(document, "findings")
    return Session(
        session_id=session_id,
        verdicts={str(finding["rule"]): Verdict(str(finding["verdict"])) for finding in findings},
        not_observable=frozenset(str(f["rule"]) for f in findings if f.get("reason") == "not_observable"),
        phases=_phases(document),
        events=_events(document),
        measures=_measures(document),
    )


def _labels(document: Mapping[str, object], session_id: str) -> Session:
    mistakes = document["mistakes"]
    if not isinstance(mistakes, list):
        raise TypeError("mistakes is not a list of rule ids")
    return Session(
        session_id=session_id,
        verdicts={str(rule): Verdict.FAIL for rule in mistakes},
        phases=_phases(document),
        events=_events(document),
        measures=_measures(document),
    )


def _phases(document: Mapping[str, object]) -> tuple[Phase, ...]:
    return tuple(
        Phase(PhaseKind(str(each["kind"])), _number(each["start_s"]), _number(each["end_s"]))
        for each in _dicts(document, "phases")
    )


def _events(document: Mapping[str, object]) -> tuple[Event, ...]:
    numbers = ("start_s", "peak_s", "end_s", "angle_deg")
    return tuple(
        Event(EventKind(str(each["kind"])), *(_number(each[name]) for name in numbers))
        for each in _dicts(document, "events")
    )


def _measures(document: Mapping[str, object]) -> dict[str, Measure]:
    """A measure is `{"value": ..., "sd": ...}` in reports, a bare number or the like in labels."""
    given = cast("Mapping[str, object]", document.get("measures") or {})
    measures = {}
    for name, found in given.items():
        parts = found if isinstance(found, Mapping) else {"value": found}
        value, sd = parts.get("value"), parts.get("sd")
        measures[name] = Measure(None if value is None else _number(value), None if sd is None else _number(sd))
    return measures


def _dicts(document: Mapping[str, object], name: str) -> list[Mapping[str, object]]:
    given = document.get(name) or []
    if not isinstance(given, list) or not all(isinstance(each, Mapping) for each in given):
        raise TypeError(f"{name} is not a list of objects")
    return given


def _number(found: object) -> float:
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise TypeError(f"{found!r} is not a number")
    return float(found)


def _guarded(where: str, build: Callable[[], Session]) -> Session:
    try:
        return build()
    except KeyError as error:
        raise LabelsError(f"{where}: {error.args[0]} is missing") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise LabelsError(f"{where}: {error}") from error
