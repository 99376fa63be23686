"""What flows between the stages: frozen values, SI units and radians.

Degrees appear only in the report's parts (`Event.angle_deg`, measures named `..._deg`), because a person reads them.
Arrays have time as their first axis; frames and quaternions follow `rotation.py`.
"""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from inhalemon import limits
from inhalemon.exceptions import RecordingError

STANDARD_GRAVITY_M_S2: Final = 9.80665
TWO_SIDED_95: Final = 1.959963984540054  # standard deviations that hold 95 % of normal values

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Number = TypeVar("Number", bound=np.generic)


class DeviceKind(StrEnum):
    """The devices a recording can be of; `hinge` is any hinged pair, without phases and rules."""

    PMDI = "pmdi"
    ELLIPTA = "ellipta"
    HINGE = "hinge"


class SensorName(StrEnum):
    BODY = "body"
    LEVER = "lever"


class PhaseKind(StrEnum):
    REST = "rest"
    HANDLING = "handling"
    SHAKE = "shake"
    OPEN = "open"
    EXHALE = "exhale"
    TO_MOUTH = "to_mouth"
    INHALE = "inhale"
    BREATH_HOLD = "breath_hold"
    EXHALE_AFTER = "exhale_after"
    CLOSE = "close"
    PUT_DOWN = "put_down"


class EventKind(StrEnum):
    PRESS = "press"
    PARTIAL_PRESS = "partial_press"
    OPEN = "open"
    CLOSE = "close"


class Verdict(StrEnum):
    FAIL = "fail"
    PASS = "pass"
    INDETERMINATE = "indeterminate"
    NOT_ASSESSABLE = "not_assessable"


class Severity(StrEnum):
    CRITICAL = "critical"
    MAJOR = "major"
    MINOR = "minor"


class Grade(StrEnum):
    CORRECT = "correct"
    MINOR_MISTAKES = "minor_mistakes"
    MAJOR_MISTAKES = "major_mistakes"
    CRITICAL_MISTAKES = "critical_mistakes"
    NOT_ASSESSABLE = "not_assessable"


# ---------------------------------------------------------------------------------------------- recordings


def usual_step_s(time_s: FloatArray) -> float:
    """The median step between at least two times, so that gaps do not count."""
    steps = np.diff(time_s)
    middle = steps.size // 2
    steps.partition(middle)  # a quarter of the time of numpy's own median
    upper = float(steps[middle])
    return upper if steps.size % 2 else (float(steps[:middle].max()) + upper) / 2.0


@dataclass(frozen=True)  # without slots, so that the usual step is worked out once
class ImuTrack:
    """The samples of one inertial sensor, in the frame of the part it sits on.

    Times increase strictly; they may start anywhere (slightly negative too) and be uneven.
    A range of `None` is unknown. The saturation masks are found on the chip's own axes by the reader; `None` means that
    nobody looked yet.

    Raises `RecordingError` when shapes differ, a value is not finite, or time does not increase. A track may be short:
    what a whole recording must be, `Recording` asks.
    """

    time_s: FloatArray  # (n,)
    acc_m_s2: FloatArray  # (n, 3) specific force
    gyr_rad_s: FloatArray  # (n, 3)
    mag_ut: FloatArray | None = None  # (n, 3)
    acc_range_m_s2: float | None = None
    gyr_range_rad_s: float | None = None
    is_acc_saturated: BoolArray | None = None  # (n,)
    is_gyr_saturated: BoolArray | None = None  # (n,)

    def __post_init__(self) -> None:
        time_s: FloatArray = _as_array("time_s", self.time_s, np.float64)
        object.__setattr__(self, "time_s", time_s)
        if time_s.ndim != 1:
            raise _wrong_shape("time_s", f"shape {time_s.shape}", "shape (n,)")
        for name in ("acc_m_s2", "gyr_rad_s", "mag_ut", "is_acc_saturated", "is_gyr_saturated"):
            given = getattr(self, name)
            if given is None and name not in {"acc_m_s2", "gyr_rad_s"}:
                continue
            is_mask = name.startswith("is_")
            values: FloatArray | BoolArray = _as_array(name, given, np.bool_ if is_mask else np.float64)
            wanted = (time_s.size,) if is_mask else (time_s.size, 3)
            if values.shape != wanted:
                raise _wrong_shape(name, f"shape {values.shape}", f"shape {wanted}")
            object.__setattr__(self, name, values)
            if not np.isfinite(values).all():
                raise RecordingError("not_finite", column=name, found="not finite", wanted="finite numbers")
        for name in ("acc_range_m_s2", "gyr_range_rad_s"):
            given = getattr(self, name)
            if given is not None and not 0.0 < given < math.inf:
                raise RecordingError("out_of_range", column=name, found=f"{given!r}", wanted="a number above zero")
        if not np.isfinite(time_s).all() or (time_s[1:] <= time_s[:-1]).any():
            raise RecordingError(
                "time_not_increasing", column="time_s", found="not increasing", wanted="strictly increasing seconds"
            )

    @property
    def n_samples(self) -> int:
        return int(self.time_s.size)

    @functools.cached_property
    def usual_step_s(self) -> float:
        """The median step, so that gaps do not count."""
        return usual_step_s(self.time_s)

    def check_length_and_rate(self, sensor: str) -> None:
        """Raises `RecordingError` when these samples are no recording of a sensor: too few, too many, too slow."""
        n = self.n_samples
        length_s = float(self.time_s[-1] - self.time_s[0]) if n else 0.0
        limits.check_length_and_rate(
            sensor, n_samples=n, length_s=length_s, step_s=self.usual_step_s if n > 1 else math.inf
        )

    @property
    def rate_hz(self) -> float:
        """The usual rate: one over the usual step."""
        return 1.0 / self.usual_step_s


def _as_array(name: str, given: Any, kind: type[Number]) -> NDArray[Number]:
    try:
        return np.ascontiguousarray(given, dtype=kind)
    except (TypeError, ValueError) as error:
        raise _wrong_shape(name, "no array of numbers", "one number or three axes for every sample") from error


def _wrong_shape(name: str, found: str, wanted: str) -> RecordingError:
    return RecordingError("wrong_shape", column=name, found=found, wanted=wanted)


@dataclass(frozen=True, slots=True)
class SensorInfo:
    """What the sidecar says of one sensor; `q_chip` (`q_body_chip`, `q_lever_chip`) was applied by the reader.

    The ranges are the track's.
    """

    model: str | None = None
    q_chip: tuple[float, float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class Recording:
    """One recorded session of one device: the two sensors, each on its own clock.

    Raises `RecordingError` for what no recording may be, read or made: a sensor missing, under 2 s or over 1 h, a rate
    outside 25 to 1000 Hz, a session id or pseudonym that is not one line of text.
    """

    device: DeviceKind
    body: ImuTrack
    lever: ImuTrack
    session_id: str = "session"
    recorded_at: str | None = None  # ISO 8601 with offset
    patient_ref: str | None = None  # a pseudonym
    sensors: Mapping[SensorName, SensorInfo] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "device", DeviceKind(self.device))
        except ValueError:
            wanted = ", ".join(DeviceKind)
            raise RecordingError("unknown_device", column="device", found=repr(self.device), wanted=wanted) from None
        for name in SensorName:
            track = getattr(self, name)
            if not isinstance(track, ImuTrack):
                found = f"{type(track).__name__}"
                raise RecordingError("sensor_missing", column=name, found=found, wanted="an ImuTrack of each sensor")
            track.check_length_and_rate(name)
        if not limits.is_plain_text(self.session_id):
            raise _unfit("session_id", self.session_id, limits.TEXT_WANTED)
        if self.patient_ref is not None and not limits.is_plain_text(self.patient_ref):
            raise _unfit("patient_ref", self.patient_ref, limits.TEXT_WANTED)
        if self.recorded_at is not None and not limits.is_instant(self.recorded_at):
            raise _unfit("recorded_at", self.recorded_at, limits.INSTANT_WANTED)

    def with_tracks(self, *, body: ImuTrack | None = None, lever: ImuTrack | None = None) -> Recording:
        """The same session, its samples corrected or on another clock; the limits were the recorded samples' own."""
        other = copy.copy(self)
        object.__setattr__(other, "body", body or self.body)
        object.__setattr__(other, "lever", lever or self.lever)
        return other


def _unfit(name: str, found: object, wanted: str) -> RecordingError:
    return RecordingError("unfit_text", column=name, found=repr(found)[:60], wanted=wanted)


# ---------------------------------------------------------------------------------------- signals of the stages


@dataclass(frozen=True, slots=True)
class ClockFit:
    """The lever's clock against the body's: `t_body = t_lever + offset_s + drift * (t_lever - reference_s)`."""

    offset_s: float
    drift: float  # 1e-6 is one ppm
    reference_s: float
    sd_offset_s: float
    sd_drift: float
    is_found: bool  # false: too little common motion, the clocks are taken as they are


@dataclass(frozen=True, slots=True)
class AttitudeTrack:
    """Attitude of one sensor's part: `q[k]` is `q_ref_body` (or `q_ref_lever`) at `time_s[k]`; heading is arbitrary."""

    time_s: FloatArray  # (n,)
    q: FloatArray  # (n, 4) scalar first
    sd_tilt_rad: FloatArray  # (n,) standard deviation of the tilt error, per horizontal axis
    gyr_bias_rad_s: FloatArray  # (n, 3) in the part's frame
    r: FloatArray  # (n,) the adaptive measurement variance; its unit depends on the method, see `r_unit`
    r_unit: str = ""


@dataclass(frozen=True, slots=True)
class Calibration:
    """What turns the two attitudes into the lever's angle; arrays, because while recording it is learned as it goes."""

    axis_body: FloatArray  # (n, 3) the hinge, a unit vector in the body's frame
    q_shut: FloatArray  # (n, 4) q_body_lever of the shut lever: how the two frames were mounted
    sd_shut_rad: FloatArray  # (n,) of its turn about the hinge
    heading_rad: FloatArray  # (n,) turns the lever's room into the body's, about z
    sd_heading_rad: FloatArray  # (n,)
    tilt_shown_rad2: FloatArray  # (n,) variance of one tilt against the other, as far as the hinge has shown it, ...
    tilt_unseen: FloatArray  # (n,) ... and the share of what the attitudes claim that still counts
    sd_alike_rad: float | None = None  # of one tilt against the other while shut; None: the two err by themselves


@dataclass(frozen=True, slots=True)
class LeverTrack:
    """The lever's angle about the hinge, relative to the body; 0 when shut, right-handed about +x."""

    time_s: FloatArray  # (n,) the body's clock
    angle_rad: FloatArray  # (n,)
    sd_rad: FloatArray  # (n,)
    off_axis_rad: FloatArray  # (n,) the part of the relative rotation that a hinge cannot make


@dataclass(frozen=True, slots=True)
class Motion:
    """How the inhaler moves, on one even grid of the body's clock: what phases, events and measures are read from."""

    time_s: FloatArray  # (n,)
    rate_hz: float
    tilt_rad: FloatArray  # (n,) from upright, [0, pi]
    elevation_rad: FloatArray  # (n,) of the body's y axis against level: a tilt-back of the head raises it
    heading_rad: FloatArray  # (n,) of the body's y axis about the vertical, from any zero
    sd_tilt_rad: FloatArray  # (n,)
    gyr_rad_s: FloatArray  # (n, 3) body frame, bias removed
    force_m_s2: FloatArray  # (n, 3) specific force, body frame
    acc_ref_m_s2: FloatArray  # (n, 3) inertial acceleration in the room
    velocity_ref_m_s: FloatArray  # (n, 3)
    height_m: FloatArray  # (n,) above where the session began; good over one movement
    activity: FloatArray  # (n,) below 1 while a hand holds still
    lever_rad: FloatArray  # (n,) positive when pressed or opened
    lever_rate_rad_s: FloatArray  # (n,)
    is_gap: BoolArray  # (n,) nothing was measured here

    @property
    def step_s(self) -> float:
        return 1.0 / self.rate_hz

    def edge_s(self, number: int) -> float:
        """Where a step begins, and with the number of samples where the last one ends: with the session."""
        return float(self.time_s[0]) + (number - 0.5) * self.step_s

    def index(self, at_s: float) -> int:
        """The sample nearest to a time, within the grid."""
        return min(max(round((at_s - float(self.time_s[0])) * self.rate_hz), 0), self.time_s.size - 1)


@dataclass(frozen=True, slots=True)
class Shake:
    """One bout of shaking: its alternating strokes of at least 0.6 g, by the times at which they begin and end."""

    stroke_start_s: FloatArray  # (k,)
    stroke_end_s: FloatArray  # (k,)
    sd_strokes: float  # of their number: half waves near 0.6 g may or may not be strokes

    @property
    def start_s(self) -> float:
        return float(self.stroke_start_s[0])

    @property
    def end_s(self) -> float:
        return float(self.stroke_end_s[-1])


# -------------------------------------------------------------------------------------------- the report's parts


@dataclass(frozen=True, slots=True)
class Flag:
    """A doubtful measurement that was used all the same."""

    code: str
    sensor: SensorName | None
    detail: str


@dataclass(frozen=True, slots=True)
class Quality:
    usable: bool
    flags: tuple[Flag, ...] = ()


@dataclass(frozen=True, slots=True)
class Phase:
    """A stretch of the session, `[start_s, end_s)` on the body's clock; confidence is between 0 and 1."""

    kind: PhaseKind
    start_s: float
    end_s: float
    confidence: float = 1.0


@dataclass(frozen=True, slots=True)
class Event:
    """A press or a stroke of the cover. `peak_s` is when the end stop is reached; `angle_deg` is the largest angle."""

    kind: EventKind
    start_s: float
    peak_s: float
    end_s: float
    angle_deg: float


@dataclass(frozen=True, slots=True)
class Measure:
    """A number with its standard deviation, in the unit that ends its name; without a value, the reason.

    `start_s` and `end_s` are where in the session it was seen, if anywhere; findings carry them on.
    """

    value: float | None
    sd: float | None = None
    reason: str | None = None
    start_s: float | None = None
    end_s: float | None = None


@dataclass(frozen=True, slots=True)
class Finding:
    """What one rule says of one session or dose."""

    rule: str
    verdict: Verdict
    severity: Severity | None
    value: float | None
    limit: float | None
    unit: str | None
    start_s: float | None
    end_s: float | None
    reason: str | None
    message: str


@dataclass(frozen=True, slots=True)
class Score:
    points: int
    grade: Grade


@dataclass(frozen=True, slots=True)
class Dose:
    start_s: float
    end_s: float
    events: tuple[Event, ...]
    measures: Mapping[str, Measure]
    findings: tuple[Finding, ...]
    score: Score


@dataclass(frozen=True, slots=True)
class Report:
    """All that is known of one session. `inhalemon.report` writes it as JSON, table, CSV or a page."""

    session_id: str
    device: DeviceKind
    pipeline_version: str
    settings_digest: str
    rules_digest: str
    duration_s: float
    quality: Quality
    phases: tuple[Phase, ...]
    events: tuple[Event, ...]
    measures: Mapping[str, Measure]
    findings: tuple[Finding, ...]
    doses: tuple[Dose, ...]
    score: Score
