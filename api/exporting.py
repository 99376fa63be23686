"""Everything of a clinic in one file: CSV, a row a session, or JSON lines with whole reports and reviews."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterator, Sequence

import orjson

from api import present
from api.service import Service
from api.store import Connection, reviews, sessions
from api.store.reviews import Review
from api.store.sessions import Filter, Session
from api.verdicts import effective, mistakes
from inhalemon.measures import MEASURES
from inhalemon.rules import load_rules

_BLOCK = 200
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")  # a spreadsheet would run such a cell


def jsonl(service: Service, clinic_ids: Sequence[str], given: Filter) -> Iterator[bytes]:
    """One line a session: the session, its newest report, its whole review."""
    with service.store.read() as connection:
        for session, body, entries in _rows(connection, clinic_ids, given):
            line = present.export_line(session, body, entries)
            yield orjson.dumps(line) + b"\n"


def csv_lines(service: Service, clinic_ids: Sequence[str], given: Filter) -> Iterator[bytes]:
    """A header, then one row a session: the session, measures, the machine's verdicts, mistakes after review."""
    rules = [rule.id for rule in load_rules(service.settings.scoring_rules).rules]
    columns = [*_session_cells(None), "mistakes", "mistakes_after_review", *MEASURES, *rules]
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(columns)
    yield buffer.getvalue().encode()
    with service.store.read() as connection:
        for session, body, entries in _rows(connection, clinic_ids, given):
            report = {} if body is None else orjson.loads(body)
            verdicts = {each["rule"]: each["verdict"] for each in report.get("findings", [])}
            cells = _session_cells(session) | {
                "mistakes": " ".join(mistakes(verdicts)),
                "mistakes_after_review": " ".join(mistakes(effective(verdicts, entries))),
                **{name: measure["value"] for name, measure in report.get("measures", {}).items()},
                **verdicts,
            }
            buffer.seek(0)
            buffer.truncate()
            writer.writerow([_cell(cells.get(column)) for column in columns])
            yield buffer.getvalue().encode()


def _session_cells(session: Session | None) -> dict[str, object]:
    names = (
        "id",
        "clinic",
        "session_ref",
        "device",
        "patient_ref",
        "recorded_at",
        "uploaded_at",
        "state",
        "grade",
        "points",
        "duration_s",
        "signed_off_at",
    )
    if session is None:
        return dict.fromkeys(names)
    moments = {
        "recorded_at": present.moment(session.recorded_at_us),
        "uploaded_at": present.moment(session.uploaded_at_us),
        "signed_off_at": present.moment(session.signed_off_us),
    }
    return {name: moments[name] if name in moments else getattr(session, name) for name in names}


def _rows(
    connection: Connection, clinic_ids: Sequence[str], given: Filter
) -> Iterator[tuple[Session, bytes | None, Sequence[Review]]]:
    every = sessions.stream(connection, clinic_ids, given)
    while block := list(itertools.islice(every, _BLOCK)):
        entries = reviews.histories_of(connection, [session.id for session, _ in block])
        for session, body in block:
            yield session, body, entries[session.id]


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.6f}".rstrip("0").rstrip(".")
    text = str(value)
    return "'" + text if isinstance(value, str) and text.startswith(_FORMULA_STARTS) else text
