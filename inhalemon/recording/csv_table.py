"""The rows of a CSV recording as blocks of numbers.

Plain blocks go through a fast path: a compiled kernel or, where there is none or a number has too many digits for it,
one JSON array, which orjson reads at some 25 ns a number. Both round as `float` does. Whatever they do not know goes
row by row through the exact path, which either accepts an odd but legal form (quotes, `+1.0`, `.5`) or says what is
wrong and where.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import orjson
from numpy.typing import NDArray

from inhalemon.exceptions import RecordingError
from inhalemon.recording.layout import Columns, columns_from_names, shortened
from inhalemon.values import BoolArray, FloatArray, IntArray, SensorName

try:
    from inhalemon._csv_kernel import parse_rows

    IS_COMPILED = True
except ImportError:  # installed without a C compiler
    IS_COMPILED = False

ByteArray = NDArray[np.uint8]

_MAX_LINE_BYTES = 4096
_BOM = b"\xef\xbb\xbf"
_PLAIN_BYTES = b"0123456789+-.eE,\n" + b"bodylevr"
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_NOT_FINITE = re.compile(r"[+-]?(?:nan|inf|infinity|1\.#\w+)", re.IGNORECASE)
_COMMA, _NEWLINE = b",\n"
_BODY, _LEVER = (np.frombuffer(word, dtype=np.uint8) for word in (b"body,", b"lever"))
_BLANKED = np.frombuffer(b"0    ", dtype=np.uint8)


@dataclass(frozen=True, slots=True)
class RowBlock:
    """Rows that follow each other in the file; row `i` stands on line `first_line + i`."""

    is_lever: BoolArray  # (n,)
    values: FloatArray  # (n, columns) in the file's units; 0 in the sensor's column
    first_line: int


def read_rows(blocks: Iterator[bytes], *, file: str) -> Iterator[tuple[Columns, RowBlock]]:
    """The header's columns with each block of rows. Raises `RecordingError` for all that is not a recording."""
    lines = _whole_lines(blocks, file)
    header, first_rows = _split_header(lines, file)
    columns = columns_from_names(_header_names(header, file), file=file)
    line = 2
    blank_line: int | None = None
    for block in _after(first_rows, lines):
        rows = block.rstrip(b"\n")
        n_blank = len(block) - len(rows) - (1 if rows else 0)
        if rows:
            if blank_line is not None or rows.startswith(b"\n"):
                raise _blank(file, blank_line or line)
            found = _rows(rows, columns, line, file)
            yield columns, found
            line += len(found.values)
        if n_blank and blank_line is None:
            blank_line = line
        line += n_blank


def _whole_lines(blocks: Iterator[bytes], file: str) -> Iterator[bytes]:
    """Blocks cut after a line's end, CRLF made LF; the last line gets its line end if it had none."""
    rest = b""
    for block in blocks:
        joined = rest + block
        end = joined.rfind(b"\n") + 1
        rest = joined[end:]
        if end:
            whole = joined[:end]
            yield whole.replace(b"\r\n", b"\n") if b"\r" in whole else whole
        if len(rest) > _MAX_LINE_BYTES:  # too long to be a row: hand it on as one, to be refused
            break
    if rest:
        yield rest.removesuffix(b"\r") + b"\n"


def _split_header(lines: Iterator[bytes], file: str) -> tuple[bytes, bytes]:
    first = next(lines, b"").removeprefix(_BOM)
    if not first or first.isspace():
        raise RecordingError(
            "empty", file=file, found="an empty file", wanted="a header and rows", detail="Export the session again"
        )
    header, _, rows = first.partition(b"\n")
    return header, rows


def _header_names(header: bytes, file: str) -> tuple[str, ...]:
    _refuse_binary(header, 1, file)
    if len(header) > _MAX_LINE_BYTES:
        found = f"{header.count(b',') + 1} columns"
        raise RecordingError("wrong_header", file=file, line=1, column="header", found=found, wanted="8 or 11 columns")
    return tuple(_unquoted(name) for name in _decoded(header, 1, file).split(","))


def _after(first: bytes, rest: Iterator[bytes]) -> Iterator[bytes]:
    if first:
        yield first
    yield from rest


def _rows(block: bytes, columns: Columns, line: int, file: str) -> RowBlock:
    """Rows from a block that neither begins nor ends with a line end."""
    fast = _compiled_rows(block, columns) or _plain_rows(block, columns)
    rows = RowBlock(*fast, line) if fast is not None else _exact_rows(block, columns, line, file)
    rows.values[:] += 0.0  # no minus zero: JSON's -0 is a whole number and has no sign
    return rows


def _compiled_rows(block: bytes, columns: Columns) -> tuple[BoolArray, FloatArray] | None:
    """The same as `_plain_rows` by the compiled kernel, for numbers of up to 15 digits or so."""
    if not IS_COMPILED:
        return None
    text = block + b"\n"
    n_rows = int(np.count_nonzero(np.frombuffer(text, dtype=np.uint8) == _NEWLINE))  # a quarter of bytes.count's time
    # A row has at least two bytes a column: what comes here is no longer than a block, and so is what is made for it.
    if n_rows * 2 * len(columns.names) > len(text):
        return None
    values = np.empty((n_rows, len(columns.names)))
    is_lever = np.empty(n_rows, dtype=np.bool_)
    is_plain = parse_rows(text, columns.sensor, _MAX_LINE_BYTES, values, is_lever.view(np.uint8))
    return (is_lever, values) if is_plain else None


def _plain_rows(block: bytes, columns: Columns) -> tuple[BoolArray, FloatArray] | None:
    """Flags and numbers of a block of plain rows, or `None` when anything in it is not plain."""
    if block.translate(None, _PLAIN_BYTES):
        return None
    json = bytearray(b"[%b\n]" % block)
    text = np.frombuffer(json, dtype=np.uint8)
    separators = np.flatnonzero((text == _COMMA) | (text == _NEWLINE))
    if separators.size % len(columns.names):
        return None
    cell_ends = separators.reshape(-1, len(columns.names))
    is_lever = _sensor_cells(text, cell_ends, columns)
    if is_lever is None:
        return None
    # Names gone and line ends turned into commas, one array of numbers is left; blanks are JSON's to skip.
    text[cell_ends[:-1, -1]] = _COMMA
    text[cell_ends[-1, -1]] = _BLANKED[-1]
    try:
        values = np.array(orjson.loads(json), dtype=np.float64)
    except (orjson.JSONDecodeError, OverflowError):
        return None
    return is_lever, values.reshape(cell_ends.shape)


def _sensor_cells(text: ByteArray, cell_ends: IntArray, columns: Columns) -> BoolArray | None:
    """Which rows are the lever's, their names blanked in `text`; `None` when the rows are not laid out plainly."""
    line_ends = cell_ends[:, -1]
    kinds = text[cell_ends]
    is_laid_out = bool((kinds[:, -1] == _NEWLINE).all() and (kinds[:, :-1] == _COMMA).all())
    if not is_laid_out or np.diff(line_ends, prepend=0).max() > _MAX_LINE_BYTES:
        return None
    ends = cell_ends[:, columns.sensor]
    before = cell_ends[:, columns.sensor - 1] if columns.sensor else np.concatenate([[0], line_ends[:-1]])
    letters = before[:, None] + np.arange(1, 6)
    if letters[-1, -1] >= text.size:
        return None
    words = text[letters]
    is_lever: BoolArray = (words == _LEVER).all(axis=1)
    is_body = words[:, :4] == _BODY[:4]
    if not (is_lever | is_body.all(axis=1)).all() or (ends - before != 5 + is_lever).any():
        return None
    words[:, :4] = _BLANKED[:4]
    words[is_lever, 4] = _BLANKED[4]
    text[letters] = words
    return is_lever


def _exact_rows(block: bytes, columns: Columns, line: int, file: str) -> RowBlock:
    """The same, row by row, for legal forms that are not plain. Raises `RecordingError` with line and column."""
    is_lever: list[bool] = []
    values: list[list[float]] = []
    n_columns = len(columns.names)
    for at, row in enumerate(block.split(b"\n"), start=line):
        if not row.strip():
            raise _blank(file, at)
        _refuse_binary(row, at, file)
        if len(row) > _MAX_LINE_BYTES:
            raise RecordingError(
                "line_too_long",
                file=file,
                line=at,
                column="row",
                found=f"longer than {_MAX_LINE_BYTES} bytes",
                wanted=f"{n_columns} cells",
            )
        cells = [_unquoted(cell) for cell in _decoded(row, at, file).split(",")]
        if len(cells) != n_columns:
            raise RecordingError(
                "wrong_cell_count",
                file=file,
                line=at,
                column="row",
                found=f"{len(cells)} cells",
                wanted=f"{n_columns}, as in the header",
                detail="Write numbers with a decimal point, not a comma, and export whole rows",
            )
        sensor = cells[columns.sensor]
        if sensor not in (SensorName.BODY, SensorName.LEVER):
            raise unknown_sensor(sensor, at, file)
        is_lever.append(sensor == SensorName.LEVER)
        cells[columns.sensor] = "0"
        values.append([_number(cell, columns.names[i], at, file) for i, cell in enumerate(cells)])
    return RowBlock(np.array(is_lever), np.array(values, dtype=np.float64), line)


def _number(cell: str, column: str, line: int, file: str) -> float:
    if _NUMBER.fullmatch(cell):
        return float(cell)  # may overflow to infinity, which the checks refuse
    found = repr(shortened(cell)) if cell else "empty"
    if _NOT_FINITE.fullmatch(cell):
        raise not_finite(column, found, line, file)
    detail = "Export the session again with raw samples"
    if '"' in cell:
        detail = "Quote a whole cell or nothing"
    elif cell != cell.strip():
        detail = "Take out the spaces"
    raise RecordingError(
        "not_a_number", file=file, line=line, column=column, found=found, wanted="a number", detail=detail
    )


def not_finite(column: str, found: str, line: int, file: str) -> RecordingError:
    return RecordingError(
        "not_finite",
        file=file,
        line=line,
        column=column,
        found=found,
        wanted="a finite number",
        detail="Export the session again with raw samples, and leave out rows that are missing",
    )


def unknown_sensor(found: str, line: int, file: str) -> RecordingError:
    shown = repr(shortened(found)) if found else "empty"
    return RecordingError("unknown_sensor", file=file, line=line, column="sensor", found=shown, wanted="body or lever")


def _unquoted(cell: str) -> str:
    """A cell without plain quotes around it; quotes inside stay, and are refused later."""
    if len(cell) >= 2 and cell[0] == cell[-1] == '"':
        return cell[1:-1]
    return cell


def _decoded(row: bytes, line: int, file: str) -> str:
    try:
        return row.decode("utf-8")
    except UnicodeDecodeError as error:
        raise RecordingError(
            "not_utf8",
            file=file,
            line=line,
            column=f"byte {error.start + 1}",
            found=f"0x{row[error.start]:02x}",
            wanted="UTF-8 text",
            detail="Save the file as UTF-8",
        ) from error


def _refuse_binary(row: bytes, line: int, file: str) -> None:
    if b"\0" in row:
        raise RecordingError(
            "not_text",
            file=file,
            line=line,
            column="line",
            found="binary data",
            wanted="UTF-8 text",
            detail="Give a CSV or Parquet recording; UTF-16 text must be saved as UTF-8",
        )


def _blank(file: str, line: int) -> RecordingError:
    return RecordingError(
        "blank_line", file=file, line=line, column="row", found="blank", wanted="a row (only the end may be blank)"
    )
