"""Where the outcomes of `inhalemon score` go, in each format; and what a file already holds from an earlier run."""

from __future__ import annotations

import csv
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

import orjson
import typer

from inhalemon.cli.options import Form
from inhalemon.cli.output import console, write
from inhalemon.exceptions import RecordingError
from inhalemon.report import from_dict
from inhalemon.report.documents import ERROR_FORMAT, REPORT_FORMAT, Document

if TYPE_CHECKING:
    from inhalemon.values import Report

Key = tuple[str, str]  # ("session", id) of a report, ("file", name) of a recording that could not be used
Versions = tuple[str, str, str]  # of the pipeline, the settings and the rules

_JSON_START: Final = b'{"format":"inhalemon-'
_CSV_START: Final = b"session_id,"
_BY_SUFFIX: Final[dict[str, Form]] = {".json": "json", ".jsonl": "jsonl", ".csv": "csv"}


class Sink(Protocol):
    """Takes one-line JSON documents, in order."""

    def add(self, document: bytes) -> None: ...

    def close(self) -> None: ...


def form_of(out: Path | None) -> Form:
    """The format that a file's name asks for; a table for any other name and for standard output."""
    return _BY_SUFFIX.get(out.suffix, "table") if out is not None else "table"


def sink_of(form: Form, out: Path | None, versions: Versions, *, is_single: bool) -> tuple[Sink, list[Key]]:
    """The sink, and the keys of what the file `out` holds already.

    `is_single` makes JSON one document instead of a list, and the table a full one. Only JSONL and CSV grow as the
    batch goes on, so only they outlive a kill; JSON is taken up again when it is whole, a table never.
    """
    if form == "jsonl":
        lines = _Lines(out)
        _refuse_foreign_half(lines.half, _JSON_START, out)
        kept = [document for line in lines.found for document in _documents(line, out)]
        _refuse_others(kept, versions, out)
        return JsonLines(lines), [_key(document) for document in kept]
    if form == "csv":
        lines = _Lines(out)
        if not lines.found:
            _refuse_foreign_half(lines.half, _CSV_START, out)
        return Csv(lines), _csv_keys(lines.found, out)
    if form == "json":
        kept = _documents(out.read_bytes(), out) if out is not None and out.exists() else []
        _refuse_others(kept, versions, out)
        return Json(out, kept, is_single=is_single), [_key(document) for document in kept]
    return Table(out, is_single=is_single), []


class _Lines:
    """Lines added one at a time to standard output or to a file; half a line left by a kill goes when one is added."""

    def __init__(self, out: Path | None) -> None:
        self.found: list[bytes] = []
        self.half = b""
        self._handle: int | None = None
        if out is None:
            return
        self._handle = os.open(out, os.O_RDWR | os.O_CREAT, 0o666)
        with open(self._handle, "rb", closefd=False) as file:
            self.found = file.readlines()
        if self.found and not self.found[-1].endswith(b"\n"):
            self.half = self.found.pop()
        os.lseek(self._handle, sum(map(len, self.found)), os.SEEK_SET)

    def append(self, line: bytes) -> None:
        if self._handle is None:
            sys.stdout.buffer.write(line)
            sys.stdout.buffer.flush()
            return
        if self.half:
            os.ftruncate(self._handle, os.lseek(self._handle, 0, os.SEEK_CUR))
            self.half = b""
        while line:
            line = line[os.write(self._handle, line) :]

    def close(self) -> None:
        if self._handle is not None:
            os.fsync(self._handle)
            os.close(self._handle)


class JsonLines:
    def __init__(self, lines: _Lines) -> None:
        self._lines = lines

    def add(self, document: bytes) -> None:
        self._lines.append(document + b"\n")

    def close(self) -> None:
        self._lines.close()


class Csv:
    def __init__(self, lines: _Lines) -> None:
        self._lines = lines
        self._has_header = bool(lines.found)

    def add(self, document: bytes) -> None:
        from inhalemon.report.flat import to_csv

        header, row = to_csv([_opened(document)])
        self._lines.append((row if self._has_header else header + row).encode())
        self._has_header = True

    def close(self) -> None:
        self._lines.close()


class Json:
    def __init__(self, out: Path | None, kept: list[Document], *, is_single: bool) -> None:
        self._out = out
        self._documents = kept
        self._is_single = is_single

    def add(self, document: bytes) -> None:
        self._documents.append(orjson.loads(document))

    def close(self) -> None:
        whole = self._documents[0] if self._is_single and len(self._documents) == 1 else self._documents
        write(orjson.dumps(whole, option=orjson.OPT_INDENT_2) + b"\n", self._out)


class Table:
    def __init__(self, out: Path | None, *, is_single: bool) -> None:
        self._out = out
        self._is_single = is_single
        self._sessions: list[tuple[str, Report | RecordingError]] = []

    def add(self, document: bytes) -> None:
        self._sessions.append(_opened(document))

    def close(self) -> None:
        from inhalemon.report.table import session_table, sessions_table

        if not self._sessions:
            return
        first = self._sessions[0][1]
        terminal = console(is_file=self._out is not None)
        with terminal.capture() as captured:
            if self._is_single and not isinstance(first, RecordingError):
                terminal.print(session_table(first))
            else:
                terminal.print(sessions_table(self._sessions))
        write(captured.get(), self._out)


def _opened(document: bytes) -> tuple[str, Report | RecordingError]:
    """The file's or session's name and the report or error of a JSON document."""
    fields = orjson.loads(document)
    if fields["format"] == ERROR_FORMAT:
        return fields["file"], RecordingError(file=fields["file"], **fields["error"])
    return fields["session_id"], from_dict(fields)


def _documents(text: bytes, out: Path | None) -> list[Document]:
    """The documents in JSON text: one, or a list of them."""
    try:
        parsed = orjson.loads(text)
    except orjson.JSONDecodeError as error:
        raise _cannot_go_on(out, f"is no JSON ({error})") from error
    documents = parsed if isinstance(parsed, list) else [parsed]
    if not all(isinstance(document, dict) for document in documents):
        raise _cannot_go_on(out, "holds something else than reports")
    return documents


def _key(document: Document) -> Key:
    if document["format"] == ERROR_FORMAT:
        return "file", str(document["file"])
    return "session", str(document["session_id"])


def _csv_keys(lines: list[bytes], out: Path | None) -> list[Key]:
    from inhalemon.report.flat import csv_columns

    rows = csv.reader(line.decode(errors="replace") for line in lines)
    if next(rows, list(csv_columns())) != list(csv_columns()):
        raise _cannot_go_on(out, "has other columns")
    session, error = csv_columns().index("session_id"), csv_columns().index("error_code")
    # A cell that a spreadsheet would run as a formula was written with an apostrophe before it.
    return [("file" if row[error] else "session", row[session].removeprefix("'")) for row in rows]


def _refuse_others(kept: list[Document], versions: Versions, out: Path | None) -> None:
    """A file never mixes what was scored in different ways."""
    for document in kept:
        if document.get("format") not in (REPORT_FORMAT, ERROR_FORMAT):
            raise _cannot_go_on(out, "holds something else than reports")
        names = ("pipeline_version", "settings_digest", "rules_digest")
        if document["format"] == REPORT_FORMAT and tuple(document[name] for name in names) != versions:
            raise _cannot_go_on(out, "holds reports by another version, other settings or other rules")


def _refuse_foreign_half(half: bytes, start: bytes, out: Path | None) -> None:
    """Half a line is only ours to drop when it begins as ours do."""
    if not half.startswith(start[: len(half)]):
        raise _cannot_go_on(out, "ends in something else than a report")


def _cannot_go_on(out: Path | None, why: str) -> typer.BadParameter:
    return typer.BadParameter(f"{out} {why}; name another file, or remove it to score again", param_hint="--out")
