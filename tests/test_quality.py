"""What is doubtful is flagged with its code; what cannot be trusted is said to be unusable; nothing is refused here."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from inhalemon.devices import load_device
from inhalemon.pipeline import score_recording
from inhalemon.settings import ClockSettings, QualitySettings
from inhalemon.simulate import simulate_session
from inhalemon.stages.clocks import align_clocks
from inhalemon.stages.quality import assess_quality
from inhalemon.values import (
    BoolArray,
    Calibration,
    ClockFit,
    DeviceKind,
    Grade,
    ImuTrack,
    LeverTrack,
    Quality,
    Recording,
    SensorName,
    Verdict,
)

GOOD_CLOCK = ClockFit(0.0, 0.0, 0.0, 2e-4, 1e-5, is_found=True)
X_AXIS = np.array([1.0, 0.0, 0.0])


def _track(n: int = 2000, rate_hz: float = 100.0) -> ImuTrack:
    """Rest, a slow swing, rest; with a sensor's noise."""
    rng = np.random.default_rng(1)
    time_s = np.arange(n) / rate_hz
    swing = np.sin(2 * np.pi * time_s) * (np.abs(time_s - time_s.mean()) < time_s[-1] / 4)
    acc = np.array([0.0, 0.0, 9.80665]) + rng.normal(0, 0.02, (n, 3)) + swing[:, None]
    gyr = rng.normal(0, 0.002, (n, 3)) + swing[:, None] * [1.0, 0.5, -0.2]
    nothing = np.zeros(n, dtype=np.bool_)
    return ImuTrack(time_s, acc, gyr, is_acc_saturated=nothing, is_gyr_saturated=nothing)


def _recording(body: ImuTrack | None = None, lever: ImuTrack | None = None) -> Recording:
    return Recording(device=DeviceKind.PMDI, body=body or _track(), lever=lever or _track())


def _without(track: ImuTrack, is_dropped: BoolArray) -> ImuTrack:
    kept = ~is_dropped
    return ImuTrack(track.time_s[kept], track.acc_m_s2[kept], track.gyr_rad_s[kept])


def _codes(quality: Quality) -> set[tuple[str, str | None]]:
    return {(flag.code, flag.sensor) for flag in quality.flags}


def _assessed(recording: Recording, clock: ClockFit = GOOD_CLOCK) -> Quality:
    return assess_quality(recording, clock, QualitySettings())


def test_a_plain_recording_has_no_flag() -> None:
    assert _assessed(_recording()) == Quality(usable=True, flags=())


def test_a_gap_is_flagged_and_used_and_one_over_half_the_session_is_not() -> None:
    time_s = _track().time_s
    short = _without(_track(), (time_s > 5.0) & (time_s < 5.3))
    quality = _assessed(_recording(lever=short))
    assert quality.usable
    assert _codes(quality) == {("gap", "lever")}
    assert "1 gap" in quality.flags[0].detail
    assert "at 5.00 s" in quality.flags[0].detail
    long = _without(_track(), (time_s > 5.0) & (time_s < 15.0))
    assert not _assessed(_recording(lever=long)).usable


def test_single_missing_rows_at_100_hz_are_no_gap() -> None:
    rng = np.random.default_rng(0)
    thinned = _without(_track(), rng.random(2000) < 0.02)
    steps = np.diff(thinned.time_s)
    assert steps.max() < 0.05
    assert _codes(_assessed(_recording(body=thinned))) == set()


def test_saturation_is_flagged_and_makes_unusable_when_frequent() -> None:
    some = np.arange(2000) % 100 < 3
    quality = _assessed(_recording(body=dataclasses.replace(_track(), is_gyr_saturated=some)))
    assert quality.usable
    assert _codes(quality) == {("gyr_saturated", "body")}
    many = np.arange(2000) % 100 < 60
    assert not _assessed(_recording(body=dataclasses.replace(_track(), is_gyr_saturated=many))).usable
    quality = _assessed(_recording(lever=dataclasses.replace(_track(), is_acc_saturated=some)))
    assert _codes(quality) == {("acc_saturated", "lever")}


@pytest.mark.parametrize(("part", "code"), [(slice(600), "no_rest_at_start"), (slice(-600, None), "no_rest_at_end")])
def test_no_rest_at_an_end_is_a_flag(part: slice, code: str) -> None:
    gyr = _track().gyr_rad_s.copy()
    gyr[part] += 0.2 * np.sin(np.arange(600))[:, None]
    quality = _assessed(_recording(body=dataclasses.replace(_track(), gyr_rad_s=gyr)))
    assert quality.usable
    assert _codes(quality) == {(code, "body")}


def test_odd_gravity_is_a_flag_and_a_wrong_unit_is_unusable() -> None:
    odd = _assessed(_recording(lever=dataclasses.replace(_track(), acc_m_s2=_track().acc_m_s2 * 0.93)))
    assert odd.usable
    assert _codes(odd) == {("gravity_off", "lever")}
    in_g = _assessed(_recording(lever=dataclasses.replace(_track(), acc_m_s2=_track().acc_m_s2 / 9.80665)))
    assert not in_g.usable


def test_a_changed_rate_is_a_flag() -> None:
    time_s = np.concatenate([np.arange(1000) / 100.0, 10.0 + np.arange(1000) / 125.0])
    quality = _assessed(_recording(lever=dataclasses.replace(_track(), time_s=time_s)))
    assert quality.usable
    assert ("rate_changed", "lever") in _codes(quality)


def test_a_sensor_whose_numbers_stand_still_is_unusable() -> None:
    dead = dataclasses.replace(_track(), gyr_rad_s=np.zeros((2000, 3)))
    quality = _assessed(_recording(body=dead))
    assert ("stuck", "body") in _codes(quality)
    assert not quality.usable


def test_clocks_are_flagged_as_they_were_found() -> None:
    late = ClockFit(0.018, 0.0, 0.0, 3e-4, 1e-5, is_found=True)
    assert _codes(_assessed(_recording(), late)) == {("clock_offset", "lever")}
    drifting = ClockFit(0.001, 4e-4, 0.0, 3e-4, 1e-5, is_found=True)
    assert _codes(_assessed(_recording(), drifting)) == {("clock_drift", "lever")}
    unknown = ClockFit(0.0, 0.0, 0.0, 0.5, 2e-4, is_found=False)
    quality = _assessed(_recording(), unknown)
    assert quality.usable
    assert _codes(quality) == {("clock_unknown", "lever")}
    moved = ClockFit(-900.0, 0.0, 0.0, 0.5, 2e-4, is_found=False)
    assert not _assessed(_recording(), moved).usable


def test_little_common_time_is_a_flag_and_hardly_any_is_unusable() -> None:
    later = dataclasses.replace(_track(), time_s=_track().time_s + 4.0)
    quality = _assessed(_recording(lever=later))
    assert quality.usable
    assert _codes(quality) == {("short_overlap", "lever")}
    much_later = dataclasses.replace(_track(), time_s=_track().time_s + 15.0)
    assert not _assessed(_recording(lever=much_later)).usable


def _calibration(axis: np.ndarray) -> Calibration:
    n = 2000
    q_shut = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    return Calibration(np.tile(axis, (n, 1)), q_shut, *np.zeros((5, n)))


@pytest.mark.parametrize(("away_deg", "codes"), [(5.0, set()), (20.0, {("hinge_axis_off", "body")})])
def test_a_hinge_axis_away_from_the_profile_is_a_flag(away_deg: float, codes: set[tuple[str, str]]) -> None:
    axis = np.array([np.cos(np.radians(away_deg)), np.sin(np.radians(away_deg)), 0.0])
    quality = assess_quality(
        _recording(), GOOD_CLOCK, QualitySettings(), calibration=_calibration(axis), hinge_axis=X_AXIS
    )
    assert quality.usable
    assert _codes(quality) == codes


def test_an_angle_that_is_not_known_is_unusable() -> None:
    time_s = _track().time_s
    zeros = np.zeros_like(time_s)
    unsure = LeverTrack(time_s, zeros, np.full_like(time_s, 0.5), zeros)
    quality = assess_quality(_recording(), GOOD_CLOCK, QualitySettings(), lever=unsure)
    assert not quality.usable
    loose = LeverTrack(time_s, zeros, zeros, np.full_like(time_s, 0.3))
    quality = assess_quality(_recording(), GOOD_CLOCK, QualitySettings(), lever=loose)
    assert quality.usable
    assert _codes(quality) == {("off_axis", "lever")}


@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
@pytest.mark.parametrize("wrong", ["swapped", "sign"])
def test_a_lever_that_goes_to_the_wrong_side_of_shut_is_no_missing_press(device: str, wrong: str) -> None:
    recording, _ = simulate_session(device, seed=5)
    profile = load_device(device)
    if wrong == "swapped":
        recording = dataclasses.replace(recording, body=recording.lever, lever=recording.body)
    else:
        profile = dataclasses.replace(profile, hinge_sign=-1)
    report = score_recording(recording, device=profile)
    assert ("lever_backwards", "lever") in _codes(report.quality)
    assert not report.quality.usable
    assert report.score.grade is Grade.NOT_ASSESSABLE
    assert {finding.verdict for finding in report.findings} == {Verdict.NOT_ASSESSABLE}


@pytest.mark.parametrize("scale", [np.radians(1.0), np.degrees(1.0)])
@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
def test_a_gyroscope_in_another_unit_than_its_label_is_unusable(device: str, scale: float) -> None:
    recording, _ = simulate_session(device, seed=6)
    body, lever = (
        dataclasses.replace(track, gyr_rad_s=scale * track.gyr_rad_s) for track in (recording.body, recording.lever)
    )
    quality = _assessed(dataclasses.replace(recording, body=body, lever=lever))
    assert {("gyr_scale_odd", "body"), ("gyr_scale_odd", "lever")} <= _codes(quality)
    assert not quality.usable


@pytest.mark.parametrize(
    ("device", "mistake"),
    [
        ("pmdi", "no_press"),
        ("pmdi", "press_incomplete"),
        ("pmdi", "inverted_at_press"),
        ("ellipta", "cover_not_fully_open"),
        ("ellipta", "inverted_after_open"),
    ],
)
def test_a_mistake_is_not_taken_for_a_wrong_sensor(device: str, mistake: str) -> None:
    recording, _ = simulate_session(device, [mistake], seed=7, profile="harsh")
    assert score_recording(recording).quality.usable


@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
def test_simulated_sessions_are_usable_in_every_profile(device: str) -> None:
    for seed, profile in enumerate(("perfect", "typical", "harsh")):
        recording, _ = simulate_session(device, seed=seed, profile=profile)
        aligned, clock = align_clocks(recording, ClockSettings())
        quality = assess_quality(aligned, clock, QualitySettings())
        assert quality.usable, (profile, quality.flags)
        assert all(flag.sensor in tuple(SensorName) and flag.detail for flag in quality.flags)
