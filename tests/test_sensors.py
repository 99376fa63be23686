"""The sensors' biases from the shut lever, on simulated sessions with the biases of cheap chips."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from inhalemon.pipeline import estimate_tracks
from inhalemon.settings import SensorSettings, Settings
from inhalemon.simulate import TYPICAL, Truth, simulate_session
from inhalemon.stages.sensors import correct_sensors
from inhalemon.values import Recording

X = np.array([1.0, 0.0, 0.0])
# A common clock, so that this stage can be tested by itself; frames in line, so that the truth is in them.
CONDITIONS = dataclasses.replace(TYPICAL, sd_mount_rad=0.0, max_clock_offset_s=0.0, max_clock_drift=0.0)


def corrected(recording: Recording) -> Recording:
    return correct_sensors(recording, X, SensorSettings())


@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
@pytest.mark.parametrize("seed", [2, 5, 7])
def test_gyro_bias_of_the_lever_against_the_body_is_found(device: str, seed: int) -> None:
    """Ellipta 7 is open for most of the session, and 5 and 2 begin in the hand, without rest."""
    recording, truth = simulate_session(device, seed=seed, conditions=CONDITIONS)
    after = corrected(recording)
    left_body = truth.gyr_bias_body_rad_s - (recording.body.gyr_rad_s - after.body.gyr_rad_s)
    left_lever = truth.gyr_bias_lever_rad_s - (recording.lever.gyr_rad_s - after.lever.gyr_rad_s)
    between_deg_s = np.degrees(left_lever.mean(axis=0) - left_body.mean(axis=0))
    # Scale errors of 1 % at the rates of handling leave a little.
    assert np.abs(between_deg_s).max() < 0.15
    assert np.degrees(np.abs(left_body.mean(axis=0))).max() < 1.0


def error_deg(recording: Recording, truth: Truth, settings: Settings) -> float:
    error = estimate_tracks(recording, settings).angle.angle_rad - truth.angle_rad
    return float(np.degrees(np.sqrt(np.mean(error**2))))


@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
def test_angle_is_better_with_corrected_sensors(device: str) -> None:
    without = dataclasses.replace(Settings(), sensors=SensorSettings(is_used=False))
    errors = []
    for seed in range(4):
        recording, truth = simulate_session(device, seed=seed, conditions=CONDITIONS)
        errors.append((error_deg(recording, truth, Settings()), error_deg(recording, truth, without)))
    mean_with, mean_without = np.mean(errors, axis=0)
    assert mean_with < 0.9
    assert mean_with < 0.85 * mean_without


def test_perfect_sensors_are_left_nearly_alone() -> None:
    recording, _ = simulate_session("pmdi", seed=3, profile="perfect")
    after = corrected(recording)
    # A lever chip off the hinge feels the hand's turning: some hundredths of m/s^2 in a still hand.
    assert np.abs(after.body.acc_m_s2 - recording.body.acc_m_s2).max() < 0.05
    assert np.degrees(np.abs(after.body.gyr_rad_s - recording.body.gyr_rad_s)).max() < 0.2


def test_too_short_an_overlap_changes_nothing() -> None:
    recording, _ = simulate_session("pmdi", seed=3)
    away = dataclasses.replace(recording.lever, time_s=recording.lever.time_s + recording.body.time_s[-1] - 1.0)
    apart = dataclasses.replace(recording, lever=away)
    assert corrected(apart) is apart
