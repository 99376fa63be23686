"""A device's own hinge axis and travel, learned from a recording in which it is worked to the stop a few times."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from inhalemon.devices import Device
from inhalemon.exceptions import RecordingError
from inhalemon.pipeline import Tracks
from inhalemon.values import DeviceKind, FloatArray

_MIN_STROKE_S = 0.05  # a shorter excursion is an impact's ringing, no stroke of a hand
_NOISE_SD = 3.0  # a stroke stands out of the angle's own deviation by this factor


@dataclass(frozen=True, slots=True)
class LearnedDevice:
    """The profile with what was learned, and how well it is known."""

    device: Device
    travel_sd_rad: float
    n_strokes: int


def learn_device(tracks: Tracks, device: Device) -> LearnedDevice:
    """The device with its hinge axis and full travel learned from full strokes (presses, openings) of the recording.

    A stroke is an excursion beyond the angle from which a stroke of an uncalibrated device counts as full. The travel
    is the median of the strokes' largest angles; its deviation is that of the median, and at least what the angle
    itself claims. A plain hinge has no stop, so only its axis is learned.

    Raises `RecordingError` (`no_stroke`) when there is none.
    """
    learned = replace(device, hinge_axis=_axis(tracks, device))
    if device.kind is DeviceKind.HINGE:
        return LearnedDevice(learned, travel_sd_rad=float("nan"), n_strokes=0)
    peaks_rad, sds_rad = _strokes(tracks, device)
    if not peaks_rad.size:
        raise RecordingError(
            "no_stroke",
            file=tracks.recording.session_id,
            column="lever angle",
            found=f"at most {np.rad2deg(tracks.angle.angle_rad.max()):.1f} deg",
            wanted=f"full strokes beyond {np.rad2deg(device.uncalibrated_full_rad):g} deg",
            detail=f"Work the {device.moving_part} to its stop a few times, with a rest before",
        )
    travel_rad = float(np.median(peaks_rad))
    # 1.2533 sd / sqrt(n): the deviation of a median of normal values.
    scatter_rad = 1.2533 * float(peaks_rad.std(ddof=1)) / np.sqrt(peaks_rad.size) if peaks_rad.size > 1 else 0.0
    return LearnedDevice(
        device=replace(learned, full_travel_rad=travel_rad),
        travel_sd_rad=max(scatter_rad, float(np.median(sds_rad))),
        n_strokes=int(peaks_rad.size),
    )


def _axis(tracks: Tracks, device: Device) -> tuple[float, float, float]:
    x, y, z = device.hinge_sign * tracks.calibration.axis_body[-1]
    return float(x), float(y), float(z)


def _strokes(tracks: Tracks, device: Device) -> tuple[FloatArray, FloatArray]:
    """Largest angle of each stroke, and the angle's deviation there."""
    angle = tracks.angle
    threshold_rad = np.maximum(device.uncalibrated_full_rad, _NOISE_SD * angle.sd_rad)
    is_out = np.concatenate([[False], angle.angle_rad > threshold_rad, [False]])
    edges = np.flatnonzero(np.diff(is_out.astype(np.int8)))
    peaks, sds = [], []
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if angle.time_s[end - 1] - angle.time_s[start] >= _MIN_STROKE_S:
            top = start + int(np.argmax(angle.angle_rad[start:end]))
            peaks.append(angle.angle_rad[top])
            sds.append(angle.sd_rad[top])
    return np.array(peaks), np.array(sds)
