"""How the device is carried and turned, and where it lies on a table."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from inhalemon.settings import PhaseSettings
from inhalemon.signals import drop_short, moving_mean, quantile, squares
from inhalemon.values import BoolArray, FloatArray, Motion


@dataclass(frozen=True, slots=True)
class Path:
    """Where the device is and how it is turned, by integration: good for comparing times a few seconds apart."""

    pose: FloatArray  # (n, 3 or 6) turn about the body's axes and place in the room, in units of a clear movement
    speed: FloatArray  # (n,) of the pose, over a fifth of a second: a tremor of 5 Hz does not show
    turn_rad: FloatArray  # (n,) about the body's x: the tilt-back of the device in the hand
    elevation_rad: FloatArray  # (n,) of the body's y against level: the tilt-back of the head, whatever the roll
    place_m: FloatArray  # (n, 3) in the room
    height_m: FloatArray  # (n,)
    still_speed: float  # below it this hand holds still
    has_place: bool  # else only the turn is known, and a place means a turn as clear
    fidget: float  # in clear movements, wider in a hand that sways: what ends neither a pause nor a breath held


def path_of(motion: Motion, on_table: BoolArray, settings: PhaseSettings) -> Path:
    """The path, smoothed as little as lets the hand be still for a fair share of the time.

    A step or a road shakes a hand at 1-2 Hz that holds still all the same, and carries it along: where smoothing does
    not help, the path is that of the turn alone, of which neither has much.
    """
    in_hand = ~on_table
    tried = [(smooth_s, has_place) for has_place in (True, False) for smooth_s in settings.smooth_s]
    for smooth_s, has_place in tried:
        path = _smoothed(motion, smooth_s, settings, has_place=has_place)
        if not in_hand.any() or np.mean(path.speed[in_hand] < settings.still_speed) >= settings.min_still_share:
            break
    if not in_hand.any():
        return path
    # A hand that sways never comes below the speed of its sway.
    sway = settings.times_sway * float(quantile(path.speed[in_hand], 0.25))
    still_speed = min(max(settings.still_speed, sway), settings.max_still_speed)
    return replace(path, still_speed=still_speed, fidget=settings.fidget * still_speed / settings.still_speed)


def _smoothed(motion: Motion, smooth_s: float, settings: PhaseSettings, *, has_place: bool) -> Path:
    step = motion.step_s
    width = max(round(smooth_s * motion.rate_hz), 1)
    turned = moving_mean(np.cumsum(motion.gyr_rad_s, axis=0) * step, width)
    if has_place:
        place = moving_mean(np.cumsum(motion.velocity_ref_m_s, axis=0) * step, width)
        pose = np.concatenate([turned.T / settings.clear_turn_rad, place.T / settings.clear_move_m]).T
        height = place[:, 2]
    else:
        pose = turned / settings.clear_turn_rad
        place = pose * settings.clear_move_m
        height = np.zeros(motion.time_s.size)
    half = round(0.1 * motion.rate_hz)
    apart2 = np.zeros(motion.time_s.size)
    for column in pose.T:
        ends = np.concatenate([np.full(half, column[0]), column, np.full(half, column[-1])])
        apart2 += (ends[2 * half :] - ends[: -2 * half]) ** 2
    return Path(
        pose=pose,
        speed=np.sqrt(apart2) / (2 * half * step),
        turn_rad=turned[:, 0],
        elevation_rad=moving_mean(motion.elevation_rad, width),
        place_m=place,
        height_m=height,
        still_speed=settings.still_speed,
        has_place=has_place,
        fidget=settings.fidget,
    )


def table_mask(motion: Motion, settings: PhaseSettings) -> BoolArray:
    """Where the device lies on something that has no tremor: 6-12 Hz, below most of a sensor's noise."""
    is_quiet = np.ones(motion.time_s.size, dtype=np.bool_)
    limits = ((motion.force_m_s2, settings.table_acc_m_s2), (motion.gyr_rad_s, settings.table_gyr_rad_s))
    width = round(settings.table_window_s * motion.rate_hz)
    for values, most in limits:
        smooth = without_noise(values, motion, settings)
        # Of white noise, as much is left as was taken away, or less: what the sensor has where it is quietest.
        noise = quantile(moving_mean(squares(values - smooth), width), 0.1)
        variance = moving_mean(squares(smooth), width) - squares(moving_mean(smooth, width))
        is_quiet &= variance < most**2 + settings.noise_left * noise
    return drop_short(is_quiet, round(settings.min_table_s * motion.rate_hz))


def without_noise(values: FloatArray, motion: Motion, settings: PhaseSettings) -> FloatArray:
    return moving_mean(values, max(round(settings.noise_smooth_s * motion.rate_hz), 1))


def carried_since(path: Path, begin: int, end: int) -> int:
    """The sample since when the device is carried, in one go, to where it is at `end`; not before `begin`.

    A movement has begun where its speed first stays above a tenth of its highest.
    """
    speed = path.speed[begin:end]
    if not speed.size:
        return begin
    fastest = int(np.argmax(speed))
    slow = np.flatnonzero(speed[: fastest + 1] < 0.1 * speed[fastest])
    return begin + (int(slow[-1]) if slow.size else 0)
