"""The one place that knows the order of the stages: from a recording to its tracks, and on to its report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inhalemon.devices import Device, load_device
from inhalemon.settings import Settings
from inhalemon.signals import resample_attitude
from inhalemon.stages.attitude import estimate_attitude
from inhalemon.stages.calibrate import calibrate
from inhalemon.stages.lever import lever_angle
from inhalemon.values import AttitudeTrack, Calibration, DeviceKind, LeverTrack, Recording

# Raised whenever a score of the same recording can move.
PIPELINE_VERSION = "1"


@dataclass(frozen=True, slots=True)
class Tracks:
    """The signals of a recording, all on the body's clock and at the body's samples."""

    recording: Recording
    body: AttitudeTrack
    lever: AttitudeTrack
    calibration: Calibration
    angle: LeverTrack


def estimate_tracks(recording: Recording, settings: Settings | None = None, *, device: Device | None = None) -> Tracks:
    """The attitudes of both parts and the angle between them."""
    settings = settings or Settings()
    device = device or load_device(recording.device)
    body = estimate_attitude(recording.body, settings.attitude)
    lever = resample_attitude(estimate_attitude(recording.lever, settings.attitude), body.time_s)
    axis = device.hinge_sign * np.array(device.hinge_axis)
    has_shut_state = device.kind is not DeviceKind.HINGE
    calibration = calibrate(body, lever, axis, settings.lever, has_shut_state=has_shut_state)
    return Tracks(recording, body, lever, calibration, lever_angle(body, lever, calibration))


def track_lever(recording: Recording, settings: Settings | None = None, *, device: Device | None = None) -> LeverTrack:
    """The lever's (cover's) angle over the session: `time_s`, `angle_rad`, `sd_rad`, `off_axis_rad`, each (n,).

    At the body's samples, on the body's clock; 0 when shut, positive when pressed or opened.
    `Settings.causal()` gives what was known while recording.
    """
    return estimate_tracks(recording, settings, device=device).angle
