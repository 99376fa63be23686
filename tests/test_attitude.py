"""Attitude: closed forms first, then simulated truth, then the filter against itself.

`gyr_delay_s=0` wherever the truth is of the very instant of the sample: real gyros answer late, made ones do not.
"""

from __future__ import annotations

import dataclasses
import importlib.machinery
import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

import inhalemon
from inhalemon import _attitude_kernel, _errors_kernel, _smoother_kernel, _source_kernel
from inhalemon.exceptions import RecordingError, SettingsError
from inhalemon.rotation import (
    about_z,
    angle_between,
    conjugate,
    from_rotation_vector,
    multiply,
    rotate,
    to_rotation_vector,
)
from inhalemon.settings import AttitudeSettings
from inhalemon.simulate import simulate_session
from inhalemon.stages import attitude as stage
from inhalemon.stages.attitude import AttitudeStream, estimate_attitude
from inhalemon.values import ImuTrack

G = 9.80665
GRAVITY = np.array([0.0, 0.0, G])
CAUSAL = AttitudeSettings(smooth=False, gyr_delay_s=0.0)
SMOOTH = AttitudeSettings(smooth=True, gyr_delay_s=0.0)
BOTH = pytest.mark.parametrize("settings", [CAUSAL, SMOOTH], ids=["causal", "smooth"])
UPRIGHT = np.array([[1.0, 0.0, 0.0, 0.0]])


def inclination_deg(q, q_true):
    error = multiply(q, conjugate(q_true))
    half = np.arctan2(np.hypot(error[..., 1], error[..., 2]), np.hypot(error[..., 0], error[..., 3]))
    return np.degrees(2 * half)


def turning(rate_rad_s, *, duration_s=20.0, rate_hz=100.0, start=(0.0, 0.0, 0.0)):
    """A sensor that turns in its place about an axis of its own at a constant rate, and its true attitude."""
    time_s = np.arange(0.0, duration_s, 1 / rate_hz)
    rate = np.asarray(rate_rad_s, dtype=float)
    q = multiply(from_rotation_vector(np.array(start)), from_rotation_vector(time_s[:, None] * rate))
    return ImuTrack(time_s, rotate(conjugate(q), GRAVITY), np.tile(rate, (time_s.size, 1))), q


def waving(seed=0, *, duration_s=40.0, rate_hz=100.0, rest_s=3.0, noise=1.0, bias_deg_s=(0.0, 0.0, 0.0)):
    """A hand that waves: smooth turns and shifts with exact rates and specific force, and rest at both ends.

    The attitude is a product of two swings, so its rate is a closed form; so is the acceleration of the shifts.
    """
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, duration_s, 1 / rate_hz)
    gate, gate1, gate2 = _gate(time_s, rest_s, duration_s - rest_s)
    pitch, roll, pitch1, roll1 = (np.zeros_like(time_s) for _ in range(4))
    acc_ref = np.zeros((time_s.size, 3))
    for _ in range(4):
        w, phase = rng.uniform(1.5, 9.0, 2), rng.uniform(0.0, 6.0, 2)
        size = rng.uniform(0.2, 1.0, 2) / w * 1.5
        pitch += size[0] * gate * np.sin(w[0] * time_s + phase[0])
        pitch1 += size[0] * (gate1 * np.sin(w[0] * time_s + phase[0]) + gate * w[0] * np.cos(w[0] * time_s + phase[0]))
        roll += size[1] * gate * np.sin(w[1] * time_s + phase[1])
        roll1 += size[1] * (gate1 * np.sin(w[1] * time_s + phase[1]) + gate * w[1] * np.cos(w[1] * time_s + phase[1]))
        v, turn, a = rng.uniform(2.0, 12.0), rng.uniform(0.0, 6.0, 3), rng.uniform(-2.0, 2.0, 3)
        wave, wave1 = np.sin(v * time_s[:, None] + turn), v * np.cos(v * time_s[:, None] + turn)
        shift = a / v**2
        acc_ref += shift * (gate2[:, None] * wave + 2 * gate1[:, None] * wave1 - gate[:, None] * v**2 * wave)
    zero = np.zeros_like(time_s)
    q_pitch = from_rotation_vector(np.stack([pitch, zero, zero], axis=1))
    q_roll = from_rotation_vector(np.stack([zero, roll, zero], axis=1))
    q = multiply(q_pitch, q_roll)
    gyr = rotate(conjugate(q_roll), np.stack([pitch1, zero, zero], axis=1)) + np.stack([zero, roll1, zero], axis=1)
    acc = rotate(conjugate(q), acc_ref + GRAVITY)
    gyr = gyr + np.radians(bias_deg_s) + noise * rng.normal(0.0, np.radians(0.1), gyr.shape)
    return ImuTrack(time_s, acc + noise * rng.normal(0.0, 0.05, acc.shape), gyr), q


def _gate(time_s, start_s, end_s):
    """Rises from 0 to 1 in 1 s after `start_s`, falls before `end_s`; with its two derivatives."""

    def rise(x):
        x = np.clip(x, 0.0, 1.0)
        return 10 * x**3 - 15 * x**4 + 6 * x**5, 30 * x**2 * (1 - x) ** 2, 60 * x - 180 * x**2 + 120 * x**3

    up, down = rise(time_s - start_s), rise(end_s - time_s)
    return (
        up[0] * down[0],
        up[1] * down[0] - up[0] * down[1],
        up[2] * down[0] - 2 * up[1] * down[1] + up[0] * down[2],
    )


# -------------------------------------------------------------------------------------------------- closed forms


@BOTH
def test_attitude_follows_a_turn_about_a_fixed_axis(settings):
    """Without noise nothing is left but rounding and a hundredth of a degree of the filter's own doubt."""
    track, q_true = turning((2.0, -1.0, 0.5), start=(0.3, 0.2, 0.0))
    estimate = estimate_attitude(track, settings)
    assert inclination_deg(estimate.q, q_true).max() < 0.02
    assert np.allclose(
        angle_between(estimate.q[:-1], estimate.q[1:]), np.linalg.norm([2.0, -1.0, 0.5]) / 100, atol=1e-4
    )


def test_gyro_alone_is_exact_for_a_turn_about_a_fixed_axis():
    track, q_true = turning((3.0, 2.0, -4.0), duration_s=60.0, rate_hz=50.0)
    estimate = estimate_attitude(track, AttitudeSettings(method="gyro"))
    assert angle_between(estimate.q, q_true).max() < 1e-9


def test_coning_leaves_a_drift_that_shrinks_with_the_square_of_the_step():
    """The classic trap: an axis that goes round, 60 times. What a sensor would take for turning is 82 degrees."""
    errors = []
    for rate_hz in (50.0, 100.0):
        time_s = np.arange(0.0, 20.0 + 0.5 / rate_hz, 1 / rate_hz)
        half, w = np.radians(5.0), 2 * np.pi * 3.0
        # q = (cos h, sin h cos wt, sin h sin wt, 0), with h half of the cone's half angle
        h = half / 2
        zero = np.zeros_like(time_s)
        q = np.stack([zero + np.cos(h), np.sin(h) * np.cos(w * time_s), np.sin(h) * np.sin(w * time_s), zero], axis=1)
        q_dot = np.stack([zero, -w * np.sin(h) * np.sin(w * time_s), w * np.sin(h) * np.cos(w * time_s), zero], axis=1)
        gyr = 2 * multiply(conjugate(q), q_dot)[:, 1:]
        track = ImuTrack(time_s, rotate(conjugate(q), GRAVITY), gyr)
        turned = estimate_attitude(track, AttitudeSettings(method="gyro")).q
        start = multiply(turned[0], conjugate(q[0]))
        errors.append(angle_between(turned[-1], multiply(start, q[-1])))
    assert errors[1] < errors[0] / 3.5
    assert np.degrees(errors[1]) < 0.5


def test_attitude_belongs_to_the_sample_time_at_a_low_rate():
    """At 40 Hz half a step is 12.5 ms: a filter that is half a step off would err by degrees here."""
    track, q_true = waving(3, rate_hz=40.0, noise=0.0)
    moving = (track.time_s > 10.0) & (track.time_s < 35.0)
    assert np.sqrt(np.mean(inclination_deg(estimate_attitude(track, SMOOTH).q, q_true)[moving] ** 2)) < 0.3


def test_delay_of_the_gyro_is_taken_back():
    """Rates that come 5 ms late: told so, the filter gives the attitude of the sample's own time."""
    track, q_true = waving(5, noise=0.0)
    late = np.stack([np.interp(track.time_s - 0.005, track.time_s, w) for w in track.gyr_rad_s.T], axis=1)
    delayed = ImuTrack(track.time_s, track.acc_m_s2, late)
    errors = [
        np.sqrt(
            np.mean(
                inclination_deg(estimate_attitude(delayed, dataclasses.replace(SMOOTH, gyr_delay_s=s)).q, q_true) ** 2
            )
        )
        for s in (0.0, 0.005)
    ]
    assert errors[1] < errors[0] / 3


# ---------------------------------------------------------------------------------------------- what must hold


@BOTH
def test_waving_hand_is_followed_within_a_degree(settings):
    errors = []
    for seed in range(4):
        track, q_true = waving(seed)
        errors.append(inclination_deg(estimate_attitude(track, settings).q, q_true)[300:])
    assert np.sqrt(np.mean(np.square(errors))) < (0.8 if settings is CAUSAL else 0.4)


@BOTH
def test_turning_the_room_about_the_vertical_changes_only_the_heading(settings):
    """What is measured does not know the heading: the first attitude may be turned, the samples stay."""
    track, _ = waving(2)
    q = estimate_attitude(track, settings).q
    turned = multiply(about_z(1.234), q)
    assert inclination_deg(q, turned).max() < 1e-6


@BOTH
def test_tilt_does_not_depend_on_how_the_chip_sits_in_the_part(settings):
    """Axes turned: the same motion seen from other axes gives the same attitude, turned likewise."""
    track, _ = waving(4)
    q_chip = from_rotation_vector(np.array([0.7, -0.4, 1.1]))
    seen = ImuTrack(track.time_s, rotate(q_chip, track.acc_m_s2), rotate(q_chip, track.gyr_rad_s))
    settings = dataclasses.replace(
        settings, clip_rate_rad_s=1e6, clip_acc_m_s2=1e6, rest_min_s=1e6
    )  # those are per axis
    q, q_seen = (estimate_attitude(t, settings).q for t in (track, seen))
    assert inclination_deg(multiply(q_seen, q_chip), q).max() < 1e-6


@BOTH
def test_the_same_samples_give_the_same_bits(settings):
    track, _ = waving(1)
    first, second = (estimate_attitude(track, settings) for _ in range(2))
    for name in ("q", "sd_tilt_rad", "gyr_bias_rad_s", "r"):
        assert np.array_equal(getattr(first, name), getattr(second, name))


def test_smoothing_in_blocks_is_the_same_to_the_bit(monkeypatch):
    track, _ = waving(1)
    whole = estimate_attitude(track, SMOOTH)
    monkeypatch.setattr(stage, "BLOCK", 300)
    in_blocks = estimate_attitude(track, SMOOTH)
    for name in ("q", "sd_tilt_rad", "gyr_bias_rad_s", "r"):
        assert np.array_equal(getattr(whole, name), getattr(in_blocks, name))


def test_later_samples_do_not_change_the_causal_estimate():
    track, _ = waving(1)
    part = ImuTrack(track.time_s[:1500], track.acc_m_s2[:1500], track.gyr_rad_s[:1500])
    assert np.array_equal(estimate_attitude(part, CAUSAL).q, estimate_attitude(track, CAUSAL).q[:1500])


def test_stream_gives_the_same_as_the_batch():
    rng = np.random.default_rng(1)
    time_s = np.cumsum(rng.uniform(0.005, 0.02, 600)) - 0.5  # times may be negative
    track = ImuTrack(time_s, GRAVITY + rng.normal(0.0, 2.0, (600, 3)), rng.normal(0.0, 1.0, (600, 3)))
    batch = estimate_attitude(track, AttitudeSettings(smooth=False))
    stream = AttitudeStream()
    for k in range(600):
        one = stream.push(time_s[k], track.acc_m_s2[k], track.gyr_rad_s[k])
        for name in ("q", "sd_tilt_rad", "gyr_bias_rad_s", "r"):
            assert np.array_equal(getattr(one, name)[0], getattr(batch, name)[k])


@pytest.mark.parametrize("method", ["akf_source", "ekf", "gyro"])
def test_stream_refuses_a_method_that_it_does_not_run(method):
    with pytest.raises(SettingsError, match=f"method is '{method}'; expected 'akf'"):
        AttitudeStream(AttitudeSettings(method=method))


def test_stream_refuses_time_that_stands_still():
    stream = AttitudeStream()
    stream.push(1.0, GRAVITY, np.zeros(3))
    with pytest.raises(RecordingError, match="increasing"):
        stream.push(1.0, GRAVITY, np.zeros(3))


# --------------------------------------------------------------------------------------------------------- bias


@BOTH
@pytest.mark.parametrize("bias_deg_s", [(5.0, -3.0, 2.0), (-20.0, 30.0, 15.0)])
def test_bias_is_found_at_rest_however_large(settings, bias_deg_s):
    """Data sheets: MPU-9250 within 5 deg/s, LSM9DS1 within 30."""
    track, q_true = waving(6, bias_deg_s=bias_deg_s)
    estimate = estimate_attitude(track, settings)
    assert np.degrees(np.abs(estimate.gyr_bias_rad_s[300] - np.radians(bias_deg_s)).max()) < 0.15
    assert inclination_deg(estimate.q, q_true)[300:].max() < 3.0


@pytest.mark.parametrize("rest", ["end", "middle"])
def test_smoothing_takes_the_bias_from_a_rest_that_comes_later(rest):
    """Nothing is at rest at the start; the first seconds are right all the same."""
    track, q_true = waving(7, bias_deg_s=(10.0, -8.0, 6.0))
    cut = slice(500, None) if rest == "end" else slice(500, 3999)
    parts = [(track, q_true)]
    if rest == "middle":  # motion, rest, motion: the end of one against the start of the other
        second, q_second = waving(7, bias_deg_s=(10.0, -8.0, 6.0))
        parts.append((second, q_second))
    acc, gyr, q = (
        np.concatenate([getattr(t, name) if name else q for t, q in parts])[cut]
        for name in ("acc_m_s2", "gyr_rad_s", "")
    )
    if rest == "middle":
        acc, gyr, q = acc[:5500], gyr[:5500], q[:5500]
    estimate = estimate_attitude(ImuTrack(np.arange(len(q)) / 100, acc, gyr), SMOOTH)
    assert np.degrees(np.abs(estimate.gyr_bias_rad_s - np.radians([10.0, -8.0, 6.0])).max()) < 0.3
    assert inclination_deg(estimate.q, q).max() < 2.0


@BOTH
def test_start_in_motion_is_found_within_seconds(settings):
    for seed in range(3):
        track, q_true = waving(seed, rest_s=-2.0)
        error = inclination_deg(estimate_attitude(track, settings).q, q_true)
        assert error[400:].max() < (6.0 if settings is CAUSAL else 2.0)
        assert np.sqrt(np.mean(error[800:] ** 2)) < 1.5


def test_large_bias_without_any_rest_is_found_from_motion_alone():
    """While recording, started in motion, 30 and 20 deg/s: R must not take the filter's own error for motion.

    It does when nothing holds R below what a hand can do, and then the filter never finds back.
    """
    unheld = dataclasses.replace(CAUSAL, r_largest_m2_s2=1e6)
    for seed in range(3):
        track, q_true = waving(seed, rest_s=-2.0, duration_s=60.0, bias_deg_s=(30.0, 20.0, 0.0))
        error, error_unheld = (
            inclination_deg(estimate_attitude(track, s).q, q_true)[1500:].max() for s in (CAUSAL, unheld)
        )
        assert error < 7.0
        assert error_unheld > 30.0


# ------------------------------------------------------------------------------------- samples not to be trusted


@BOTH
@pytest.mark.parametrize("is_told", [True, False])
def test_clipped_rates_do_harm_for_a_while_only(settings, is_told):
    """A burst beyond the range, long after the start: told or not, the filter doubts it and finds back."""
    track, q_true = waving(8, duration_s=60.0)
    burst = np.zeros_like(track.gyr_rad_s)
    inside = (track.time_s > 25.0) & (track.time_s < 25.4)
    burst[inside, 0] = 15.0 * np.sin(np.pi * (track.time_s[inside] - 25.0) / 0.4) ** 2
    turned = np.cumsum(burst[:, 0]) / 100
    q_extra = from_rotation_vector(np.stack([turned, 0 * turned, 0 * turned], axis=1))
    q_true = multiply(q_true, q_extra)
    gyr = rotate(conjugate(q_extra), track.gyr_rad_s) + burst
    acc = rotate(conjugate(q_extra), track.acc_m_s2)
    largest = np.radians(500.0)
    told = ImuTrack(track.time_s, acc, np.clip(gyr, -largest, largest), gyr_range_rad_s=largest if is_told else None)
    assert (np.abs(gyr) > largest).any()
    estimate = estimate_attitude(told, settings)
    blind = estimate_attitude(
        ImuTrack(track.time_s, acc, np.clip(gyr, -largest, largest)),
        dataclasses.replace(settings, clip_rate_rad_s=1e6),
    )
    after = track.time_s > 25.4
    error, error_blind = (np.sqrt(np.mean(inclination_deg(e.q, q_true)[after] ** 2)) for e in (estimate, blind))
    assert error < 0.7 * error_blind
    assert inclination_deg(estimate.q, q_true)[track.time_s > 35.0].max() < 3.0
    assert estimate.sd_tilt_rad[inside].max() > 1.5 * estimate.sd_tilt_rad[2000]


def test_peaks_of_coarse_readings_are_not_taken_for_clipped():
    """A smooth peak reads the same for some samples; only a chip at its range never reads more."""
    track, _ = waving(8, duration_s=60.0, rate_hz=400.0, noise=0.0)
    step = np.radians(2.0)
    coarse = dataclasses.replace(track, gyr_rad_s=np.round(3.0 * track.gyr_rad_s / step) * step / 3.0)
    gyr = np.abs(coarse.gyr_rad_s)
    is_same = (np.diff(coarse.gyr_rad_s, axis=0)[1:] == 0.0) & (np.diff(coarse.gyr_rad_s, axis=0)[:-1] == 0.0)
    least_rad_s = np.radians(60.0)
    later = coarse.time_s[2:, None] > 15.0
    assert (is_same & later & (gyr[2:] > least_rad_s) & (gyr[2:] < 0.99 * gyr[:6000].max())).any()
    sd, sd_never = (
        estimate_attitude(coarse, dataclasses.replace(CAUSAL, clip_rate_rad_s=limit)).sd_tilt_rad
        for limit in (least_rad_s, 1e6)
    )
    assert np.allclose(sd[6000:], sd_never[6000:], rtol=0.1)


@BOTH
def test_scales_and_crossed_axes_of_the_gyro_are_learned(settings):
    """1 % and 0.7 % are usual for chips as sold; whole turns, one way and another, add up what is not learned."""
    rng = np.random.default_rng(5)
    time_s = np.arange(0.0, 120.0, 0.01)
    errors = []
    for _ in range(6):
        waves = 2 * np.pi * rng.uniform(0.05, 0.3, 3) * time_s[:, None] + rng.uniform(0.0, 6.0, 3)
        gyr = 2.0 * np.sin(waves)
        q_true = np.tile(UPRIGHT, (time_s.size, 1))
        for n, turn in enumerate(from_rotation_vector((gyr[1:] + gyr[:-1]) / 2 * 0.01)):
            q_true[n + 1] = multiply(q_true[n], turn)
        shake = 3.0 * np.sin(2 * np.pi * rng.uniform(0.5, 2.0, 3) * time_s[:, None] + rng.uniform(0.0, 6.0, 3))
        off = np.eye(3) + rng.normal(0.0, 0.007, (3, 3)) + np.diag(rng.normal(0.0, 0.007, 3))
        track = ImuTrack(time_s, rotate(conjugate(q_true), shake + GRAVITY), gyr @ off.T)
        errors.append(
            [
                np.sqrt(np.mean(inclination_deg(estimate_attitude(track, how).q, q_true)[3000:] ** 2))
                for how in (settings, dataclasses.replace(settings, sd_start_scale=0.0))
            ]
        )
    learned, not_learned = np.mean(errors, axis=0)
    assert learned < 0.5 * not_learned
    assert learned < 0.5


@BOTH
@pytest.mark.parametrize("gap_s", [0.2, 0.8, 5.0])
def test_gap_widens_the_doubt_and_then_heals(settings, gap_s):
    track, q_true = waving(9, duration_s=60.0)
    kept = (track.time_s < 25.0) | (track.time_s > 25.0 + gap_s)
    estimate = estimate_attitude(ImuTrack(track.time_s[kept], track.acc_m_s2[kept], track.gyr_rad_s[kept]), settings)
    error, time_s = inclination_deg(estimate.q, q_true[kept]), track.time_s[kept]
    first = np.searchsorted(time_s, 25.0)
    if settings is CAUSAL:
        assert estimate.sd_tilt_rad[first] > 1.5 * estimate.sd_tilt_rad[first - 1]
    assert error[time_s > 33.0 + gap_s].max() < 2.5
    assert np.isfinite(estimate.q).all()


def test_uneven_steps_are_no_harm():
    track, q_true = waving(10, rate_hz=200.0)
    rng = np.random.default_rng(0)
    kept = np.sort(rng.choice(track.n_samples, track.n_samples // 2, replace=False))
    estimate = estimate_attitude(ImuTrack(track.time_s[kept], track.acc_m_s2[kept], track.gyr_rad_s[kept]), SMOOTH)
    assert np.sqrt(np.mean(inclination_deg(estimate.q, q_true[kept]) ** 2)) < 0.6


@pytest.mark.parametrize("method", ["akf", "akf_source", "ekf", "gyro"])
@pytest.mark.parametrize("n", [1, 2, 7])
def test_few_samples_are_enough_to_be_finite(method, n):
    track = ImuTrack(np.arange(n) / 100, np.tile(GRAVITY, (n, 1)), np.zeros((n, 3)))
    estimate = estimate_attitude(track, AttitudeSettings(method=method))
    assert inclination_deg(estimate.q, UPRIGHT).max() < 1e-6
    assert np.isfinite(estimate.sd_tilt_rad).all()


def test_upside_down_and_weightless_starts_are_finite():
    for acc in (-GRAVITY, np.zeros(3)):
        track = ImuTrack(np.arange(300) / 100, np.tile(acc, (300, 1)), np.zeros((300, 3)))
        for settings in (CAUSAL, SMOOTH, AttitudeSettings(method="ekf")):
            assert np.isfinite(estimate_attitude(track, settings).q).all()


def test_accelerometer_that_reads_too_little_is_no_harm_to_the_tilt():
    """At rest |a| reads 9.45: a scale error leaves the direction alone."""
    track, q_true = waving(11)
    weak = ImuTrack(track.time_s, track.acc_m_s2 * (9.45 / G), track.gyr_rad_s)
    assert np.sqrt(np.mean(inclination_deg(estimate_attitude(weak, SMOOTH).q, q_true) ** 2)) < 0.5


# ------------------------------------------------------------------------------------------------------- honesty


@BOTH
def test_sd_of_tilt_agrees_with_the_error_on_simulated_sessions(settings):
    """Error over what is claimed, per axis, with both chips' data-sheet errors: 1, give or take 0.3."""
    ratios = []
    for device in ("pmdi", "ellipta"):
        for seed in range(6):
            recording, truth = simulate_session(device, seed=seed)
            for track, q_true in ((recording.body, truth.q_ref_body), (recording.lever, truth.q_ref_lever)):
                estimate = estimate_attitude(track, settings)
                error = np.radians(inclination_deg(estimate.q, q_true))
                ratios.append(np.mean(error**2 / 2 / estimate.sd_tilt_rad**2))
    assert 0.7 < np.sqrt(np.mean(ratios)) < 1.3


@BOTH
def test_sd_of_tilt_agrees_with_the_error_of_trimmed_sensors(settings):
    """Without offset and mounting error the filter's own part stands alone.

    It may claim too much doubt, since this hand is tamer than those the filter is made for; never too little.
    """
    settings = dataclasses.replace(settings, sd_acc_bias_m_s2=0.0, sd_delay_s=0.0)
    ratios = []
    for seed in range(10):
        track, q_true = waving(seed, duration_s=30.0)
        track = dataclasses.replace(track, gyr_rad_s=track.gyr_rad_s * (1 + 0.01 * np.sin(seed + np.arange(3))))
        estimate = estimate_attitude(track, settings)
        error = np.radians(inclination_deg(estimate.q, q_true))
        ratios.append(np.mean(error**2 / 2 / estimate.sd_tilt_rad**2))
    assert 0.2 < np.sqrt(np.mean(ratios)) < 1.3


def test_adaptive_r_rises_with_motion_and_falls_at_rest():
    track, _ = waving(3)
    r = estimate_attitude(track, CAUSAL).r
    assert r[2000] > 2 * r[-1]


# --------------------------------------------------------------------------------------- compiled and plain Python


def plain_python(module):
    """The same source, loaded as Python whatever was compiled beside it."""
    path = Path(inhalemon.__file__).parent / f"{module.__name__.rpartition('.')[2]}.py"
    loader = importlib.machinery.SourceFileLoader(f"plain_{path.stem}", str(path))
    spec = importlib.util.spec_from_loader(loader.name, loader)
    assert spec is not None
    loaded = importlib.util.module_from_spec(spec)
    loader.exec_module(loaded)
    return loaded


@pytest.mark.parametrize("method", ["akf", "akf_source", "ekf", "gyro"])
@pytest.mark.parametrize("smooth", [False, True])
def test_compiled_kernel_and_python_agree(method, smooth, monkeypatch):
    """To the bit: the same operations in the same order, and none whose rounding a library may choose."""
    if str(_attitude_kernel.__file__).endswith(".py"):
        pytest.skip("the kernel is not compiled here")
    track, _ = waving(12, duration_s=6.0, rest_s=1.5)
    kept = (track.time_s < 3.0) | (track.time_s > 3.1)
    gyr = np.clip(track.gyr_rad_s[kept], -1.5, 1.5)
    track = ImuTrack(track.time_s[kept], track.acc_m_s2[kept], gyr, gyr_range_rad_s=1.5)
    settings = AttitudeSettings(method=method, smooth=smooth)
    compiled = estimate_attitude(track, settings)
    for module in (_errors_kernel, _attitude_kernel, _smoother_kernel, _source_kernel):  # each before who uses it
        monkeypatch.setitem(sys.modules, module.__name__, plain_python(module))
    monkeypatch.setattr(stage, "kernel", sys.modules[_attitude_kernel.__name__])
    monkeypatch.setattr(stage, "smoothing", sys.modules[_smoother_kernel.__name__])
    monkeypatch.setattr(stage, "source_kernel", sys.modules[_source_kernel.__name__])
    python = estimate_attitude(track, settings)
    for name in ("q", "sd_tilt_rad", "gyr_bias_rad_s", "r"):
        np.testing.assert_array_equal(getattr(compiled, name), getattr(python, name), err_msg=name)


# ------------------------------------------------------------------------------------------------------ settings


def test_method_may_be_a_plain_string():
    assert AttitudeSettings(method="akf").method == "akf"
    with pytest.raises(SettingsError, match="akf_source"):
        AttitudeSettings(method="madgwick")


def test_default_settings_are_used_without_settings():
    track, _ = waving(0, duration_s=12.0)
    assert np.array_equal(estimate_attitude(track).q, estimate_attitude(track, AttitudeSettings()).q)


def test_half_angle_of_a_long_turn_is_exact():
    """One step of 3 rad: the series is halved until it is short, then doubled back."""
    track = ImuTrack(np.array([0.0, 0.3]), np.tile(GRAVITY, (2, 1)), np.tile([6.0, -8.0, 0.0], (2, 1)))
    q = estimate_attitude(track, AttitudeSettings(method="gyro")).q
    turned = to_rotation_vector(multiply(conjugate(q[0]), q[1]))
    assert np.allclose(turned, [1.8, -2.4, 0.0], atol=1e-12)
