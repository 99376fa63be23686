"""What stands beside the samples: device, session, patient's pseudonym, the sensors' ranges and mounting."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import orjson

from inhalemon.exceptions import RecordingError
from inhalemon.formats import RECORDING_FORMAT
from inhalemon.limits import INSTANT_WANTED, TEXT_WANTED, is_instant, is_plain_text
from inhalemon.recording.layout import shortened
from inhalemon.values import STANDARD_GRAVITY_M_S2, DeviceKind, ImuTrack, Recording, SensorInfo, SensorName

MAX_SIDECAR_BYTES = 2**20
_QUATERNION_TOLERANCE = 0.01


@dataclass(frozen=True, slots=True)
class SensorEntry:
    """What a sidecar says of one sensor; the ranges go to its track, the rest to the recording."""

    info: SensorInfo = field(default_factory=SensorInfo)
    acc_range_m_s2: float | None = None
    gyr_range_rad_s: float | None = None


@dataclass(frozen=True, slots=True)
class Sidecar:
    """The fields of a recording that are not samples; all may be missing."""

    session_id: str | None = None
    device: DeviceKind | None = None
    recorded_at: str | None = None
    patient_ref: str | None = None
    sensors: Mapping[SensorName, SensorEntry] = field(default_factory=lambda: MappingProxyType({}))


def sidecar_from_json(text: bytes | str, *, file: str) -> Sidecar:
    """The sidecar in JSON text. Raises `RecordingError` (`bad_sidecar`) naming the field."""
    try:
        raw = text.encode() if isinstance(text, str) else text
        parsed = orjson.loads(raw.removeprefix(b"\xef\xbb\xbf"))
    except (orjson.JSONDecodeError, UnicodeEncodeError) as error:
        line = getattr(error, "lineno", None)
        raise RecordingError(
            "bad_sidecar", file=file, line=line, column="sidecar", found="not JSON", wanted="a JSON object"
        ) from error
    if isinstance(parsed, dict) and "format" not in parsed:
        raise _wrong(file, "format", "missing", f"'{RECORDING_FORMAT}'")
    return sidecar_from_mapping(parsed, file=file)


def sidecar_from_mapping(fields: object, *, file: str) -> Sidecar:
    """The sidecar in a parsed JSON object, where `format` may be left out. Raises `RecordingError` (`bad_sidecar`).

    Unknown fields are left alone, but not among the sensors: a misspelt mounting would turn every angle in silence.
    """
    if not isinstance(fields, Mapping):
        raise _wrong(file, "sidecar", _shown(fields), "a JSON object")
    if fields.get("format", RECORDING_FORMAT) != RECORDING_FORMAT:
        raise _wrong(file, "format", _shown(fields["format"]), f"'{RECORDING_FORMAT}'")
    return Sidecar(
        session_id=_text(fields, "session_id", file),
        device=_device(fields, file),
        recorded_at=_instant(fields, file),
        patient_ref=_text(fields, "patient_ref", file),
        sensors=_sensors(fields, file),
    )


def sidecar_to_mapping(recording: Recording) -> dict[str, object]:
    """The sidecar of a recording, ready for JSON; what is unknown is left out."""
    fields: dict[str, object] = {
        "format": RECORDING_FORMAT,
        "session_id": recording.session_id,
        "device": str(recording.device),
        "recorded_at": recording.recorded_at,
        "patient_ref": recording.patient_ref,
    }
    sensors: dict[str, dict[str, object]] = {}
    for name in SensorName:
        track: ImuTrack = getattr(recording, name)
        info = recording.sensors.get(name, SensorInfo())
        entry: dict[str, object] = {
            "model": info.model,
            "acc_range_g": _in_unit(track.acc_range_m_s2, STANDARD_GRAVITY_M_S2),
            "gyr_range_deg_s": _in_unit(track.gyr_range_rad_s, math.radians(1.0)),
            f"q_{name}_chip": list(info.q_chip) if info.q_chip is not None else None,
        }
        known = {key: value for key, value in entry.items() if value is not None}
        if known:
            sensors[str(name)] = known
    if sensors:
        fields["sensors"] = sensors
    return {key: value for key, value in fields.items() if value is not None}


def _in_unit(value: float | None, unit: float) -> float | None:
    """A range as its maker tells it: 16 g stays 16."""
    return None if value is None else float(f"{value / unit:.9g}")


def _sensors(fields: Mapping[str, object], file: str) -> Mapping[SensorName, SensorEntry]:
    given = fields.get("sensors")
    if given is None:
        return MappingProxyType({})
    if not isinstance(given, Mapping):
        raise _wrong(file, "sensors", _shown(given), "an object with body and lever")
    sensors: dict[SensorName, SensorEntry] = {}
    for key, entry in given.items():
        if key not in (SensorName.BODY, SensorName.LEVER):
            raise _wrong(file, f"sensors.{shortened(str(key))}", "unknown", "body or lever")
        if not isinstance(entry, Mapping):
            raise _wrong(file, f"sensors.{key}", _shown(entry), "an object")
        name = SensorName(key)
        sensors[name] = _sensor(entry, name, file)
    return MappingProxyType(sensors)


def _sensor(entry: Mapping[str, object], name: SensorName, file: str) -> SensorEntry:
    where = f"sensors.{name}"
    known = ("model", "acc_range_g", "gyr_range_deg_s", f"q_{name}_chip")
    for key in entry:
        if key not in known:
            raise _wrong(file, f"{where}.{shortened(str(key))}", "unknown", f"one of {', '.join(known)}")
    return SensorEntry(
        info=SensorInfo(
            model=_text(entry, "model", file, where=f"{where}."),
            q_chip=_quaternion(entry, f"q_{name}_chip", file, where),
        ),
        acc_range_m_s2=_positive(entry, "acc_range_g", file, where, unit=STANDARD_GRAVITY_M_S2),
        gyr_range_rad_s=_positive(entry, "gyr_range_deg_s", file, where, unit=math.radians(1.0)),
    )


def _text(fields: Mapping[str, object], key: str, file: str, *, where: str = "") -> str | None:
    value = fields.get(key)
    if value is None:
        return None
    if not is_plain_text(value):
        raise _wrong(file, where + key, _shown(value), TEXT_WANTED)
    return str(value)


def _device(fields: Mapping[str, object], file: str) -> DeviceKind | None:
    value = fields.get("device")
    if value is None:
        return None
    if not isinstance(value, str) or value not in tuple(DeviceKind):
        raise _wrong(file, "device", _shown(value), ", ".join(DeviceKind))
    return DeviceKind(value)


def _instant(fields: Mapping[str, object], file: str) -> str | None:
    value = fields.get("recorded_at")
    if value is None:
        return None
    if not is_instant(value):
        raise _wrong(file, "recorded_at", _shown(value), INSTANT_WANTED)
    return str(value)


def _positive(entry: Mapping[str, object], key: str, file: str, where: str, *, unit: float) -> float | None:
    """The range in SI units."""
    value = entry.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise _wrong(file, f"{where}.{key}", _shown(value), "a positive number")
    return float(value) * unit


def _quaternion(
    entry: Mapping[str, object], key: str, file: str, where: str
) -> tuple[float, float, float, float] | None:
    value = entry.get(key)
    if value is None:
        return None
    wanted = "a unit quaternion [w, x, y, z]"
    if not isinstance(value, list | tuple) or len(value) != 4:
        raise _wrong(file, f"{where}.{key}", _shown(value), wanted)
    if not all(isinstance(part, int | float) and not isinstance(part, bool) for part in value):
        raise _wrong(file, f"{where}.{key}", _shown(value), wanted)
    length = math.hypot(*value)
    if not abs(length - 1.0) <= _QUATERNION_TOLERANCE:
        raise _wrong(file, f"{where}.{key}", f"of length {length:.4g}", wanted)
    w, x, y, z = (float(part) / length for part in value)
    return (w, x, y, z)


def _shown(value: object) -> str:
    return shortened(repr(value))


def _wrong(file: str, field_name: str, found: str, wanted: str) -> RecordingError:
    return RecordingError("bad_sidecar", file=file, column=field_name, found=found, wanted=wanted)
