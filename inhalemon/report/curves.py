"""The curves of a session, reduced to what a screen can show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from inhalemon.pipeline import Tracks
from inhalemon.rotation import tilt_from_upright
from inhalemon.values import STANDARD_GRAVITY_M_S2, TWO_SIDED_95, BoolArray, FloatArray

N_BUCKETS: Final = 800  # two points each: about as many as a wide screen has columns
_GAP_S: Final = 0.25  # longer than this without samples and the line is broken
_SMALLEST: Final = 1e-12  # below any measurement variance, so that a logarithm exists


@dataclass(frozen=True, slots=True)
class Curve:
    """One line of a panel, and the band of its uncertainty if it has one."""

    name: str
    time_s: FloatArray  # (n,)
    value: FloatArray  # (n,)
    half_width: FloatArray | None = None  # (n,) 95 % are within value +- half_width


@dataclass(frozen=True, slots=True)
class Panel:
    """Curves on one axis; a logarithmic panel holds decimal logarithms."""

    title: str
    unit: str
    curves: tuple[Curve, ...]
    is_log: bool = False


def session_panels(tracks: Tracks, *, moving_part: str = "lever") -> tuple[Panel, ...]:
    """Tilt, lever or cover angle, rates, specific force and the filter's adaptive R, in units for people."""
    recording, body, lever, angle = tracks.recording, tracks.body, tracks.lever, tracks.angle
    tilt = Curve(
        "tilt", body.time_s, np.degrees(tilt_from_upright(body.q)), TWO_SIDED_95 * np.degrees(body.sd_tilt_rad)
    )
    stroke = Curve("angle", angle.time_s, np.degrees(angle.angle_rad), TWO_SIDED_95 * np.degrees(angle.sd_rad))
    off_axis = Curve("off the axis", angle.time_s, np.degrees(angle.off_axis_rad))
    gyr_deg_s = np.degrees(recording.body.gyr_rad_s - body.gyr_bias_rad_s)
    rates = (Curve(axis, recording.body.time_s, gyr_deg_s[:, i]) for i, axis in enumerate(("x (hinge)", "y", "z")))
    parts = (("body", recording.body, body), (moving_part, recording.lever, lever))
    forces = (
        Curve(name, imu.time_s, np.linalg.norm(imu.acc_m_s2, axis=1) / STANDARD_GRAVITY_M_S2) for name, imu, _ in parts
    )
    variances = (Curve(name, track.time_s, np.log10(np.maximum(track.r, _SMALLEST))) for name, _, track in parts)
    return (
        Panel("Tilt from upright", "°", (tilt,)),
        Panel(f"{moving_part.capitalize()} angle", "°", (stroke, off_axis)),
        Panel("Rate of the body", "°/s", tuple(rates)),
        Panel("Specific force", "g", tuple(forces)),
        Panel("R of the adaptive filter", body.r_unit.replace("2", "²"), tuple(variances), is_log=True),
    )


def reduced(time_s: FloatArray, value: FloatArray, n_buckets: int = N_BUCKETS) -> list[tuple[FloatArray, FloatArray]]:
    """The curve in pieces without gaps, each with the least and the greatest sample of every bucket of time.

    Samples are kept where they are, so that peaks and steps stay at their time; a curve that is short enough is kept
    whole.
    """
    pieces = []
    is_finite: BoolArray = np.isfinite(value)
    time_s, value = time_s[is_finite], value[is_finite]
    if time_s.size == 0:
        return []
    edges = np.linspace(time_s[0], time_s[-1], n_buckets + 1)
    for piece in np.split(np.arange(time_s.size), np.flatnonzero(np.diff(time_s) > _GAP_S) + 1):
        kept = piece if time_s.size <= 2 * n_buckets else piece[_extremes(time_s[piece], value[piece], edges)]
        pieces.append((time_s[kept], value[kept]))
    return pieces


def _extremes(time_s: FloatArray, value: FloatArray, edges: FloatArray) -> Sequence[int]:
    bounds = np.unique(np.searchsorted(time_s, edges[1:-1]))
    kept: set[int] = {0, time_s.size - 1}
    for start, end in zip([0, *bounds], [*bounds, time_s.size], strict=True):
        if end > start:
            kept |= {int(start + value[start:end].argmin()), int(start + value[start:end].argmax())}
    return sorted(kept)
