"""The helpers on sampled signals, against what they say of themselves written plainly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from inhalemon.rotation import angle_between, from_rotation_vector
from inhalemon.signals import at_times, means_between, moving_mean, quantile, resample_attitude
from inhalemon.values import AttitudeTrack, usual_step_s


@given(st.integers(1, 40), st.integers(1, 50), st.sampled_from([(), (3,)]))
def test_moving_mean_is_the_mean_of_what_the_window_holds(n, width, more):
    values = np.random.default_rng(n).standard_normal((n, *more))
    means = moving_mean(values, width)
    assert means.shape == values.shape
    for k in range(n):
        first, last = max(k - width // 2, 0), min(k + width - width // 2, n)
        np.testing.assert_allclose(means[k], values[first:last].mean(axis=0), atol=1e-12)


@given(st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=30), st.floats(0.0, 1.0))
def test_quantile_is_numpys(values, share):
    assert quantile(np.array(values), share) == pytest.approx(np.quantile(values, share), abs=1e-12)


@given(st.lists(st.integers(1, 50), min_size=1, max_size=30))
def test_usual_step_is_the_median_step(steps):
    time_s = np.cumsum([0, *steps]) / 64.0
    assert usual_step_s(time_s) == np.median(np.diff(time_s))


@pytest.mark.parametrize(("n_times", "n_values"), [(0, 0), (5, 4), (4, 5)])
@pytest.mark.parametrize("helper", [at_times, means_between])
def test_times_and_values_that_do_not_match_are_refused(helper, n_times, n_values):
    """The compiled kernel would read beyond the shorter one."""
    with pytest.raises(ValueError, match=f"{n_values} values at {n_times} times"):
        helper(np.arange(float(n_times)), np.zeros((n_values, 3)), np.array([0.5, 1.5]))


def test_attitude_between_samples_is_on_the_way_and_held_beyond_the_ends():
    time_s = np.array([0.0, 0.1, 0.3, 0.35])
    turn = np.array([1.0, 2.0, -0.5])
    track = AttitudeTrack(
        time_s=time_s,
        q=from_rotation_vector(time_s[:, None] * turn) * np.array([1.0, -1.0, 1.0, -1.0])[:, None],
        sd_tilt_rad=time_s,
        gyr_bias_rad_s=time_s[:, None] * turn,
        r=-time_s,
    )
    at = np.array([-1.0, 0.0, 0.04, 0.1, 0.2, 0.349, 0.35, 9.0])
    held = np.clip(at, 0.0, 0.35)
    there = resample_attitude(track, at)
    np.testing.assert_array_equal(there.time_s, at)
    assert angle_between(there.q, from_rotation_vector(held[:, None] * turn)).max() < 1e-7
    np.testing.assert_allclose(there.sd_tilt_rad, held, atol=1e-15)
    np.testing.assert_allclose(there.gyr_bias_rad_s, held[:, None] * turn, atol=1e-15)
    np.testing.assert_allclose(there.r, -held, atol=1e-15)
