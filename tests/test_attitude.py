"""Attitude: closed forms first, then other people's numbers."""

import numpy as np
import pytest

from inhalemon.exceptions import SettingsError
from inhalemon.rotation import angle_between, conjugate, from_rotation_vector, multiply, rotate
from inhalemon.settings import AttitudeSettings
from inhalemon.stages.attitude import AttitudeStream, estimate_attitude
from inhalemon.values import ImuTrack

GRAVITY = np.array([0.0, 0.0, 9.80665])


def turning(rate_rad_s, *, duration_s=20.0, rate_hz=100.0, start=(0.0, 0.0, 0.0)):
    """A sensor that turns about a fixed axis of its own at a constant rate, and its true attitude."""
    time_s = np.arange(0.0, duration_s, 1 / rate_hz)
    rate = np.asarray(rate_rad_s, dtype=float)
    q = multiply(from_rotation_vector(np.array(start)), from_rotation_vector(time_s[:, None] * rate))
    return ImuTrack(time_s, rotate(conjugate(q), GRAVITY), np.tile(rate, (time_s.size, 1))), q


def inclination_rad(q, q_true):
    error = multiply(q, conjugate(q_true))
    return 2 * np.arctan2(np.hypot(error[:, 1], error[:, 2]), np.hypot(error[:, 0], error[:, 3]))


def test_attitude_follows_a_turn_about_a_fixed_axis_exactly():
    """Free of noise, nothing is left but rounding: the exponential is exact."""
    track, q_true = turning((2.0, -1.0, 0.5), start=(0.3, 0.2, 0.0))
    attitude = estimate_attitude(track, AttitudeSettings(smooth=False, gyr_delay_s=0.0))
    assert inclination_rad(attitude.q, q_true).max() < 1e-3
    turned = angle_between(attitude.q[:-1], attitude.q[1:])
    assert np.allclose(turned, np.linalg.norm([2.0, -1.0, 0.5]) / 100, atol=1e-4)


def test_method_may_be_a_plain_string():
    assert AttitudeSettings(method="akf").method == "akf"
    with pytest.raises(SettingsError, match="akf_source"):
        AttitudeSettings(method="madgwick")


@pytest.mark.parametrize("method", ["akf", "akf_source", "ekf", "gyro"])
def test_every_method_finds_a_still_sensor_upright(method):
    time_s = np.arange(0.0, 4.0, 0.01)
    track = ImuTrack(time_s, np.tile(GRAVITY, (time_s.size, 1)), np.zeros((time_s.size, 3)))
    attitude = estimate_attitude(track, AttitudeSettings(method=method))
    assert attitude.q.shape == (time_s.size, 4)
    assert inclination_rad(attitude.q, np.array([[1.0, 0.0, 0.0, 0.0]])).max() < 1e-6


def test_stream_gives_the_same_as_the_batch():
    rng = np.random.default_rng(1)
    time_s = np.cumsum(rng.uniform(0.005, 0.02, 500))
    track = ImuTrack(time_s, GRAVITY + rng.normal(0.0, 2.0, (500, 3)), rng.normal(0.0, 1.0, (500, 3)))
    batch = estimate_attitude(track, AttitudeSettings(smooth=False))
    stream = AttitudeStream()
    for k in range(500):
        one = stream.push(time_s[k], track.acc_m_s2[k], track.gyr_rad_s[k])
        assert np.array_equal(one.q[0], batch.q[k])
        assert np.array_equal(one.sd_tilt_rad, batch.sd_tilt_rad[k : k + 1])
        assert np.array_equal(one.gyr_bias_rad_s[0], batch.gyr_bias_rad_s[k])
