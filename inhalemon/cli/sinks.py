"""Where the outcomes of `inhalemon score` go, in each format; and what a file already holds from an earlier run."""

from __future__ import annotations

import csv
import os
import sys
from collections.abc import Container, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import orjson
import typer

from inhalemon.cli.options import Form
from inhalemon.cli.output import check_writable, console, write, write_whole
from inhalemon.exceptions import RecordingError
from inhalemon.formats import ERROR_FORMAT, REPORT_FORMAT
from inhalemon.report import from_dict
from inhalemon.report.documents import Document

if TYPE_CHECKING:
    from inhalemon.values import Report

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


def sink_of(
    form: Form, out: Path | None, versions: Versions, asked: Container[str], *, is_single: bool
) -> tuple[Sink, list[str]]:
    """The sink, and the ids of the sessions whose reports the file `out` holds already.

    What it holds of the files `asked` for is an error from an earlier run, or a report: errors are dropped, since the
    file may be mended by now. `is_single` makes JSON one document instead of a list, and the table a full one. Only
    JSONL and CSV grow as the batch goes on, so only they outlive a kill; JSON is taken up again when it is whole, a
    table never. Raises `OSError` when the file cannot be written.
    """
    if form in {"jsonl", "csv"}:
        lines = _Lines(out)
        header, earlier = _csv_rows(lines, out) if form == "csv" else (b"", _json_lines(lines, out))
    else:
        lines, header = None, b""
        if out is not None:
            check_writable(out)
        earlier = _json_list(out) if form == "json" and out is not None and out.exists() else []
    if any(each.versions not in (None, versions) for each in earlier):
        raise _cannot_go_on(out, "holds reports by another version, other settings or other rules")
    kept = [each for each in earlier if each.versions is not None or each.name not in asked]
    sessions = [each.name for each in kept if each.versions is not None]
    if lines is None:
        whole = [orjson.loads(each.text) for each in kept]
        return Json(out, whole, is_single=is_single) if form == "json" else Table(out, is_single=is_single), sessions
    if len(kept) < len(earlier):
        lines.rewrite(header + b"".join(each.text for each in kept))
    return Csv(lines, has_header=bool(header)) if form == "csv" else JsonLines(lines), sessions


@dataclass(frozen=True, slots=True)
class _Earlier:
    """What a file holds of one recording from an earlier run."""

    name: str  # the session's id, or the file's name when it could not be used
    versions: Versions | None  # None: an error
    text: bytes


class _Lines:
    """Lines added one at a time to standard output or to a file; half a line left by a kill goes when one is added."""

    def __init__(self, out: Path | None) -> None:
        self.found: list[bytes] = []
        self.half = b""
        self._out = out
        self._handle: int | None = None
        if out is not None:
            self._open(out)

    def _open(self, out: Path) -> None:
        self._handle = os.open(out, os.O_RDWR | os.O_CREAT, 0o666)
        with open(self._handle, "rb", closefd=False) as file:
            self.found = file.readlines()
        if self.found and not self.found[-1].endswith(b"\n"):
            self.half = self.found.pop()
        os.lseek(self._handle, sum(map(len, self.found)), os.SEEK_SET)

    def rewrite(self, text: bytes) -> None:
        """The file with this text alone, in one step."""
        if self._out is not None and self._handle is not None:
            os.close(self._handle)
            write_whole(text, self._out)
            self.half = b""
            self._open(self._out)

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
    def __init__(self, lines: _Lines, *, has_header: bool) -> None:
        self._lines = lines
        self._has_header = has_header

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


def _json_lines(lines: _Lines, out: Path | None) -> list[_Earlier]:
    _refuse_foreign_half(lines.half, _JSON_START, out)
    return [_of_document(_parsed(line, out), line, out) for line in lines.found]


def _json_list(out: Path) -> list[_Earlier]:
    """What JSON of one document or a list of them holds."""
    parsed = _parsed(out.read_bytes(), out)
    documents = parsed if isinstance(parsed, list) else [parsed]
    return [_of_document(document, orjson.dumps(document), out) for document in documents]


def _parsed(text: bytes, out: Path | None) -> Any:
    try:
        return orjson.loads(text)
    except orjson.JSONDecodeError as error:
        raise _cannot_go_on(out, f"is no JSON ({error})") from error


def _of_document(document: Any, text: bytes, out: Path | None) -> _Earlier:
    kind = document.get("format") if isinstance(document, dict) else None
    if kind == ERROR_FORMAT:
        return _Earlier(str(document.get("file")), None, text)
    if kind == REPORT_FORMAT:
        return _Earlier(str(document.get("session_id")), _versions(document), text)
    raise _cannot_go_on(out, "holds something else than reports")


def _csv_rows(lines: _Lines, out: Path | None) -> tuple[bytes, list[_Earlier]]:
    """The header's line, and what stands below."""
    from inhalemon.report.flat import csv_columns

    if not lines.found:
        _refuse_foreign_half(lines.half, _CSV_START, out)
        return b"", []
    rows = csv.DictReader(line.decode(errors="replace") for line in lines.found)
    if tuple(rows.fieldnames or ()) != csv_columns():
        raise _cannot_go_on(out, "has other columns")
    earlier, begin = [], rows.line_num
    header = b"".join(lines.found[:begin])
    for row in rows:
        # A cell that a spreadsheet would run as a formula was written with an apostrophe before it.
        name = row["session_id"].removeprefix("'")
        text = b"".join(lines.found[begin : rows.line_num])  # a cell may hold line breaks
        earlier.append(_Earlier(name, None if row["error_code"] else _versions(row), text))
        begin = rows.line_num
    return header, earlier


def _versions(found: Mapping[str, Any]) -> Versions:
    return str(found.get("pipeline_version")), str(found.get("settings_digest")), str(found.get("rules_digest"))


def _refuse_foreign_half(half: bytes, start: bytes, out: Path | None) -> None:
    """Half a line is only ours to drop when it begins as ours do."""
    if not half.startswith(start[: len(half)]):
        raise _cannot_go_on(out, "ends in something else than a report")


def _cannot_go_on(out: Path | None, why: str) -> typer.BadParameter:
    return typer.BadParameter(f"{out} {why}; name another file, or remove it to score again", param_hint="--out")
