"""The motion in the room, of movements in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from motions import G_M_S2, least_jerk

import inhalemon as im
from inhalemon.rotation import conjugate, from_rotation_vector, rotate
from inhalemon.stages.motion import describe_motion
from inhalemon.values import AttitudeTrack, LeverTrack, Motion

UP = np.array([0.0, 0.0, 1.0])


def described(
    *, rate_hz: float = 100.0, way_m: float = 0.4, tilt_rad: float = 0.0, offset_m_s2: float = 0.0, lost=(0.0, 0.0)
) -> Motion:
    """Eight seconds in which the device, tilted back, is lifted within 0.8 s from the third second on."""
    time_s = np.arange(round(8.0 * rate_hz)) / rate_hz
    time_s = time_s[(time_s < lost[0]) | (time_s >= lost[1])]
    n = time_s.size
    x = np.clip((time_s - 3.0) / 0.8, 0.0, 1.0)
    lift = way_m / 0.8**2 * (60.0 * x - 180.0 * x**2 + 120.0 * x**3)  # second derivative of the least-jerk course
    q = np.tile(from_rotation_vector(np.array([tilt_rad, 0.0, 0.0])), (n, 1))
    force = rotate(conjugate(q), (G_M_S2 + lift)[:, None] * UP) + offset_m_s2 * UP
    zero = np.zeros(n)
    body = im.ImuTrack(time_s, force, np.zeros((n, 3)))
    recording = im.Recording(device="pmdi", body=body, lever=body)
    attitude = AttitudeTrack(time_s, q, zero + 0.01, np.zeros((n, 3)), zero, r_unit="m2/s2")
    return describe_motion(recording, attitude, LeverTrack(time_s, zero, zero + 0.01, zero))


def height_at(motion: Motion, at_s: float) -> float:
    return float(motion.height_m[motion.index(at_s)])


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0])
@pytest.mark.parametrize("offset_m_s2", [0.0, 0.2])
@pytest.mark.parametrize("tilt_rad", [0.0, 0.5])
def test_a_lift_is_as_high_and_as_quick_as_it_was(rate_hz, offset_m_s2, tilt_rad):
    """Within 2 cm of 40 and 5 % of the speed, with an offset of 20 mg too: a hand at rest before and after tells it."""
    motion = described(rate_hz=rate_hz, offset_m_s2=offset_m_s2, tilt_rad=tilt_rad)
    assert height_at(motion, 4.3) - height_at(motion, 2.7) == pytest.approx(0.4, abs=0.02)
    assert motion.velocity_ref_m_s[:, 2].max() == pytest.approx(1.875 * 0.4 / 0.8, rel=0.05)
    course = least_jerk(motion.time_s, 3.0, 0.8) * 0.4
    during = (motion.time_s > 2.7) & (motion.time_s < 4.3)
    assert np.abs(motion.height_m - height_at(motion, 2.7) - course)[during].max() < 0.02


def test_a_device_that_does_not_move_stays_where_it_is():
    """To 5 mm in 8 s, with an offset of 20 mg that would be 6 m when summed up twice."""
    motion = described(way_m=0.0, offset_m_s2=0.2)
    assert np.ptp(motion.height_m) < 0.005
    assert motion.activity.max() < 0.1


@pytest.mark.parametrize("tilt_deg", [0.0, 30.0, 60.0, 120.0])
def test_tilt_is_from_upright_and_elevation_from_level(tilt_deg):
    motion = described(tilt_rad=np.radians(tilt_deg), way_m=0.0)
    assert np.degrees(motion.tilt_rad) == pytest.approx(tilt_deg, abs=1e-6)
    assert np.degrees(motion.elevation_rad) == pytest.approx(min(tilt_deg, 180.0 - tilt_deg), abs=1e-6)


@pytest.mark.parametrize("rate_hz", [25.0, 50.0, 100.0, 400.0])
def test_the_grid_has_100_hz_at_every_rate_and_covers_the_session(rate_hz):
    """Its steps are a hundredth of a second, give or take half of one over the whole session."""
    motion = described(rate_hz=rate_hz)
    length_s = 8.0 - 1.0 / rate_hz
    assert motion.time_s.size == pytest.approx(100.0 * length_s, abs=0.5)
    assert np.diff(motion.time_s) == pytest.approx(length_s / motion.time_s.size)
    assert motion.rate_hz == pytest.approx(motion.time_s.size / length_s)
    assert (motion.edge_s(0), motion.edge_s(motion.time_s.size)) == pytest.approx((0.0, length_s), abs=1e-9)


def test_a_long_gap_is_marked_and_a_short_one_is_bridged():
    motion = described(lost=(5.0, 5.5))
    marked_s = motion.time_s[motion.is_gap]
    assert (marked_s[0], marked_s[-1]) == pytest.approx((5.0, 5.5), abs=0.02)
    assert not described(lost=(5.0, 5.05)).is_gap.any()
