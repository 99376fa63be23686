"""The curves of a session, reduced to what a screen can show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from inhalemon.pipeline import Tracks
from inhalemon.report.panels import CurveKind, PanelKind, panel_kinds
from inhalemon.rotation import tilt_from_upright
from inhalemon.values import TWO_SIDED_95, BoolArray, FloatArray

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


def channels(tracks: Tracks) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Everything that can be drawn of a session, in units for people, by name: the times (n,) and the values (n,)."""
    recording, angle = tracks.recording, tracks.angle
    body, lever = (recording.body, tracks.body), (recording.lever, tracks.lever)
    gyr_deg_s = np.degrees(recording.body.gyr_rad_s - tracks.body.gyr_bias_rad_s)
    at_body, acc_m_s2 = recording.body.time_s, recording.body.acc_m_s2
    found = {
        "tilt_deg": (tracks.body.time_s, np.degrees(tilt_from_upright(tracks.body.q))),
        "tilt_sd_deg": (tracks.body.time_s, np.degrees(tracks.body.sd_tilt_rad)),
        "angle_deg": (angle.time_s, np.degrees(angle.angle_rad)),
        "angle_sd_deg": (angle.time_s, np.degrees(angle.sd_rad)),
        "off_axis_deg": (angle.time_s, np.degrees(angle.off_axis_rad)),
        "gyr_norm_deg_s": (at_body, np.linalg.norm(gyr_deg_s, axis=1)),
    }
    for i, axis in enumerate("xyz"):
        found[f"gyr_{axis}_deg_s"] = (at_body, gyr_deg_s[:, i])
        found[f"acc_{axis}_m_s2"] = (at_body, acc_m_s2[:, i])
    for prefix, (imu, track) in (("", body), ("lever_", lever)):
        found[f"{prefix}acc_norm_m_s2"] = (imu.time_s, np.linalg.norm(imu.acc_m_s2, axis=1))
        found[f"{prefix}r"] = (track.time_s, track.r)
    return found


def session_panels(tracks: Tracks, *, moving_part: str = "lever") -> tuple[Panel, ...]:
    """The curves of each panel (see `panels.panel_kinds`)."""
    found = channels(tracks)

    def curve(kind: CurveKind, panel: PanelKind) -> Curve:
        time_s, value = found[kind.channel]
        value = np.log10(np.maximum(value, _SMALLEST)) if panel.is_log else value / panel.per_unit
        half_width = None if kind.sd_channel is None else TWO_SIDED_95 * found[kind.sd_channel][1] / panel.per_unit
        return Curve(kind.name, time_s, value, half_width)

    return tuple(
        Panel(panel.title, panel.unit, tuple(curve(each, panel) for each in panel.curves), panel.is_log)
        for panel in panel_kinds(moving_part, tracks.body.r_unit)
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
