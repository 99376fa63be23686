"""Attitude: closed forms first, then other people's numbers."""

import numpy as np
import pytest

from inhalemon.exceptions import SettingsError
from inhalemon.rotation import angle_between, conjugate, from_rotation_vector, multiply, rotate
from inhalemon.settings import AttitudeSettings
from inhalemon.stages.attitude import estimate_attitude
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
    attitude = estimate_attitude(track, AttitudeSettings(smooth=False))
    assert inclination_rad(attitude.q, q_true).max() < 1e-3
    turned = angle_between(attitude.q[:-1], attitude.q[1:])
    assert np.allclose(turned, np.linalg.norm([2.0, -1.0, 0.5]) / 100, atol=1e-4)


def test_method_may_be_a_plain_string():
    assert AttitudeSettings(method="akf").method == "akf"
    with pytest.raises(SettingsError, match="akf_source"):
        AttitudeSettings(method="madgwick")
