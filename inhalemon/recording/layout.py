"""What the recording file, version 1, looks like: its columns, units and limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import PurePath

from inhalemon.exceptions import RecordingError
from inhalemon.limits import MAX_TEXT
from inhalemon.values import STANDARD_GRAVITY_M_S2

PARQUET_KEY = b"inhalemon"

MAX_UNPACKED_BYTES = 512 * 2**20

# Beyond what any such sensor can say (1000 g, 19 turns a second times ten, a strong magnet): a broken export.
MAX_ACC_M_S2 = 1000 * STANDARD_GRAVITY_M_S2
MAX_GYR_RAD_S = 1200.0
MAX_MAG_UT = 1e6
# Seconds since 1970 pass; milliseconds since 1970 do not.
MAX_TIME_S = 1e10

# How the end of a file's name tells what is inside.
COMPRESSION_OF = {".csv": "plain", ".csv.gz": "gzip", ".csv.zst": "zstd", ".parquet": "parquet"}

_UNITS = {  # quantity -> unit -> (factor to SI, largest value in SI)
    "acc": {"m_s2": (1.0, MAX_ACC_M_S2), "g": (STANDARD_GRAVITY_M_S2, MAX_ACC_M_S2)},
    "gyr": {"rad_s": (1.0, MAX_GYR_RAD_S), "deg_s": (math.pi / 180, MAX_GYR_RAD_S)},
    "mag": {"ut": (1.0, MAX_MAG_UT)},
}
_HEADER_WANTED = (
    "sensor, time_s, acc_x/y/z_m_s2 (or _g), gyr_x/y/z_rad_s (or _deg_s) and, if there is one, mag_x/y/z_ut"
)


@dataclass(frozen=True, slots=True)
class Columns:
    """Where each quantity stands in a table: `names` in the file's order, the rest as positions among them."""

    names: tuple[str, ...]
    sensor: int
    time: int
    acc: tuple[int, ...]
    gyr: tuple[int, ...]
    mag: tuple[int, ...]  # empty without a magnetometer
    acc_factor: float
    gyr_factor: float

    @property
    def largest(self) -> tuple[float, ...]:
        """The largest magnitude allowed in each column, in the column's own unit; the sensor's name counts as 0."""
        limits = [0.0] * len(self.names)
        limits[self.time] = MAX_TIME_S
        for position in self.acc:
            limits[position] = MAX_ACC_M_S2 / self.acc_factor
        for position in self.gyr:
            limits[position] = MAX_GYR_RAD_S / self.gyr_factor
        for position in self.mag:
            limits[position] = MAX_MAG_UT
        return tuple(limits)


def columns_from_names(names: tuple[str, ...], *, file: str) -> Columns:
    """The meaning of a header; the order of columns is free. Raises `RecordingError` (`wrong_header`)."""

    def refuse(column: str, found: str, detail: str) -> RecordingError:
        return RecordingError(
            "wrong_header", file=file, line=1, column=column, found=found, wanted=_HEADER_WANTED, detail=detail
        )

    units: dict[str, str] = {}
    known = {"sensor", "time_s"}
    for quantity, choices in _UNITS.items():
        for unit in choices:
            triple = [f"{quantity}_{axis}_{unit}" for axis in "xyz"]
            present = [name for name in triple if name in names]
            if not present:
                continue
            if quantity in units:
                raise refuse(present[0], "a second unit for the same quantity", f"Keep one unit for {quantity}")
            if len(present) < len(triple):
                missing = next(name for name in triple if name not in names)
                raise refuse(missing, "missing", f"Give all three axes of {quantity} in one unit")
            units[quantity] = unit
            known.update(triple)
    for position, name in enumerate(names):
        if name not in known:
            found = "an empty name" if not name.strip() else "an unknown column"
            raise refuse(
                shortened(name).strip() or f"column {position + 1}", found, "Leave out what the format does not name"
            )
        if name in names[:position]:
            raise refuse(name, "there twice", "Keep one")
    for wanted in ("sensor", "time_s"):
        if wanted not in names:
            raise refuse(wanted, "missing", "The first row names the columns")
    for quantity in ("acc", "gyr"):
        if quantity not in units:
            raise refuse(f"{quantity}_x", "missing", "The first row names the columns, unit included")

    def triple_of(quantity: str) -> tuple[int, ...]:
        unit = units.get(quantity)
        return tuple(names.index(f"{quantity}_{axis}_{unit}") for axis in "xyz") if unit else ()

    return Columns(
        names=names,
        sensor=names.index("sensor"),
        time=names.index("time_s"),
        acc=triple_of("acc"),
        gyr=triple_of("gyr"),
        mag=triple_of("mag"),
        acc_factor=_UNITS["acc"][units["acc"]][0],
        gyr_factor=_UNITS["gyr"][units["gyr"]][0],
    )


def suffix_of(name: str) -> str | None:
    """The recording suffix that ends a file's name (`.csv`, `.csv.gz`, ...), lower case; `None` for any other name."""
    lower = PurePath(name).name.lower()
    return next((suffix for suffix in COMPRESSION_OF if lower.endswith(suffix)), None)


def stem_of(name: str) -> str:
    """A file's name without its folder and its recording suffix: `a/b.v2.csv.gz` gives `b.v2`."""
    base = PurePath(name).name
    suffix = suffix_of(base)
    return base[: -len(suffix)] if suffix else PurePath(base).stem


def session_of(name: str) -> str:
    """The session id that a file's name gives: its stem, as far as a session id may be so."""
    return shortened(stem_of(name), MAX_TEXT - 3).strip() or "session"


def shortened(text: str, most: int = 40) -> str:
    """Text short enough for a message, without control characters."""
    printable = text if text.isprintable() else text.encode("unicode_escape").decode()
    return printable if len(printable) <= most else printable[:most] + "..."
