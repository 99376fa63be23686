"""How the inhaler moves in the room: the signals from which steps, events and measures are read."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from inhalemon.rotation import heading_of_y, normalise, rotate, tilt_from_upright, up_in
from inhalemon.settings import MotionSettings
from inhalemon.signals import at_times, moving_mean, squares
from inhalemon.values import STANDARD_GRAVITY_M_S2, AttitudeTrack, BoolArray, FloatArray, LeverTrack, Motion, Recording

RATE_HZ = 100.0  # of the grid, give or take half a step in all: hands do nothing quicker than a tremor, 12 Hz


def describe_motion(
    recording: Recording,
    attitude: AttitudeTrack,
    lever: LeverTrack,
    settings: MotionSettings | None = None,
) -> Motion:
    """Attitude, motion in the room and lever angle of a session on one even grid.

    Inertial acceleration is specific force turned into the room less gravity, and less what is left of it while the
    hand holds still (level error, accelerometer offset). Velocity comes from it by least squares with the knowledge
    that a hand at rest has none (zero-velocity updates, weighted by how still the signals are); each block of 40 ms
    is one unknown velocity and one unknown offset, a banded system. Height is its integral: good for the length of
    one movement, not of a session.
    """
    settings = settings or MotionSettings()
    body = recording.body
    # Equal steps that cover the session from its first sample to its last; the grid's times are their middles.
    length_s = float(body.time_s[-1] - body.time_s[0])
    n = max(round(length_s * RATE_HZ), 2)
    rate_hz = n / length_s
    time_s = body.time_s[0] + (np.arange(n) + 0.5) / rate_hz
    width = max(round(body.rate_hz / RATE_HZ), 1)

    q = normalise(_on_grid(time_s, attitude.time_s, attitude.q, 1))
    gyr = _on_grid(time_s, body.time_s, body.gyr_rad_s - attitude.gyr_bias_rad_s, width)
    force = _on_grid(time_s, body.time_s, body.acc_m_s2, width)
    acc_ref = rotate(q, force)
    acc_ref[:, 2] -= STANDARD_GRAVITY_M_S2
    angle = _on_grid(time_s, lever.time_s, lever.angle_rad, 1)

    is_gap = _in_gaps(time_s, body.time_s, settings.long_gap_s) | _in_gaps(
        time_s, recording.lever.time_s, settings.long_gap_s
    )
    activity = _activity(acc_ref, gyr, rate_hz, settings)
    velocity, offset = _velocity(acc_ref, activity, is_gap, rate_hz, settings)
    up = up_in(q)
    return Motion(
        time_s=time_s,
        rate_hz=rate_hz,
        tilt_rad=tilt_from_upright(q),
        elevation_rad=np.arcsin(np.clip(up[:, 1], -1.0, 1.0)),
        heading_rad=heading_of_y(q),
        sd_tilt_rad=at_times(attitude.time_s, attitude.sd_tilt_rad, time_s),
        gyr_rad_s=gyr,
        force_m_s2=force,
        acc_ref_m_s2=acc_ref - offset,
        velocity_ref_m_s=velocity,
        height_m=np.cumsum(velocity[:, 2]) / rate_hz,
        activity=activity,
        lever_rad=angle,
        lever_rate_rad_s=np.gradient(angle, 1.0 / rate_hz),
        is_gap=is_gap,
    )


def _on_grid(grid_s: FloatArray, time_s: FloatArray, values: FloatArray, width: int) -> FloatArray:
    smoothed = moving_mean(values, width) if width > 1 else values
    return at_times(time_s, smoothed, grid_s)


def _in_gaps(grid_s: FloatArray, time_s: FloatArray, long_gap_s: float) -> BoolArray:
    is_gap: BoolArray = (grid_s < time_s[0] - long_gap_s) | (grid_s > time_s[-1] + long_gap_s)
    for k in np.flatnonzero(np.diff(time_s) > long_gap_s):
        is_gap |= (grid_s > time_s[k]) & (grid_s < time_s[k + 1])
    return is_gap


def _activity(acc_ref: FloatArray, gyr: FloatArray, rate_hz: float, settings: MotionSettings) -> FloatArray:
    """How far from still, 1 at the border: the slow acceleration's spread and the slow angular rate, in squares."""
    slow = moving_mean(acc_ref, round(settings.slow_s * rate_hz))
    wide = round(settings.spread_s * rate_hz)
    spread = moving_mean(squares(slow), wide) - squares(moving_mean(slow, wide))
    turning = moving_mean(gyr, round(settings.slow_s * rate_hz))
    still_acc, still_gyr = settings.still_acc_m_s2, settings.still_gyr_rad_s
    activity: FloatArray = np.maximum(spread, 0.0) / still_acc**2 + squares(turning) / still_gyr**2
    return activity


def _velocity(
    acc_ref: FloatArray, activity: FloatArray, is_gap: BoolArray, rate_hz: float, settings: MotionSettings
) -> tuple[FloatArray, FloatArray]:
    """Velocity in the room and the acceleration's slow offset, (n, 3) each, on the grid.

    Minimises, over blocks k of length T with unknown v_k, b_k, the sum of
    (v_{k+1} - v_k - (a_k - b_k) T)^2 / (sd_acc T)^2 + v_k^2 / r_k
    + (b_{k+1} - b_k)^2 / (walk^2 T) + b_k^2 T / sd_offset^2.
    """
    n = activity.size
    size = max(round(settings.block_s * rate_hz), 1)
    edges = np.arange(0, n, size)
    m = edges.size
    dt = size / rate_hz
    lengths = np.diff(np.append(edges, n))
    acc = np.add.reduceat(acc_ref, edges, axis=0) / lengths[:, None]
    level = np.maximum.reduceat(activity, edges)
    lost = np.logical_or.reduceat(is_gap, edges)

    r = np.minimum(settings.sd_still_m_s * (1.0 + level / settings.hardly_still), settings.sd_moving_m_s) ** 2
    w_v = 1.0 / r
    w_a = np.where(lost[:-1], 1e-6, 1.0) / (settings.sd_acc_m_s2 * dt) ** 2
    w_b = 1.0 / (settings.offset_walk_m_s2_sqrt_s**2 * dt)
    # Unknowns v_0, b_0, v_1, b_1, ...; lower bands of a symmetric matrix of bandwidth 2 (upper ones take longer).
    bands = np.zeros((3, 2 * m))
    bands[0, 0::2] = w_v
    bands[0, 0:-2:2] += w_a
    bands[0, 2::2] += w_a
    bands[0, 1::2] = dt / settings.sd_offset_m_s2**2
    bands[0, 1:-2:2] += w_a * dt**2 + w_b
    bands[0, 3::2] += w_b
    bands[1, 0:-2:2] = -w_a * dt  # v_k with b_k
    bands[1, 1:-2:2] = w_a * dt  # b_k with v_{k+1}
    bands[2, 0:-2:2] = -w_a  # v_k with v_{k+1}
    bands[2, 1:-2:2] = -w_b  # b_k with b_{k+1}
    push = w_a[:, None] * 0.5 * (acc[:-1] + acc[1:]) * dt
    right = np.zeros((2 * m, 3))
    right[0:-2:2] -= push
    right[2::2] += push
    right[1:-2:2] += push * dt
    solved = solveh_banded(bands, right, lower=True, check_finite=False, overwrite_ab=True, overwrite_b=True)
    # v_k stands at the middle of its block: the acceleration between two middles is the mean of the two blocks.
    middles = edges + (lengths - 1) / 2.0
    samples = np.arange(float(n))
    return at_times(middles, solved[0::2], samples), at_times(middles, solved[1::2], samples)
