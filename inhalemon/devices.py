"""Device profiles: where the hinge is, how far it travels, the order of steps. They are data, one TOML file each."""

from __future__ import annotations

import functools
import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Final

from inhalemon.exceptions import DeviceError
from inhalemon.values import DeviceKind, PhaseKind

_MAX_TRAVEL_DEG: Final = 180.0
_UNIT_TOLERANCE: Final = 1e-3  # an axis is written with a few digits


@dataclass(frozen=True, slots=True)
class Device:
    """One kind of inhaler as far as two inertial sensors are concerned.

    The hinge axis is in the body frame; the lever's or cover's angle times `hinge_sign` grows when it is used.
    `kind` is the manoeuvre that it is used with, and whose rules apply. `full_travel_rad` is `None` while the device is
    not calibrated. `steps` is the order that `order_violations` is counted against.
    """

    name: str
    title: str
    kind: DeviceKind
    moving_part: str
    hinge_axis: tuple[float, float, float]
    hinge_sign: int
    full_travel_rad: float | None
    full_fraction: float
    partial_fraction: float
    uncalibrated_full_rad: float
    uncalibrated_partial_rad: float
    steps: tuple[PhaseKind, ...]

    @property
    def is_calibrated(self) -> bool:
        return self.full_travel_rad is not None

    @property
    def full_stroke_rad(self) -> float:
        """The angle from which a press or an opening counts as full."""
        if self.full_travel_rad is None:
            return self.uncalibrated_full_rad
        return self.full_fraction * self.full_travel_rad

    @property
    def partial_stroke_rad(self) -> float:
        """The angle from which a press counts as partial, and below which a cover counts as shut."""
        if self.full_travel_rad is None:
            return self.uncalibrated_partial_rad
        return self.partial_fraction * self.full_travel_rad


@functools.cache
def device_names() -> tuple[str, ...]:
    """The names of the profiles that come with the package."""
    files = resources.files("inhalemon").joinpath("data/devices").iterdir()
    return tuple(sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml")))


def load_device(name_or_path: str | Path) -> Device:
    """The device profile of that name (`pmdi`, `ellipta`, `hinge`), or from a TOML file.

    Raises `DeviceError` naming the file, the field, what was found and what was wanted.
    """
    if str(name_or_path) in device_names():
        return _shipped(str(name_or_path))
    path = Path(name_or_path)
    if path.suffix != ".toml":
        wanted = f"one of {', '.join(device_names())}, or the path of a .toml profile"
        raise DeviceError(f"device is {str(name_or_path)!r}; expected {wanted}")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:  # not there, or not text
        raise DeviceError(f"{path}: {error}. Give a readable TOML file") from error
    return _device(path.stem, _parsed(text, str(path)), str(path))


@functools.cache
def _shipped(name: str) -> Device:
    text = resources.files("inhalemon").joinpath(f"data/devices/{name}.toml").read_text(encoding="utf-8")
    return _device(name, _parsed(text, f"device {name}"), f"device {name}")


def _parsed(text: str, where: str) -> dict[str, object]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # not TOML, a number without end, or nested without end
        raise DeviceError(f"{where}: {error}. Give a readable TOML file") from error


def _device(name: str, table: Mapping[str, object], where: str) -> Device:
    unknown = sorted(set(table) - set(_FIELDS))
    if unknown:
        raise DeviceError(f"{where}: {unknown[0]} is unknown; expected one of {', '.join(_FIELDS)}")
    values: dict[str, object] = {}
    for field, read in _FIELDS.items():
        if field not in table and field != "full_travel_deg":
            raise DeviceError(f"{where}: {field} is missing")
        try:
            values[field] = read(table.get(field))
        except ValueError as error:
            raise DeviceError(f"{where}: {field} is {table.get(field)!r}; expected {error}") from error
    device = Device(name, **{_INSIDE.get(field, field): value for field, value in values.items()})  # type: ignore[arg-type]  # each was checked by its reader
    if (
        device.partial_fraction >= device.full_fraction
        or device.uncalibrated_partial_rad >= device.uncalibrated_full_rad
    ):
        raise DeviceError(f"{where}: a partial stroke is not below a full one; expected partial < full")
    return device


def _text(found: object) -> str:
    if not isinstance(found, str) or not found.strip():
        raise ValueError("a text")
    return found


def _kind(found: object) -> DeviceKind:
    if not isinstance(found, str) or found not in tuple(DeviceKind):
        raise ValueError(f"one of {', '.join(DeviceKind)}")
    return DeviceKind(found)


def _number(found: object, low: float, high: float, wanted: str) -> float:
    if isinstance(found, bool) or not isinstance(found, int | float) or not low < found <= high:
        raise ValueError(wanted)
    return float(found)


def _angle_rad(found: object) -> float:
    return math.radians(_number(found, 0.0, _MAX_TRAVEL_DEG, f"degrees above 0, up to {_MAX_TRAVEL_DEG:g}"))


def _optional_angle_rad(found: object) -> float | None:
    return None if found is None else _angle_rad(found)


def _fraction(found: object) -> float:
    return _number(found, 0.0, 1.0, "a fraction above 0, up to 1")


def _axis(found: object) -> tuple[float, float, float]:
    wanted = "a unit vector of three numbers"
    if not isinstance(found, list) or len(found) != 3:
        raise ValueError(wanted)
    x, y, z = (_number(value, -1.0 - _UNIT_TOLERANCE, 1.0 + _UNIT_TOLERANCE, wanted) for value in found)
    length = math.hypot(x, y, z)
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise ValueError(wanted)
    return x / length, y / length, z / length


def _sign(found: object) -> int:
    if isinstance(found, bool) or found not in (-1, 1):
        raise ValueError("1 or -1")
    return 1 if found == 1 else -1


def _steps(found: object) -> tuple[PhaseKind, ...]:
    if not isinstance(found, list) or any(step not in tuple(PhaseKind) for step in found):
        raise ValueError(f"a list of {', '.join(PhaseKind)}")
    if len(set(found)) < len(found):
        raise ValueError("each step once")
    return tuple(PhaseKind(step) for step in found)


_FIELDS: Final[dict[str, Callable[[object], object]]] = {
    "title": _text,
    "kind": _kind,
    "moving_part": _text,
    "hinge_axis": _axis,
    "hinge_sign": _sign,
    "full_travel_deg": _optional_angle_rad,
    "full_fraction": _fraction,
    "partial_fraction": _fraction,
    "uncalibrated_full_deg": _angle_rad,
    "uncalibrated_partial_deg": _angle_rad,
    "steps": _steps,
}
_INSIDE: Final = {
    field: f"{field.removesuffix('_deg')}_rad"
    for field in ("full_travel_deg", "uncalibrated_full_deg", "uncalibrated_partial_deg")
}
