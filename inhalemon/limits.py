"""What every recording keeps to, whether it was read from a file or made in Python."""

from __future__ import annotations

from datetime import datetime
from typing import Final

from inhalemon.exceptions import RecordingError

MIN_DURATION_S: Final = 2.0
MAX_DURATION_S: Final = 3600.0
MIN_RATE_HZ: Final = 25.0
MAX_RATE_HZ: Final = 1000.0
# Crystals are off by some 100 ppm, and so is an hour by one of them; times that jitter blur the usual rate.
CLOCK_TOLERANCE: Final = 2.5e-4
RATE_TOLERANCE: Final = 0.01
MAX_SAMPLES: Final = int(MAX_DURATION_S * MAX_RATE_HZ * (1 + RATE_TOLERANCE)) + 1
MAX_TEXT: Final = 200

TEXT_WANTED: Final = f"a text of 1 to {MAX_TEXT} characters on one line"
INSTANT_WANTED: Final = "an ISO 8601 time with its offset, 2026-11-20T08:30:00+09:00"


def check_length_and_rate(sensor: str, *, n_samples: int, length_s: float, step_s: float) -> None:
    """Raises `RecordingError` for a sensor with too few, too many, too slow or too quick samples.

    `length_s` is from the first to the last sample, `step_s` the usual step. A sample stands for one step, so 200
    samples at 100 Hz last 2 s.
    """
    if n_samples < 2:
        raise _too_short(sensor, f"{n_samples} sample{'s' * (n_samples == 0)}")
    rate_hz = 1.0 / step_s
    if not MIN_RATE_HZ * (1 - RATE_TOLERANCE) <= rate_hz <= MAX_RATE_HZ * (1 + RATE_TOLERANCE):
        raise RecordingError(
            "rate_out_of_range",
            column="time_s",
            found=f"{rate_hz:.4g} Hz for {sensor}",
            wanted=f"{MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz",
            detail="Are the times in seconds?",
        )
    if length_s + step_s < MIN_DURATION_S * (1 - CLOCK_TOLERANCE):
        raise _too_short(sensor, f"{length_s + step_s:.3g} s")
    if length_s > MAX_DURATION_S * (1 + CLOCK_TOLERANCE):
        raise too_long(f"{length_s:.6g} s of {sensor}")


def is_plain_text(value: object) -> bool:
    """Whether a value is text for a sidecar, a table and a log: on one line, neither empty nor endless."""
    return isinstance(value, str) and bool(value.strip()) and len(value) <= MAX_TEXT and value.isprintable()


def is_instant(value: object) -> bool:
    """Whether a value is an ISO 8601 time with its offset."""
    try:
        return isinstance(value, str) and datetime.fromisoformat(value).tzinfo is not None
    except ValueError:
        return False


def _too_short(sensor: str, found: str) -> RecordingError:
    return RecordingError(
        "too_short",
        column="time_s",
        found=f"{found} of {sensor}",
        wanted=f"at least {MIN_DURATION_S:g} s of each sensor",
        detail="Record the whole use of the device",
    )


def too_long(found: str) -> RecordingError:
    """The refusal of more than an hour."""
    return RecordingError(
        "too_long",
        column="time_s",
        found=found,
        wanted=f"at most {MAX_DURATION_S:g} s",
        detail="Cut the recording into sessions",
    )
