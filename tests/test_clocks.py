"""The lever's clock is brought to the body's by the motion they share."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np
import pytest

from inhalemon.settings import ClockSettings
from inhalemon.simulate import simulate_session
from inhalemon.stages.clocks import align_clocks
from inhalemon.values import DeviceKind, FloatArray, ImuTrack, PhaseKind, Recording
from validation.second_generator import second_session

HINGE_DATA = Path(__file__).parents[2] / "shared" / "data" / "hinge"


def _with_clock(recording: Recording, offset_s: float, drift: float) -> Recording:
    """The recording with the lever's clock changed so that it reads `offset_s + (1 + drift) t` at the body's t."""
    time_s = offset_s + (1.0 + drift) * recording.lever.time_s
    return dataclasses.replace(recording, lever=dataclasses.replace(recording.lever, time_s=time_s))


def _exact_session(device: str, seed: int, rate_hz: float, **kwargs: object) -> tuple[Recording, FloatArray]:
    """A simulated session, typical sensors, the lever's clock set right by the truth; and the lever's true times."""
    recording, truth = simulate_session(device, seed=seed, rate_hz=rate_hz, **kwargs)  # type: ignore[arg-type]  # test helper
    clock = truth.lever_clock
    true_s = (recording.lever.time_s - clock.offset_s) / (1.0 + clock.drift)
    return dataclasses.replace(recording, lever=dataclasses.replace(recording.lever, time_s=true_s)), true_s


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0])
@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
@pytest.mark.parametrize(("offset_s", "drift"), [(0.02, 1e-4), (-0.02, -1e-4)])
def test_offset_and_drift_are_recovered_to_two_milliseconds(
    device: str, rate_hz: float, offset_s: float, drift: float
) -> None:
    for seed in (1, 2):
        recording, true_s = _exact_session(device, seed, rate_hz)
        aligned, fit = align_clocks(_with_clock(recording, offset_s, drift), ClockSettings())
        assert fit.is_found
        assert np.abs(aligned.lever.time_s - true_s).max() < 0.002


@pytest.mark.parametrize("rate_hz", [50.0, 100.0])
def test_stamps_that_jitter_hide_no_lag(rate_hz: float) -> None:
    """The samples are taken some milliseconds from when their stamps say."""
    recording, true_s = _exact_session("pmdi", 8, rate_hz)
    track = recording.lever
    taken_s = track.time_s + np.random.default_rng(8).normal(0.0, 0.003, track.n_samples)
    gyr = np.stack([np.interp(taken_s, track.time_s, column) for column in track.gyr_rad_s.T], axis=1)
    jittered = dataclasses.replace(recording, lever=dataclasses.replace(track, gyr_rad_s=gyr))
    aligned, fit = align_clocks(_with_clock(jittered, 0.08, 5e-5), ClockSettings())
    assert fit.is_found
    assert np.abs(aligned.lever.time_s - true_s).max() < 0.002


def test_without_shaking_the_other_motion_is_enough() -> None:
    recording, true_s = _exact_session("pmdi", 5, 50.0, mistakes=("not_shaken",))
    aligned, fit = align_clocks(_with_clock(recording, 0.015, 5e-5), ClockSettings())
    assert fit.is_found
    assert np.abs(aligned.lever.time_s - true_s).max() < 0.002


@pytest.mark.parametrize("offset_s", [3.7, -40.0, 1.8e9])
def test_clocks_with_another_zero_are_found_too(offset_s: float) -> None:
    recording, true_s = _exact_session("pmdi", 3, 100.0)
    aligned, fit = align_clocks(_with_clock(recording, offset_s, 0.0), ClockSettings())
    assert fit.is_found
    assert np.abs(aligned.lever.time_s - true_s).max() < 0.002


@pytest.mark.parametrize("seed", [67, 99, 100, 101])
def test_half_a_period_of_the_shake_is_not_taken_for_the_lag(seed: int) -> None:
    """Nothing but the shake: the speeds look much alike half a period off, 0.12 s in the first two sessions."""
    profile = "harsh" if seed % 2 else "typical"
    rate_hz = (100.0, 50.0, 200.0)[seed % 3]
    recording, truth = simulate_session("pmdi", seed=seed, rate_hz=rate_hz, profile=profile)
    shake = next(phase for phase in truth.phases if phase.kind is PhaseKind.SHAKE)
    clock = truth.lever_clock
    begin_s, end_s = shake.start_s - 0.3, shake.end_s + 0.3
    body, lever = (
        _cut(recording.body, begin_s, end_s),
        _cut(recording.lever, begin_s + clock.offset_s, end_s + clock.offset_s),
    )
    true_s = (lever.time_s - clock.offset_s) / (1.0 + clock.drift)
    aligned, fit = align_clocks(Recording(device=DeviceKind.PMDI, body=body, lever=lever), ClockSettings())
    assert fit.is_found
    assert np.abs(aligned.lever.time_s - true_s).max() < 0.002


def _cut(track: ImuTrack, begin_s: float, end_s: float) -> ImuTrack:
    kept = (track.time_s >= begin_s) & (track.time_s <= end_s)
    return ImuTrack(track.time_s[kept], track.acc_m_s2[kept], track.gyr_rad_s[kept])


@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
def test_in_a_car_without_any_rest_the_biases_are_found_with_the_clocks(device: str) -> None:
    """Sessions of the other generator, which vibrate from end to end; the chips' biases are degrees a second."""
    for seed in (0, 1, 2):
        recording, truth = second_session(device, seed=seed, attack="car", rate_hz=100)
        clock = truth.lever_clock
        true_s = (recording.lever.time_s - clock.offset_s) / (1.0 + clock.drift)
        aligned, fit = align_clocks(recording, ClockSettings())
        assert fit.is_found
        assert np.abs(aligned.lever.time_s - true_s).max() < 0.002


def test_claimed_deviation_agrees_with_the_error() -> None:
    """Over sessions the offset's error is no larger than claimed; the floor of 0.2 ms makes it smaller."""
    normalised = []
    for seed in range(12):
        recording, true_s = _exact_session("ellipta", 100 + seed, 100.0, profile="harsh")
        aligned, fit = align_clocks(_with_clock(recording, 0.01, 3e-5), ClockSettings())
        middle = int(np.argmin(np.abs(recording.lever.time_s - fit.reference_s)))
        normalised.append((aligned.lever.time_s[middle] - true_s[middle]) / fit.sd_offset_s)
    assert np.sqrt(np.mean(np.square(normalised))) < 1.3


def _still(n: int, rate_hz: float, rng: np.random.Generator) -> ImuTrack:
    acc = np.array([0.0, 0.0, 9.81]) + rng.normal(0, 0.02, (n, 3))
    return ImuTrack(np.arange(n) / rate_hz, acc, rng.normal(0, 0.002, (n, 3)))


def test_without_motion_the_clocks_are_taken_as_they_are() -> None:
    rng = np.random.default_rng(0)
    recording = Recording(device=DeviceKind.PMDI, body=_still(3000, 100, rng), lever=_still(3000, 100, rng))
    aligned, fit = align_clocks(recording, ClockSettings())
    assert not fit.is_found
    assert fit.offset_s == 0.0
    np.testing.assert_array_equal(aligned.lever.time_s, recording.lever.time_s)


def test_motion_that_is_not_shared_is_not_believed() -> None:
    body, _ = _exact_session("pmdi", 1, 100.0)
    other, _ = _exact_session("pmdi", 2, 100.0)
    _, fit = align_clocks(dataclasses.replace(body, lever=other.lever), ClockSettings())
    assert not fit.is_found


def test_clocks_that_never_meet_and_share_nothing_begin_together() -> None:
    rng = np.random.default_rng(0)
    lever = _still(3000, 100, rng)
    late = dataclasses.replace(lever, time_s=lever.time_s + 900.0)
    recording = Recording(device=DeviceKind.PMDI, body=_still(3000, 100, rng), lever=late)
    aligned, fit = align_clocks(recording, ClockSettings())
    assert not fit.is_found
    assert aligned.lever.time_s[0] == pytest.approx(recording.body.time_s[0])


def test_an_hour_is_followed_through_its_drift() -> None:
    """Bursts of motion every half minute; 100 ppm is 0.36 s by the end, far more than one stroke."""
    rng = np.random.default_rng(4)

    def rate(time_s: FloatArray) -> FloatArray:
        is_moving = np.maximum(np.sin(2 * np.pi * time_s / 31.0), 0.0) ** 2
        swing = np.sin(2 * np.pi * (0.9 * time_s + 0.5 * np.sin(0.05 * time_s)))
        return np.stack([is_moving * swing * 2, is_moving * np.cos(1.7 * time_s), is_moving * np.sin(0.7 * time_s)], 1)

    body_s, lever_s = np.arange(0, 3600, 0.02), np.arange(0, 3600, 0.02) + 0.0083
    tracks = [
        ImuTrack(at, np.zeros((at.size, 3)), rate(true_s) + rng.normal(0, 0.004, (at.size, 3)))
        for at, true_s in ((body_s, body_s), (0.02 + lever_s * (1 + 1e-4), lever_s))
    ]
    recording = Recording(device=DeviceKind.HINGE, body=tracks[0], lever=tracks[1])
    aligned, fit = align_clocks(recording, ClockSettings())
    assert fit.is_found
    assert np.abs(aligned.lever.time_s - lever_s).max() < 0.002


@pytest.mark.parametrize("joint", ["trial1_3-4_y", "trial1_4-5_z"])
def test_a_real_hinge_that_never_rests_is_aligned(joint: str) -> None:
    """Real sensors on one clock, a skew put in; half a millisecond is a fiftieth of their sampling step."""
    path = HINGE_DATA / f"{joint}.npz"
    if not path.exists():
        pytest.skip("the real hinge recordings are not beside this checkout")
    data = np.load(path)
    time_s = np.arange(len(data["body_gyr"])) / 40.0
    body = ImuTrack(time_s, data["body_acc"], data["body_gyr"])
    lever = ImuTrack(0.01 + time_s * (1 + 1e-4), data["lever_acc"], data["lever_gyr"])
    aligned, fit = align_clocks(Recording(device=DeviceKind.HINGE, body=body, lever=lever), ClockSettings())
    assert fit.is_found
    assert np.abs(aligned.lever.time_s - time_s).max() < 0.0005


def test_aligning_a_minute_costs_milliseconds() -> None:
    """About 2 ms of CPU on one core; the limit is loose for busy machines."""
    recording, _ = _exact_session("pmdi", 1, 100.0)
    cost_s = []
    for _ in range(5):
        start_s = time.process_time()
        align_clocks(recording, ClockSettings())
        cost_s.append(time.process_time() - start_s)
    assert min(cost_s) < 0.02


def test_a_lag_that_wants_unlikely_sensors_is_not_believed() -> None:
    """Half a shake's period off, the speeds agree a little better, if gyroscopes' scales may differ by 12 %."""
    recording, truth = simulate_session("pmdi", seed=700150, rate_hz=50.0, profile="harsh")
    _, fit = align_clocks(recording, ClockSettings())
    clock = truth.lever_clock
    true_s = (fit.reference_s - clock.offset_s) / (1.0 + clock.drift) - fit.reference_s
    assert fit.is_found
    assert abs(fit.offset_s - true_s) < 0.002
