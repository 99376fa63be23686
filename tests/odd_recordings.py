"""More than a hundred small odd recording files, each with what must become of it."""

from __future__ import annotations

import gzip
import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import zstandard

N = 250  # rows a sensor: 2.5 s at 100 Hz, the body's on lines 2 to 251, the lever's on lines 252 to 501
NAMES = ["sensor", "time_s", *(f"acc_{a}_m_s2" for a in "xyz"), *(f"gyr_{a}_rad_s" for a in "xyz")]


@dataclass(frozen=True)
class Odd:
    """An odd file: accepted when `code` is `None`, else refused with it, on this line and column if given."""

    title: str
    data: bytes
    code: str | None = None
    line: int | None = None
    column: str | None = None
    name: str = "odd.csv"


def rows(
    n: int = N, *, rate_hz: float = 100.0, start_s: float = 0.0, lever_start_s: float | None = None
) -> list[list[str]]:
    """The header and the rows of both sensors, stacked."""
    rng = np.random.default_rng(5)
    table = [list(NAMES)]
    for sensor, first_s in (("body", start_s), ("lever", start_s if lever_start_s is None else lever_start_s)):
        for i in range(n):
            numbers = rng.normal(0.0, 3.0, 6)
            table.append([sensor, f"{first_s + i / rate_hz:.6f}", *(f"{value:.4f}" for value in numbers)])
    return table


def text(table: Iterable[Iterable[str]], *, end: str = "\n") -> bytes:
    return (end.join(",".join(row) for row in table) + end).encode()


def cell(line: int, column: str, value: str) -> bytes:
    """A good file with one cell changed."""
    table = rows()
    table[line - 1][NAMES.index(column)] = value
    return text(table)


def line_is(line: int, value: str) -> bytes:
    """A good file with one whole line replaced."""
    lines = text(rows()).decode().split("\n")
    lines[line - 1] = value
    return "\n".join(lines).encode()


def header_is(*names: str) -> bytes:
    return text([names, *rows()[1:]])


def renamed(**names: str) -> bytes:
    return header_is(*(names.get(name, name) for name in NAMES))


def reordered(order: Iterable[int]) -> bytes:
    return text([[row[i] for i in order] for row in rows()])


def mapped(change: Callable[[str], str], *, header: bool = False) -> bytes:
    """Every cell changed, the header's too if wanted."""
    table = rows()
    return text(
        [table[0] if not header else [change(c) for c in table[0]], *([change(c) for c in r] for r in table[1:])]
    )


def times(steps_s: np.ndarray) -> bytes:
    """Both sensors at the same times, with these steps from 0 on."""
    at = np.concatenate([[0.0], np.cumsum(steps_s)])
    table = rows(at.size)
    for i, row in enumerate(table[1:]):
        row[1] = f"{at[i % at.size]:.9f}"
    return text(table)


GOOD = text(rows())
INTERLEAVED = [rows()[0]] + [rows()[1 + sensor * N + i] for i in range(N) for sensor in (0, 1)]
ZIPPED = gzip.compress(GOOD, mtime=0)
ZSTD = zstandard.ZstdCompressor().compress(GOOD)
MAG = (["mag_x_ut", "mag_y_ut", "mag_z_ut"], ["20.1", "-3", "41"])
WITH_MAG = [[*row, *MAG[min(i, 1)]] for i, row in enumerate(rows())]
TWO_UNITS = [[*row, *(["acc_x_g", "acc_y_g", "acc_z_g"] if i == 0 else row[2:5])] for i, row in enumerate(rows())]


def _accepted() -> Iterable[Odd]:
    yield Odd("as the format says", GOOD)
    yield Odd("interleaved rows", text(INTERLEAVED))
    yield Odd("lever before body", text([rows()[0], *rows()[1 + N :], *rows()[1 : 1 + N]]))
    yield Odd("byte order mark", b"\xef\xbb\xbf" + GOOD)
    yield Odd("carriage returns", text(rows(), end="\r\n"))
    yield Odd("byte order mark and carriage returns", b"\xef\xbb\xbf" + text(rows(), end="\r\n"))
    yield Odd("no line end after the last row", GOOD.rstrip(b"\n"))
    yield Odd("one blank line at the end", GOOD + b"\n")
    yield Odd("many blank lines at the end", GOOD + b"\n" * 300_000)
    yield Odd("blank lines with carriage returns at the end", text(rows(), end="\r\n") + b"\r\n\r\n")
    yield Odd("columns reversed", reordered(range(7, -1, -1)))
    yield Odd("sensor last", reordered([1, 2, 3, 4, 5, 6, 7, 0]))
    yield Odd("sensor in the middle", reordered([1, 2, 3, 0, 4, 5, 6, 7]))
    yield Odd("swapped axes by name", reordered([0, 1, 4, 3, 2, 5, 6, 7]))
    yield Odd("all cells quoted", mapped(lambda c: f'"{c}"', header=True))
    yield Odd("only the header quoted", text([[f'"{c}"' for c in NAMES], *rows()[1:]]))
    yield Odd("only the sensor quoted", mapped(lambda c: f'"{c}"' if c.isalpha() else c))
    yield Odd("acceleration in g", renamed(acc_x_m_s2="acc_x_g", acc_y_m_s2="acc_y_g", acc_z_m_s2="acc_z_g"))
    in_degrees = {f"gyr_{axis}_rad_s": f"gyr_{axis}_deg_s" for axis in "xyz"}
    yield Odd("rates in degrees", renamed(**in_degrees))
    yield Odd("with a magnetometer", text(WITH_MAG))
    yield Odd("whole numbers", cell(9, "acc_x_m_s2", "7"))
    yield Odd("plus sign", cell(9, "acc_x_m_s2", "+1.5"))
    yield Odd("no digit before the point", cell(9, "acc_x_m_s2", "-.5"))
    yield Odd("no digit after the point", cell(9, "acc_x_m_s2", "5."))
    yield Odd("leading zeros", cell(9, "acc_x_m_s2", "007.5"))
    yield Odd("exponent", cell(9, "acc_x_m_s2", "1.5e-3"))
    yield Odd("capital exponent with sign", cell(9, "acc_x_m_s2", "1.5E+0"))
    yield Odd("minus zero", cell(9, "acc_x_m_s2", "-0.0"))
    yield Odd("too small for a double", cell(9, "acc_x_m_s2", "1e-999"))
    yield Odd("forty digits", cell(9, "acc_x_m_s2", "1." + "123456789" * 4))
    yield Odd("a whole number beyond 64 bits of digits", cell(9, "acc_x_m_s2", "0.00000000000000000000000000000001"))
    yield Odd("times slightly negative", text(rows(start_s=-0.05)))
    yield Odd("clocks apart", text(rows(lever_start_s=0.02)))
    yield Odd("clocks with another zero", text(rows(lever_start_s=1000.0)))
    yield Odd("seconds since 1970", text(rows(start_s=1.7e9)))
    yield Odd("a missing row", text([r for i, r in enumerate(rows()) if i != 77]))
    yield Odd("a gap of a second", times(np.where(np.arange(249) == 100, 1.0, 0.01)))
    yield Odd("jittering times", times(0.01 + 0.004 * np.sin(np.arange(249) * 1.7)))
    yield Odd("25 Hz", text(rows(60, rate_hz=25.0)))
    yield Odd("1000 Hz", text(rows(2100, rate_hz=1000.0)))
    yield Odd("exactly 2 s", text(rows(200)))
    yield Odd("gzip", ZIPPED, name="odd.csv.gz")
    yield Odd("gzip in two members", gzip.compress(GOOD[:5000]) + gzip.compress(GOOD[5000:]), name="odd.csv.gz")
    yield Odd("zstd", ZSTD, name="odd.csv.zst")
    parts = zstandard.ZstdCompressor().compress(GOOD[:5000]) + zstandard.ZstdCompressor().compress(GOOD[5000:])
    yield Odd("zstd in two frames", parts, name="odd.csv.zst")
    yield Odd("capital suffix", GOOD, name="ODD.CSV")
    yield Odd("gzip without a telling name", ZIPPED, name="-")


def _wrong_header() -> Iterable[Odd]:
    yield Odd("no header", text(rows()[1:]), "wrong_header", 1, "body")
    yield Odd("a second header", line_is(100, ",".join(NAMES)), "unknown_sensor", 100, "sensor")
    yield Odd("unknown column", text([[*r, "x"] for r in rows()]), "wrong_header", 1, "x")
    yield Odd("empty column name", text([[*r, ""] for r in rows()]), "wrong_header", 1)
    yield Odd("column twice", text([[*r, r[1]] for r in rows()]), "wrong_header", 1, "time_s")
    yield Odd("column missing", reordered([0, 1, 2, 3, 4, 5, 6]), "wrong_header", 1, "gyr_z_rad_s")
    yield Odd("no gyroscope", reordered([0, 1, 2, 3, 4]), "wrong_header", 1, "gyr_x")
    yield Odd("no accelerometer", reordered([0, 1, 5, 6, 7]), "wrong_header", 1, "acc_x")
    yield Odd("no sensor column", reordered([1, 2, 3, 4, 5, 6, 7]), "wrong_header", 1, "sensor")
    yield Odd("no time column", reordered([0, 2, 3, 4, 5, 6, 7]), "wrong_header", 1, "time_s")
    yield Odd("mixed units of one quantity", renamed(acc_z_m_s2="acc_z_g"), "wrong_header", 1)
    yield Odd("both units of one quantity", text(TWO_UNITS), "wrong_header", 1, "acc_x_g")
    yield Odd("half a magnetometer", text([r[:9] for r in WITH_MAG]), "wrong_header", 1, "mag_y_ut")
    yield Odd("no unit in the name", renamed(acc_x_m_s2="acc_x"), "wrong_header", 1)
    yield Odd("time in milliseconds", renamed(time_s="time_ms"), "wrong_header", 1, "time_ms")
    yield Odd("capital names", text([[c.upper() for c in NAMES], *rows()[1:]]), "wrong_header", 1, "SENSOR")
    yield Odd("space in a name", renamed(time_s=" time_s"), "wrong_header", 1)
    yield Odd("semicolons", GOOD.replace(b",", b";"), "wrong_header", 1)
    yield Odd("tabs", GOOD.replace(b",", b"\t"), "wrong_header", 1)
    yield Odd("a comment first", b"# exported by hand\n" + GOOD, "wrong_header", 1)
    yield Odd("a blank line first", b"\n" + GOOD, "wrong_header", 1, "column 1")
    yield Odd("ten million columns", b"a," * 10_000_000, "wrong_header", 1, "header")
    yield Odd("five thousand columns", (",".join(f"c{i}" for i in range(5000)) + "\n").encode(), "wrong_header", 1)
    yield Odd("old Mac line ends", text(rows(), end="\r"), "wrong_header", 1)


def _wrong_cells() -> Iterable[Odd]:
    for value, code in (
        ("nan", "not_finite"),
        ("NaN", "not_finite"),
        ("inf", "not_finite"),
        ("-Infinity", "not_finite"),
        ("1.#INF", "not_finite"),
        ("1e999", "not_finite"),
        ("1e308", "out_of_range"),
        ("123456", "out_of_range"),
        ("", "not_a_number"),
        ("n/a", "not_a_number"),
        ("null", "not_a_number"),
        ("true", "not_a_number"),
        ("body", "not_a_number"),
        ("[1]", "not_a_number"),
        ('""', "not_a_number"),
        ("0x10", "not_a_number"),
        ("1_000", "not_a_number"),
        ("1.5.2", "not_a_number"),
        ("--1", "not_a_number"),
        ("1e", "not_a_number"),
        ("-", "not_a_number"),
        (".", "not_a_number"),
        (" 1.0", "not_a_number"),
        ("1.0 ", "not_a_number"),
        ("1;0", "not_a_number"),
        ("\u0661\u0662", "not_a_number"),
        ("\u2212 1", "not_a_number"),
        ('"1.0', "not_a_number"),
        ('1"0', "not_a_number"),
        ("=1+1", "not_a_number"),
    ):
        yield Odd(f"a cell is {value!r}", cell(137, "gyr_y_rad_s", value), code, 137, "gyr_y_rad_s")
    yield Odd("a text in the very last cell", cell(501, "gyr_z_rad_s", "x"), "not_a_number", 501, "gyr_z_rad_s")
    yield Odd("a time is not finite", cell(30, "time_s", "nan"), "not_finite", 30, "time_s")
    yield Odd("a time is 1e308", cell(30, "time_s", "1e308"), "out_of_range", 30, "time_s")
    yield Odd("milliseconds since 1970", text(rows(start_s=1.7e12, rate_hz=0.1)), "out_of_range", 2, "time_s")
    yield Odd("decimal commas", mapped(lambda c: c.replace(".", ",")), "wrong_cell_count", 2)
    yield Odd("quoted decimal comma", cell(8, "acc_x_m_s2", '"1,5"'), "wrong_cell_count", 8)
    yield Odd("a cell too many", line_is(44, "body,0.42,1,2,3,4,5,6,7"), "wrong_cell_count", 44)
    yield Odd("a cell too few", line_is(44, "body,0.42,1,2,3,4,5"), "wrong_cell_count", 44)
    moved = line_is(44, "body,0.42,1,2,3,4,5").replace(b"\nbody,0.43", b"\n9,body,0.43")
    yield Odd("cells that move to the next line", moved, "wrong_cell_count", 44)
    yield Odd("the last row cut", GOOD[:-20], "wrong_cell_count", 501)
    yield Odd("a comma at each line's end", GOOD.replace(b"\n", b",\n"), "wrong_header", 1)
    yield Odd("a blank line within", line_is(250, ""), "blank_line", 250)
    yield Odd("a line of blanks within", line_is(250, "  \t"), "blank_line", 250)
    yield Odd("a line of commas at the end", GOOD + b",,,,,,,\n", "unknown_sensor", 502, "sensor")
    yield Odd("rows after blank lines", GOOD + b"\n\n" + text(rows()[1:3]), "blank_line", 502)
    yield Odd("an endless line", GOOD + b"body," + b"1" * 10_000_000, "line_too_long", 502)
    yield Odd("a long line within", line_is(60, "body,0.58,1,2,3,4,5," + "1" * 5000), "line_too_long", 60)
    yield Odd("a sensor without a name", cell(12, "sensor", ""), "unknown_sensor", 12, "sensor")
    yield Odd("a third sensor", cell(12, "sensor", "wrist"), "unknown_sensor", 12, "sensor")
    yield Odd("a capital sensor", cell(12, "sensor", "Body"), "unknown_sensor", 12, "sensor")
    yield Odd("a longer sensor", cell(12, "sensor", "bodyx"), "unknown_sensor", 12, "sensor")
    yield Odd("a sensor by number", cell(12, "sensor", "0"), "unknown_sensor", 12, "sensor")
    yield Odd("lever with a decimal", cell(300, "sensor", "lever.0"), "unknown_sensor", 300, "sensor")


def _wrong_bytes() -> Iterable[Odd]:
    yield Odd("empty", b"", "empty")
    yield Odd("only blank lines", b"\n\r\n\n", "empty")
    yield Odd("only a byte order mark", b"\xef\xbb\xbf", "empty")
    yield Odd("header only", text(rows()[:1]), "empty")
    yield Odd("header only, without a line end", text(rows()[:1]).strip(), "empty")
    yield Odd("a Latin-1 byte in the header", GOOD.replace(b"acc_x", b"acc_\xe4", 1), "not_utf8", 1)
    latin = line_is(99, "body,0.9777,1,2,3,4,5,6").replace(b"0.9777", b"0.97\xb7")
    yield Odd("a Latin-1 byte in a row", latin, "not_utf8", 99, "byte 10")
    yield Odd("UTF-16", GOOD.decode().encode("utf-16"), "not_text", 1)
    yield Odd("binary", struct.pack("<200f", *range(200)), "not_text", 1)
    yield Odd("a NUL in a row", cell(61, "acc_y_m_s2", "1\0"), "not_text", 61)
    yield Odd("a picture", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "not_utf8", 1)
    yield Odd("JSON", b'{"format": "inhalemon-recording/1"}', "wrong_header", 1)
    yield Odd("a page", b"<!DOCTYPE html>\n<html></html>\n", "wrong_header", 1)
    yield Odd("truncated gzip", ZIPPED[: len(ZIPPED) // 2], "bad_compression", name="odd.csv.gz")
    yield Odd("gzip without its checksum", ZIPPED[:-8], "bad_compression", name="odd.csv.gz")
    damaged = ZIPPED[:2000] + bytes([ZIPPED[2000] ^ 255]) + ZIPPED[2001:]
    yield Odd("damaged gzip", damaged, "bad_compression", name="odd.csv.gz")
    yield Odd("gzip with rubbish behind", ZIPPED + b"rubbish", "bad_compression", name="odd.csv.gz")
    yield Odd("truncated zstd", ZSTD[: len(ZSTD) // 2], "bad_compression", name="odd.csv.zst")
    yield Odd("damaged zstd", ZSTD[:9] + b"\xff\xff\xff\xff" + ZSTD[13:], "bad_compression", name="odd.csv.zst")
    yield Odd("plain text called gzip", GOOD, "wrong_file_type", name="odd.csv.gz")
    yield Odd("gzip called plain", ZIPPED, "wrong_file_type", name="odd.csv")
    yield Odd("text called Parquet", GOOD, "wrong_file_type", name="odd.parquet")
    yield Odd("broken Parquet", b"PAR1" + b"\0" * 100 + b"PAR1", "bad_parquet", name="odd.parquet")
    yield Odd("nothing called Parquet", b"", "bad_parquet", name="odd.parquet")
    yield Odd("nothing called gzip", b"", "empty", name="odd.csv.gz")


def _wrong_times() -> Iterable[Odd]:
    yield Odd("time backwards", cell(40, "time_s", "0.360000"), "time_not_increasing", 40, "time_s")
    yield Odd("equal times", cell(40, "time_s", "0.370000"), "time_not_increasing", 40, "time_s")
    yield Odd("equal times of the lever", cell(300, "time_s", "0.470000"), "time_not_increasing", 300, "time_s")
    twice = [*INTERLEAVED[:101], INTERLEAVED[99], *INTERLEAVED[101:]]
    yield Odd("a row again, interleaved", text(twice), "time_not_increasing", 102, "time_s")
    yield Odd("rows twice", text(rows() + rows()[1:]), "time_not_increasing", 502, "time_s")
    yield Odd("rows in reverse", text([rows()[0], *reversed(rows()[1:])]), "time_not_increasing", 3, "time_s")
    yield Odd("one sensor", text(rows()[: 1 + N]), "sensor_missing", None, "sensor")
    yield Odd("the other sensor alone", text([rows()[0], *rows()[1 + N :]]), "sensor_missing", None, "sensor")
    yield Odd("one row of the lever", text(rows()[: 2 + N]), "too_short", None, "time_s")
    yield Odd("one row of each", text([rows()[0], rows()[1], rows()[1 + N]]), "too_short")
    yield Odd("under 2 s", text(rows(190)), "too_short", None, "time_s")
    yield Odd("over 1 h", times(np.append(np.full(4000, 0.01), 3600.0)), "too_long", None, "time_s")
    yield Odd("10 Hz", text(rows(50, rate_hz=10.0)), "rate_out_of_range", None, "time_s")
    yield Odd("24 Hz", text(rows(100, rate_hz=24.0)), "rate_out_of_range", None, "time_s")
    yield Odd("2000 Hz", text(rows(4100, rate_hz=2000.0)), "rate_out_of_range", None, "time_s")
    yield Odd("milliseconds as seconds", text(rows(rate_hz=0.1)), "rate_out_of_range", None, "time_s")


ODD_FILES = [*_accepted(), *_wrong_header(), *_wrong_cells(), *_wrong_bytes(), *_wrong_times()]
