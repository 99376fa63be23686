"""Motions in closed form, for the stages that read them; and sessions scored once."""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace

import numpy as np

import inhalemon as im
from inhalemon.simulate.truth import Truth
from inhalemon.values import FloatArray, Motion, Phase, Recording, Report

G_M_S2 = 9.80665


def least_jerk(time_s: FloatArray, start_s: float, duration_s: float) -> FloatArray:
    """From 0 to 1 with the least jerk (Flash and Hogan 1985), as a hand moves."""
    x = np.clip((time_s - start_s) / duration_s, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def still(duration_s: float, rate_hz: float = 100.0) -> Motion:
    """An upright device in a hand that does not move at all."""
    n = round(duration_s * rate_hz)
    zero, zeros = np.zeros(n), np.zeros((n, 3))
    return Motion(
        time_s=np.arange(n) / rate_hz,
        rate_hz=rate_hz,
        tilt_rad=zero,
        elevation_rad=zero,
        heading_rad=zero,
        sd_tilt_rad=np.full(n, np.radians(1.0)),
        gyr_rad_s=zeros,
        force_m_s2=np.tile([0.0, 0.0, G_M_S2], (n, 1)),
        acc_ref_m_s2=zeros,
        velocity_ref_m_s=zeros,
        height_m=zero,
        activity=zero,
        lever_rad=zero,
        lever_rate_rad_s=zero,
        is_gap=np.zeros(n, dtype=np.bool_),
    )


def with_lever(motion: Motion, angle_rad: FloatArray) -> Motion:
    return replace(motion, lever_rad=angle_rad, lever_rate_rad_s=np.gradient(angle_rad, motion.step_s))


def with_pulses(motion: Motion, *pulses: tuple[float, float, float, float, float]) -> Motion:
    """The moving part goes to `angle_rad` and back: (start_s, rise_s, held_s, fall_s, angle_rad) each."""
    angle = np.zeros(motion.time_s.size)
    for start_s, rise_s, held_s, fall_s, angle_rad in pulses:
        back_s = start_s + rise_s + held_s
        angle += angle_rad * (least_jerk(motion.time_s, start_s, rise_s) - least_jerk(motion.time_s, back_s, fall_s))
    return with_lever(motion, angle)


@functools.cache
def scored(
    device: str, mistakes: tuple[str, ...] = (), seed: int = 0, rate_hz: float = 100.0, profile: str = "typical"
) -> tuple[Report, Truth]:
    """A simulated session's report and truth, worked out once in a run."""
    recording, truth = im.simulate_session(device, mistakes, seed=seed, rate_hz=rate_hz, profile=profile)
    return im.score_recording(recording), truth


def cut(recording: Recording, start_s: float, end_s: float) -> Recording:
    """The recording as if it had been started later and stopped earlier."""
    parts = {}
    for name in ("body", "lever"):
        track = getattr(recording, name)
        kept = (track.time_s >= start_s) & (track.time_s < end_s)
        parts[name] = im.ImuTrack(track.time_s[kept], track.acc_m_s2[kept], track.gyr_rad_s[kept])
    return im.Recording(device=recording.device, session_id=recording.session_id, **parts)


def without(recording: Recording, start_s: float, end_s: float) -> Recording:
    """The recording with both sensors' samples between two times lost."""
    parts = {}
    for name in ("body", "lever"):
        track = getattr(recording, name)
        kept = (track.time_s < start_s) | (track.time_s >= end_s)
        parts[name] = im.ImuTrack(track.time_s[kept], track.acc_m_s2[kept], track.gyr_rad_s[kept])
    return im.Recording(device=recording.device, session_id=recording.session_id, **parts)


def check_phases(report: Report) -> None:
    """They cover the session in order, without overlap, and each confidence is a share."""
    phases = report.phases
    assert phases
    for before, after in itertools.pairwise(phases):
        assert before.end_s == after.start_s
        assert before.kind is not after.kind
    assert all(phase.end_s > phase.start_s for phase in phases)
    assert abs(phases[-1].end_s - phases[0].start_s - report.duration_s) < 1e-9
    assert all(0.0 <= phase.confidence <= 1.0 for phase in phases)


def overlap(one: Phase, other: Phase) -> float:
    """Shared time over joint time of two phases, 0 to 1."""
    shared = min(one.end_s, other.end_s) - max(one.start_s, other.start_s)
    return max(shared, 0.0) / (max(one.end_s, other.end_s) - min(one.start_s, other.start_s))
