"""Everything of a clinic in one file: CSV, a row a session, or JSON lines with whole reports and reviews."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterator, Sequence

import orjson

from api import present, verdicts
from api.service import Service
from api.store import Connection, listing, reviews, sessions
from api.store.listing import Filter
from api.store.sessions import Session
from inhalemon.measures import MEASURES
from inhalemon.values import Report

_BLOCK = 200
_SESSION_CELLS = (
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
    "machine_grade",
    "machine_points",
    "duration_s",
    "signed_off_at",
)
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")  # a spreadsheet would run such a cell


def jsonl(service: Service, clinic_ids: Sequence[str], given: Filter) -> Iterator[bytes]:
    """One line a session: the session, its newest report, its whole review."""
    with service.store.read() as connection:
        for block in _blocks(connection, clinic_ids, given):
            ids = [session.id for session, _ in block]
            mistakes, entries = sessions.mistakes_of(connection, ids), reviews.histories_of(connection, ids)
            for session, body in block:
                line = present.export_line(session, body, mistakes[session.id], entries[session.id])
                yield orjson.dumps(line) + b"\n"


def csv_lines(service: Service, clinic_ids: Sequence[str], given: Filter) -> Iterator[bytes]:
    """A header, then one row a session: it and its mistakes after review, the machine's measures and verdicts."""
    rules = [rule.id for rule in service.rules.rules]
    columns = [*_SESSION_CELLS, "mistakes", "machine_mistakes", *MEASURES, *rules]
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(columns)
    yield buffer.getvalue().encode()
    with service.store.read() as connection:
        for block in _blocks(connection, clinic_ids, given):
            mistakes = sessions.mistakes_of(connection, [session.id for session, _ in block])
            buffer.seek(0)
            buffer.truncate()
            for session, body in block:
                cells = _session_cells(session) | {"mistakes": " ".join(mistakes[session.id])}
                if body is not None:
                    cells |= _report_cells(verdicts.report_of(body))
                writer.writerow([_cell(cells.get(column)) for column in columns])
            yield buffer.getvalue().encode()


def _session_cells(session: Session) -> dict[str, object]:
    moments = {
        "recorded_at": present.moment(session.recorded_at_us),
        "uploaded_at": present.moment(session.uploaded_at_us),
        "signed_off_at": present.moment(session.signed_off_us),
    }
    return {name: moments[name] if name in moments else getattr(session, name) for name in _SESSION_CELLS}


def _report_cells(report: Report) -> dict[str, object]:
    """The machine's part of a row."""
    machine = verdicts.machine(report)
    measures = {name: measure.value for name, measure in report.measures.items()}
    return {"machine_mistakes": " ".join(verdicts.mistakes(machine)), **measures, **machine}


def _blocks(
    connection: Connection, clinic_ids: Sequence[str], given: Filter
) -> Iterator[list[tuple[Session, bytes | None]]]:
    every = listing.stream(connection, clinic_ids, given)
    while block := list(itertools.islice(every, _BLOCK)):
        yield block


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.6f}".rstrip("0").rstrip(".")
    text = str(value)
    return "'" + text if isinstance(value, str) and text.startswith(_FORMULA_STARTS) else text
