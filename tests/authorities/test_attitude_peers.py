"""Attitude beside other people's programs, run here and now, and beside the optical truth of BROAD."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from vqf import VQF, offlineVQF

from inhalemon.rotation import conjugate, multiply
from inhalemon.settings import AttitudeSettings
from inhalemon.simulate import simulate_session
from inhalemon.stages.attitude import estimate_attitude
from validation import attitude as broad

needs_broad = pytest.mark.skipif(not broad.DATA.exists(), reason="BROAD is not beside the repository (shared/data)")


def inclination_deg(p, q):
    return np.degrees(broad.inclination_rad(np.asarray(p), np.asarray(q)))


def test_heading_and_tilt_agree_with_vqf_on_a_simulated_session():
    """Two programs, one motion: after the first seconds they differ by less than the errors of either."""
    recording, truth = simulate_session("ellipta", seed=3, profile="perfect")
    track = recording.body
    q = estimate_attitude(track, AttitudeSettings(smooth=False, gyr_delay_s=0.0)).q
    # VQF takes a rate for the mean over the step before it
    gyr = np.concatenate([track.gyr_rad_s[:1], (track.gyr_rad_s[1:] + track.gyr_rad_s[:-1]) / 2])
    q_vqf = VQF(1 / track.rate_hz).updateBatch(gyr, track.acc_m_s2)["quat6D"]
    later = track.time_s > 5.0
    assert np.sqrt(np.mean(inclination_deg(q, q_vqf)[later] ** 2)) < 1.0
    # From one moment to another both must have turned alike, heading included: 4 deg is 0.1 deg/s of bias for 40 s,
    # as well as either can know it while recording.
    from_then = [multiply(conjugate(p[500]), p[later][-1]) for p in (q, q_vqf, truth.q_ref_body)]
    for other in from_then[1:]:
        assert 2 * np.degrees(np.arccos(min(1.0, abs(float(np.dot(from_then[0], other)))))) < 4.0


@cache
def errors() -> dict[str, np.ndarray]:
    trials = broad.load_trials()
    return {name: np.array([broad.rmse_deg(t, broad.FILTERS[name](t.track)) for t in trials]) for name in broad.PAIRS}


@needs_broad
def test_causal_filter_is_ahead_of_vqf_on_broad():
    ours, vqf = errors()["akf"], errors()["VQF"]
    assert ours.mean() < vqf.mean()
    assert (ours / vqf).max() < 1.15


@needs_broad
def test_smoothed_filter_is_not_behind_offline_vqf_on_broad():
    assert errors()["akf smooth"].mean() <= errors()["offlineVQF"].mean()


@needs_broad
def test_gyro_bias_is_no_harm_on_broad():
    """5 deg/s, which is the MPU-9250's data sheet; VQF clips its bias at 2 deg/s and is not asked."""
    trials = broad.load_trials()[:4]
    for trial in trials:
        plain, biased = (
            broad.rmse_deg(t, broad.FILTERS["akf smooth"](t.track)) for t in (trial, broad.biased(trial, 5.0))
        )
        assert biased == pytest.approx(plain, abs=0.02)


@needs_broad
def test_clipped_trials_are_ahead_of_vqf():
    trials = [broad.clipped(trial) for trial in broad.load_trials()]
    for name, peer in (("akf", "VQF"), ("akf smooth", "offlineVQF")):
        ours, theirs = (np.mean([broad.rmse_deg(t, broad.FILTERS[f](t.track)) for t in trials]) for f in (name, peer))
        assert ours < 0.8 * theirs


def test_offline_vqf_and_we_agree_on_a_simulated_session():
    recording, _ = simulate_session("pmdi", seed=5, profile="perfect")
    track = recording.lever
    q = estimate_attitude(track, AttitudeSettings(gyr_delay_s=0.0)).q
    gyr = np.concatenate([track.gyr_rad_s[:1], (track.gyr_rad_s[1:] + track.gyr_rad_s[:-1]) / 2])
    q_vqf = offlineVQF(gyr, track.acc_m_s2, None, 1 / track.rate_hz)["quat6D"]
    assert np.sqrt(np.mean(inclination_deg(q, q_vqf) ** 2)) < 0.5
