"""The one place that knows the order of the stages: from a recording to its tracks, and on to its report."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from inhalemon.devices import Device, load_device
from inhalemon.rules import RuleSet, load_rules
from inhalemon.rules.scoring import score
from inhalemon.settings import Settings
from inhalemon.signals import resample_attitude
from inhalemon.stages.attitude import estimate_attitude
from inhalemon.stages.calibrate import calibrate
from inhalemon.stages.clocks import align_clocks
from inhalemon.stages.doses import split_doses
from inhalemon.stages.events import find_events
from inhalemon.stages.findings import apply_rules
from inhalemon.stages.lever import lever_angle
from inhalemon.stages.measures import measure_dose
from inhalemon.stages.motion import describe_motion
from inhalemon.stages.phases import find_phases
from inhalemon.stages.quality import assess_quality
from inhalemon.stages.sensors import correct_sensors
from inhalemon.stages.shakes import find_shakes
from inhalemon.stages.worst import worst_of
from inhalemon.values import (
    STANDARD_GRAVITY_M_S2,
    AttitudeTrack,
    Calibration,
    ClockFit,
    DeviceKind,
    Dose,
    LeverTrack,
    Quality,
    Recording,
    Report,
)

# Raised whenever a score of the same recording can move.
PIPELINE_VERSION = "3"


@functools.cache
def _default_settings() -> Settings:
    """One object for all sessions: its digest is worked out once."""
    return Settings()


@dataclass(frozen=True, slots=True)
class Tracks:
    """The signals of a recording, all on the body's clock and at the body's samples."""

    recording: Recording  # clocks aligned, sensors corrected
    clock: ClockFit
    body: AttitudeTrack
    lever: AttitudeTrack
    calibration: Calibration
    angle: LeverTrack
    quality: Quality


def estimate_tracks(recording: Recording, settings: Settings | None = None, *, device: Device | None = None) -> Tracks:
    """The attitudes of both parts and the angle between them, and what is doubtful about them."""
    settings = settings or _default_settings()
    device = device or load_device(recording.device)
    axis = device.hinge_sign * np.array(device.hinge_axis)
    has_shut_state = device.kind is not DeviceKind.HINGE

    as_recorded, clock = align_clocks(recording, settings.clocks)
    recording = as_recorded
    are_corrected = has_shut_state and settings.sensors.is_used
    if are_corrected:
        recording = correct_sensors(as_recorded, axis, settings.sensors)
    # A delay that both sensors share only shifts the clock: angles and phases stay on the samples' own time. An
    # offset that tilts a part the same way all along is in the shut angle too: the angle doubts only what changes.
    attitude = replace(
        settings.attitude, gyr_delay_s=0.0, sd_delay_s=0.0, sd_acc_bias_m_s2=settings.lever.sd_acc_change_m_s2
    )
    body = estimate_attitude(recording.body, attitude)
    lever = resample_attitude(estimate_attitude(recording.lever, attitude), body.time_s)
    calibration = calibrate(
        body, lever, axis, settings.lever, has_shut_state=has_shut_state, are_corrected=are_corrected
    )
    angle = lever_angle(body, lever, calibration, sd_delay_s=settings.attitude.sd_delay_s)
    body, lever = (_with_offset(part, settings.attitude.sd_acc_bias_m_s2) for part in (body, lever))
    quality = assess_quality(
        as_recorded,
        clock,
        settings.quality,
        calibration=calibration,
        lever=angle,
        hinge_axis=axis,
        has_shut_state=has_shut_state,
    )
    return Tracks(recording, clock, body, lever, calibration, angle, quality)


def _with_offset(track: AttitudeTrack, sd_acc_bias_m_s2: float) -> AttitudeTrack:
    """The attitude with the accelerometer's offset in its standard deviation."""
    return replace(track, sd_tilt_rad=np.sqrt(track.sd_tilt_rad**2 + (sd_acc_bias_m_s2 / STANDARD_GRAVITY_M_S2) ** 2))


def track_lever(recording: Recording, settings: Settings | None = None, *, device: Device | None = None) -> LeverTrack:
    """The lever's (cover's) angle over the session: `time_s`, `angle_rad`, `sd_rad`, `off_axis_rad`, each (n,).

    At the body's samples, on the body's clock; 0 when shut, positive when pressed or opened.
    `Settings.causal()` gives what was known while recording.
    """
    return estimate_tracks(recording, settings, device=device).angle


def score_recording(
    recording: Recording,
    *,
    settings: Settings | None = None,
    rules: RuleSet | None = None,
    device: Device | None = None,
) -> Report:
    """The report of a recording: phases, events, measures, findings and score.

    Without `settings`, `rules` and `device` the defaults are used: the default profile of rules, and the profile of the
    recording's own device.
    """
    settings = settings or _default_settings()
    device = device or load_device(recording.device)
    return report_of(estimate_tracks(recording, settings, device=device), settings, rules=rules, device=device)


def report_of(tracks: Tracks, settings: Settings, *, rules: RuleSet | None = None, device: Device) -> Report:
    """The report of a recording whose tracks are already there (a page needs both)."""
    rules = rules or load_rules()
    recording = tracks.recording
    unusable = None if tracks.quality.usable else "recording_not_usable"

    motion = describe_motion(recording, tracks.body, tracks.angle, settings.motion)
    shakes = find_shakes(motion, settings.shakes)
    events = find_events(motion, shakes, device, settings.events)
    phases = find_phases(motion, shakes, events, device, settings.phases)
    doses: list[Dose] = []
    earlier_inhalation_s = None
    for span in split_doses(phases, shakes, events, device):
        measures = measure_dose(
            motion,
            phases,
            shakes,
            events,
            device,
            span,
            earlier_inhalation_s=earlier_inhalation_s,
            settings=settings.measures,
        )
        findings = apply_rules(measures, device, rules, unusable=unusable)
        own_events = tuple(event for event in events if span[0] <= event.start_s < span[1])
        doses.append(Dose(*span, own_events, measures, findings, score(findings)))
        earlier_inhalation_s = measures["inhalation_start_s"].value or earlier_inhalation_s
    measures, findings = worst_of(doses) if doses else ({}, apply_rules({}, device, rules, unusable=unusable))
    return Report(
        session_id=recording.session_id,
        device=recording.device,
        pipeline_version=PIPELINE_VERSION,
        settings_digest=settings.digest,
        rules_digest=rules.digest,
        duration_s=float(recording.body.time_s[-1] - recording.body.time_s[0]),
        quality=tracks.quality,
        phases=phases,
        events=events,
        measures=measures,
        findings=findings,
        doses=tuple(doses),
        score=score(findings),
    )
