"""Smooth motion with exact derivatives: what each chip of the inhaler would feel without any error.

The hand's pose is seven coordinates in time: position `x, y, z` of the grip in the room (m), `yaw, pitch, roll` (rad;
the attitude is Rz(yaw) Rx(pitch) Ry(roll), so pitch is the tilt-back) and the lever's angle (rad). Each is a sum of
parts whose first and second derivatives are written down, so rates and specific force are exact, lever arms included.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from inhalemon.rotation import from_rotation_vector, multiply
from inhalemon.values import STANDARD_GRAVITY_M_S2, FloatArray

N_COORDINATES: Final = 7
X, Y, Z, YAW, PITCH, ROLL, LEVER = range(N_COORDINATES)


@dataclass(frozen=True, slots=True)
class Glide:
    """A change of one coordinate along a minimum-jerk curve (Flash and Hogan 1985).

    `end_speed` is the speed at the end in units of change / duration; it is not 0 where an end stop takes the rest.
    """

    coordinate: int
    start_s: float
    duration_s: float
    change: float
    end_speed: float = 0.0


@dataclass(frozen=True, slots=True)
class Wave:
    """Sines on several coordinates under one smooth envelope: shaking, tremor, sway.

    The phase runs on a warped time, `t + depth sin(w t) / w`, so that the tempo varies.
    """

    rise_start_s: float
    rise_s: float
    fall_start_s: float
    fall_s: float
    frequency_hz: FloatArray  # (k,)
    sine: FloatArray  # (k, 7)
    cosine: FloatArray  # (k, 7)
    warp_depth: float = 0.0
    warp_hz: float = 1.0


@dataclass(frozen=True, slots=True)
class Ring:
    """A decaying vibration that starts with a given `speed` (an end stop) or from rest (a `knock`)."""

    coordinate: int
    start_s: float
    frequency_hz: float
    decay_s: float
    speed: float = 0.0
    knock: float = 0.0  # amplitude


@dataclass(frozen=True, slots=True)
class Geometry:
    """Where the chips sit: from the grip to the body's chip and to the hinge, from the hinge to the lever's chip."""

    body_chip_m: FloatArray  # (3,) body frame
    hinge_m: FloatArray  # (3,) body frame
    lever_chip_m: FloatArray  # (3,) lever frame


@dataclass(frozen=True, slots=True)
class Motion:
    """A session's motion; evaluate it at increasing times."""

    start: FloatArray  # (7,)
    glides: tuple[Glide, ...]
    waves: tuple[Wave, ...]
    rings: tuple[Ring, ...]
    geometry: Geometry

    def coordinates(self, time_s: FloatArray) -> FloatArray:
        """Values, rates and accelerations of the seven coordinates, shape (3, 7, n)."""
        c = np.zeros((3, N_COORDINATES, time_s.size))
        c[0] = self.start[:, None]
        for glide in self.glides:
            _add_glide(c, time_s, glide)
        for wave in self.waves:
            _add_wave(c, time_s, wave)
        for ring in self.rings:
            _add_ring(c, time_s, ring)
        return c

    def attitude(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`q_ref_body` (n, 4) and the lever's angle (n,)."""
        value = self.coordinates(time_s)[0]
        return _attitude(value), value[LEVER]

    def body_signals(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Exact specific force (n, 3) and angular rate (n, 3) of the body's chip, body frame."""
        force, rate, turning = _grip(self.coordinates(time_s))
        return (force + _arm(rate, turning, self.geometry.body_chip_m)).T, rate.T

    def lever_signals(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Exact specific force (n, 3) and angular rate (n, 3) of the lever's chip, lever frame."""
        c = self.coordinates(time_s)
        force, rate, turning = _grip(c)
        force = force + _arm(rate, turning, self.geometry.hinge_m)
        angle, angle_rate, angle_acc = c[:, LEVER]
        cosine, sine = np.cos(angle), np.sin(angle)
        force, rate, turning = (_turned_about_x(v, cosine, -sine) for v in (force, rate, turning))
        # d/dt of the rate in the turning lever frame: the frame itself turns about x by angle_rate.
        turning = turning + np.stack([angle_acc, angle_rate * rate[2], -angle_rate * rate[1]])
        rate = rate + np.stack([angle_rate, np.zeros_like(angle), np.zeros_like(angle)])
        return (force + _arm(rate, turning, self.geometry.lever_chip_m)).T, rate.T

    def acceleration(self, time_s: FloatArray) -> FloatArray:
        """Exact acceleration (n, 3) of the body's chip in the room, gravity not included."""
        c = self.coordinates(time_s)
        force, rate, turning = _grip(c)
        force = force + _arm(rate, turning, self.geometry.body_chip_m)
        _, _, _, yaw, pitch, roll, _ = c[0]
        v = _turned_about_y(force, np.cos(roll), np.sin(roll))
        v = _turned_about_x(v, np.cos(pitch), np.sin(pitch))
        v = _turned_about_z(v, np.cos(yaw), np.sin(yaw))
        v[2] -= STANDARD_GRAVITY_M_S2
        return v.T


def _attitude(value: FloatArray) -> FloatArray:
    zero = np.zeros_like(value[YAW])
    q_yaw = from_rotation_vector(np.stack([zero, zero, value[YAW]], axis=-1))
    q_pitch = from_rotation_vector(np.stack([value[PITCH], zero, zero], axis=-1))
    q_roll = from_rotation_vector(np.stack([zero, value[ROLL], zero], axis=-1))
    return multiply(multiply(q_yaw, q_pitch), q_roll)


def _grip(c: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Specific force at the grip, angular rate and angular acceleration, body frame, each (3, n)."""
    a, b, r = c[0, YAW], c[0, PITCH], c[0, ROLL]
    a1, b1, r1 = c[1, YAW], c[1, PITCH], c[1, ROLL]
    a2, b2, r2 = c[2, YAW], c[2, PITCH], c[2, ROLL]
    cb, sb, cr, sr = np.cos(b), np.sin(b), np.cos(r), np.sin(r)
    rate = np.stack([cr * b1 - sr * cb * a1, sb * a1 + r1, sr * b1 + cr * cb * a1])
    turning = np.stack(
        [
            cr * b2 - sr * r1 * b1 - cr * r1 * cb * a1 + sr * sb * b1 * a1 - sr * cb * a2,
            cb * b1 * a1 + sb * a2 + r2,
            sr * b2 + cr * r1 * b1 - sr * r1 * cb * a1 - cr * sb * b1 * a1 + cr * cb * a2,
        ]
    )
    v = c[2, :3].copy()
    v[2] += STANDARD_GRAVITY_M_S2
    v = _turned_about_z(v, np.cos(a), -np.sin(a))
    v = _turned_about_x(v, cb, -sb)
    return _turned_about_y(v, cr, -sr), rate, turning


def _arm(rate: FloatArray, turning: FloatArray, arm_m: FloatArray) -> FloatArray:
    """The pull of an arm: turning x arm + rate x (rate x arm), for vectors (3, n) and one arm (3,)."""
    x, y, z = arm_m
    wx, wy, wz = rate
    ax, ay, az = turning
    along = wx * x + wy * y + wz * z
    square = wx * wx + wy * wy + wz * wz
    return np.stack(
        [
            ay * z - az * y + wx * along - square * x,
            az * x - ax * z + wy * along - square * y,
            ax * y - ay * x + wz * along - square * z,
        ]
    )


def _turned_about_x(v: FloatArray, cosine: FloatArray, sine: FloatArray) -> FloatArray:
    return np.stack([v[0], cosine * v[1] - sine * v[2], sine * v[1] + cosine * v[2]])


def _turned_about_y(v: FloatArray, cosine: FloatArray, sine: FloatArray) -> FloatArray:
    return np.stack([cosine * v[0] + sine * v[2], v[1], cosine * v[2] - sine * v[0]])


def _turned_about_z(v: FloatArray, cosine: FloatArray, sine: FloatArray) -> FloatArray:
    return np.stack([cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1], v[2]])


def smooth_step(u: FloatArray, end_speed: float = 0.0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Minimum-jerk step from 0 to 1 over u in [0, 1], with its first and second derivatives in u."""
    s = end_speed
    c3, c4, c5 = 10 - 4 * s, -15 + 7 * s, 6 - 3 * s
    square = u * u
    value = square * u * (c3 + u * (c4 + u * c5))
    rate = square * (3 * c3 + u * (4 * c4 + u * 5 * c5))
    acceleration = u * (6 * c3 + u * (12 * c4 + u * 20 * c5))
    return value, rate, acceleration


def _add_glide(c: FloatArray, time_s: FloatArray, glide: Glide) -> None:
    i, j = np.searchsorted(time_s, [glide.start_s, glide.start_s + glide.duration_s])
    value, rate, acceleration = smooth_step((time_s[i:j] - glide.start_s) / glide.duration_s, glide.end_speed)
    k = glide.coordinate
    c[0, k, i:j] += glide.change * value
    c[0, k, j:] += glide.change
    c[1, k, i:j] += glide.change / glide.duration_s * rate
    c[2, k, i:j] += glide.change / glide.duration_s**2 * acceleration


def _add_wave(c: FloatArray, time_s: FloatArray, wave: Wave) -> None:
    i, j = np.searchsorted(time_s, [wave.rise_start_s, wave.fall_start_s + wave.fall_s])
    if i == j:
        return
    t = time_s[i:j] - wave.rise_start_s
    e = np.zeros((3, t.size))
    up = smooth_step(np.clip(t / wave.rise_s, 0.0, 1.0))
    down = smooth_step(np.clip((t - (wave.fall_start_s - wave.rise_start_s)) / wave.fall_s, 0.0, 1.0))
    for order in range(3):
        e[order] = up[order] / wave.rise_s**order - down[order] / wave.fall_s**order
    w = 2 * np.pi * wave.warp_hz
    warped = t + wave.warp_depth / w * np.sin(w * t)
    pace, pace_rate = 1.0 + wave.warp_depth * np.cos(w * t), -wave.warp_depth * w * np.sin(w * t)
    omega = 2 * np.pi * wave.frequency_hz
    phase = omega[:, None] * warped
    sine, cosine = np.sin(phase), np.cos(phase)
    s0 = wave.sine.T @ sine + wave.cosine.T @ cosine
    first = (wave.sine * omega[:, None]).T @ cosine - (wave.cosine * omega[:, None]).T @ sine
    second = -((wave.sine * omega[:, None] ** 2).T @ sine + (wave.cosine * omega[:, None] ** 2).T @ cosine)
    s1 = first * pace
    s2 = second * pace**2 + first * pace_rate
    c[0, :, i:j] += e[0] * s0
    c[1, :, i:j] += e[1] * s0 + e[0] * s1
    c[2, :, i:j] += e[2] * s0 + 2 * e[1] * s1 + e[0] * s2


def _add_ring(c: FloatArray, time_s: FloatArray, ring: Ring) -> None:
    i, j = np.searchsorted(time_s, [ring.start_s, ring.start_s + 12 * ring.decay_s])  # e^-12: nothing is left
    t = time_s[i:j] - ring.start_s
    w, damping = 2 * np.pi * ring.frequency_hz, 1.0 / ring.decay_s
    fade = np.exp(-damping * t)
    sine, cosine = np.sin(w * t), np.cos(w * t)
    s0 = fade * sine
    s1 = fade * (w * cosine - damping * sine)
    s2 = fade * ((damping**2 - w**2) * sine - 2 * damping * w * cosine)
    # A knock swells as (1 - e^-(w t))^2, so that its acceleration starts at zero.
    decay = np.exp(-w * t)
    g0, g1, g2 = (1 - decay) ** 2, 2 * w * decay * (1 - decay), 2 * w**2 * decay * (2 * decay - 1)
    k = ring.coordinate
    c[0, k, i:j] += ring.speed / w * s0 + ring.knock * g0 * s0
    c[1, k, i:j] += ring.speed / w * s1 + ring.knock * (g1 * s0 + g0 * s1)
    c[2, k, i:j] += ring.speed / w * s2 + ring.knock * (g2 * s0 + 2 * g1 * s1 + g0 * s2)
