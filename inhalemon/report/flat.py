"""Many reports as CSV, one row a session; the columns are the same whatever was found."""

from __future__ import annotations

import csv
import functools
import io
from collections.abc import Iterable, Iterator
from typing import Final

from inhalemon.exceptions import InhalemonError, RecordingError
from inhalemon.measures import MEASURES
from inhalemon.rules import load_rules
from inhalemon.values import Report, Verdict

_FIRST: Final = ("session_id", "device", "duration_s", "usable", "flags", "grade", "points", "n_doses", "mistakes")
_VERSIONS: Final = ("pipeline_version", "settings_digest", "rules_digest")
_LAST: Final = ("other_rules", "error_code", "error", *_VERSIONS)
_FORMULA_STARTS: Final = ("=", "+", "-", "@", "\t", "\r")  # a spreadsheet would run such a cell


@functools.cache
def csv_columns() -> tuple[str, ...]:
    """The session, each measure, the verdict of each shipped rule, the rules of one's own, the error."""
    return (*_FIRST, *MEASURES, *_rule_ids(), *_LAST)


def to_csv(sessions: Iterable[tuple[str, Report | InhalemonError]]) -> Iterator[str]:
    """CSV lines, the header first; each session is a file's name and its report, or why it could not be used."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(csv_columns())
    yield buffer.getvalue()
    for file, outcome in sessions:
        buffer.seek(0)
        buffer.truncate()
        row = _row(outcome) if isinstance(outcome, Report) else _error_row(file, outcome)
        writer.writerow([_cell(row.get(column)) for column in csv_columns()])
        yield buffer.getvalue()


@functools.cache
def _rule_ids() -> tuple[str, ...]:
    return tuple(rule.id for rule in load_rules("default").rules)


def _row(report: Report) -> dict[str, object]:
    verdicts = {finding.rule: finding.verdict for finding in report.findings}
    own = (f"{rule}={verdict}" for rule, verdict in verdicts.items() if rule not in _rule_ids())
    return {
        "session_id": report.session_id,
        "device": report.device,
        "duration_s": report.duration_s,
        "usable": "yes" if report.quality.usable else "no",
        "flags": " ".join(dict.fromkeys(flag.code for flag in report.quality.flags)),
        "grade": report.score.grade,
        "points": report.score.points,
        "n_doses": len(report.doses),
        "mistakes": " ".join(f"{f.rule}:{f.severity}" for f in report.findings if f.verdict is Verdict.FAIL),
        **{name: measure.value for name, measure in report.measures.items()},
        **verdicts,
        "other_rules": " ".join(own),
        **{name: getattr(report, name) for name in _VERSIONS},
    }


def _error_row(file: str, error: InhalemonError) -> dict[str, object]:
    code = error.code if isinstance(error, RecordingError) else "cannot_be_scored"
    return {"session_id": file, "usable": "no", "error_code": code, "error": str(error)}


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.6f}".rstrip("0").rstrip(".")
    text = str(value)
    return "'" + text if text.startswith(_FORMULA_STARTS) and isinstance(value, str) else text
