"""Motion made by other means than the simulator's: keyframes followed as by a sluggish muscle, on a grid of 1 kHz.

Places are reached along the step response of four equal first-order lags (quick to start, slow to settle); attitudes
along great circles, one turn after another; strokes are laid one by one. Rates and forces are central differences.
Nothing here is shared with `inhalemon.simulate.motion`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from inhalemon.rotation import conjugate, from_rotation_vector, multiply, normalise, rotate, to_rotation_vector
from inhalemon.values import FloatArray

STEP_S: Final = 1e-3
GRAVITY_M_S2: Final = 9.80665
_SETTLED: Final = 10.5  # lags' time constants until 99 % of a step


def sluggish(time_s: FloatArray, start_s: float, duration_s: float) -> FloatArray:
    """From 0 to 1: four lags in a row, 99 % reached after `duration_s`."""
    x = np.clip((time_s - start_s) * (_SETTLED / duration_s), 0.0, 60.0)
    done: FloatArray = 1.0 - np.exp(-x) * (1.0 + x + x**2 / 2 + x**3 / 6)
    return done


def smoothed(values: FloatArray, length_s: float) -> FloatArray:
    """A Hann-weighted running mean over the first axis, ends held."""
    n = max(round(length_s / STEP_S) | 1, 3)
    weights = np.hanning(n + 2)[1:-1]
    weights /= weights.sum()
    held = np.concatenate([np.repeat(values[:1], n // 2, axis=0), values, np.repeat(values[-1:], n // 2, axis=0)])
    if values.ndim == 1:
        return np.convolve(held, weights, mode="valid")
    return np.stack([np.convolve(column, weights, mode="valid") for column in held.T], axis=1)


@dataclass(frozen=True)
class Arms:
    """Where the chips sit, as lever arms in metres: grip to body chip, grip to hinge, hinge to lever chip."""

    body_chip_m: FloatArray
    hinge_m: FloatArray
    lever_chip_m: FloatArray


@dataclass
class Reel:
    """What is acted, move by move: a cursor `now_s` and the moves so far."""

    position_m: FloatArray
    q: FloatArray
    now_s: float = 0.0
    angle_rad: float = 0.0
    _start: tuple[FloatArray, FloatArray] = field(init=False)
    _shifts: list[tuple[float, float, FloatArray]] = field(default_factory=list)
    _turns: list[tuple[float, float, FloatArray]] = field(default_factory=list)
    _levers: list[tuple[float, float, float, float]] = field(default_factory=list)
    _strokes: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = field(default_factory=list)
    _bumps: list[tuple[float, FloatArray]] = field(default_factory=list)
    _sines: list[tuple[float, float, FloatArray, FloatArray, FloatArray]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._start = (self.position_m.copy(), self.q.copy())

    def carry(self, to_m: FloatArray, duration_s: float, *, delay_s: float = 0.0) -> None:
        """Moves the grip; the cursor stays."""
        self._shifts.append((self.now_s + delay_s, duration_s, to_m - self.position_m))
        self.position_m = to_m.copy()

    def turn(self, to_q: FloatArray, duration_s: float, *, delay_s: float = 0.0) -> None:
        """Turns the device the shortest way; the cursor stays."""
        self._turns.append((self.now_s + delay_s, duration_s, to_rotation_vector(multiply(conjugate(self.q), to_q))))
        self.q = to_q.copy()

    def swing(self, to_rad: float, duration_s: float, *, delay_s: float = 0.0, overdrive: float = 1.0) -> float:
        """Moves the lever, driven as if to `overdrive` times the way; returns when it arrives (or nearly)."""
        start_s = self.now_s + delay_s
        self._levers.append((start_s, duration_s, to_rad - self.angle_rad, overdrive))
        self.angle_rad = to_rad
        if overdrive <= 1.0:
            return start_s + duration_s
        grid = np.arange(0.0, duration_s, STEP_S)
        return start_s + float(grid[np.searchsorted(sluggish(grid, 0.0, duration_s), 1.0 / overdrive)])

    def stroke(self, times_s: FloatArray, heights: FloatArray, along_m: FloatArray, twist_rad: FloatArray) -> None:
        """To and fro between `heights` reached at `times_s`, along a direction of the room and about a body axis."""
        self._strokes.append((times_s, heights, along_m, twist_rad))

    def bump(self, acc_m_s2: FloatArray, *, delay_s: float = 0.0) -> None:
        """A knock of about 12 ms with that largest acceleration."""
        self._bumps.append((self.now_s + delay_s, acc_m_s2))

    def tremble(
        self, start_s: float, end_s: float, hz: FloatArray, position_m: FloatArray, turn_rad: FloatArray
    ) -> None:
        """Sines (k,) with amplitudes (k, 3) and phases of their own on position and attitude, faded in and out."""
        self._sines.append((start_s, end_s, hz, position_m, turn_rad))

    def film(self, arms: Arms, rng: np.random.Generator) -> Film:
        """The whole motion up to the cursor, on the grid."""
        time_s = np.arange(0.0, self.now_s + STEP_S, STEP_S)
        n = time_s.size
        position = np.tile(self._start[0], (n, 1))
        for start_s, duration_s, change in self._shifts:
            i = np.searchsorted(time_s, start_s)
            position[i:] += sluggish(time_s[i:], start_s, duration_s)[:, None] * change
        q = np.tile(self._start[1], (n, 1))
        for start_s, duration_s, vector in self._turns:
            i, j = np.searchsorted(time_s, [start_s, start_s + 3 * duration_s])
            done = sluggish(time_s[i:j], start_s, duration_s)
            q[i:j] = multiply(q[i:j], from_rotation_vector(done[:, None] * vector))
            q[j:] = multiply(q[j:], from_rotation_vector(vector))
        wobble = np.zeros((n, 3))
        for times, heights, along, twist in self._strokes:
            path = smoothed(_to_and_fro(time_s, times, heights), 0.03)
            position += path[:, None] * along
            wobble += path[:, None] * twist
        for start_s, acc in self._bumps:
            position += _bump(time_s, start_s)[:, None] * acc
        for start_s, end_s, hz, shift, turn in self._sines:
            i, j = np.searchsorted(time_s, [start_s, end_s])
            t = time_s[i:j]
            fade = np.clip(np.minimum(t - start_s, end_s - t) / 0.6, 0.0, 1.0)
            fade = (fade**3 * (10 - 15 * fade + 6 * fade**2))[:, None]
            for one_hz, one_shift, one_turn in zip(hz, shift, turn, strict=True):
                phases = rng.uniform(0.0, 2 * np.pi, 2)
                position[i:j] += fade * np.sin(2 * np.pi * one_hz * t + phases[0])[:, None] * one_shift
                wobble[i:j] += fade * np.sin(2 * np.pi * one_hz * t + phases[1])[:, None] * one_turn
        q = normalise(multiply(q, from_rotation_vector(wobble)))
        return Film(time_s, position, q, self._angle(time_s), arms)

    def _angle(self, time_s: FloatArray) -> FloatArray:
        angle = np.zeros(time_s.size)
        for start_s, duration_s, change, overdrive in self._levers:
            i = np.searchsorted(time_s, start_s)
            # An end stop cuts the drive short; its softness is a few milliseconds.
            angle[i:] += change * np.minimum(overdrive * sluggish(time_s[i:], start_s, duration_s), 1.0)
        return smoothed(angle, 0.012)


@dataclass
class Film:
    """A finished motion on the grid; what the truth and the sensors ask of it."""

    time_s: FloatArray
    position_m: FloatArray
    q: FloatArray
    angle_rad: FloatArray
    arms: Arms

    def cut(self, start_s: float, end_s: float) -> Film:
        """The motion between two times, its time counted from the first."""
        i, j = np.searchsorted(self.time_s, [start_s, end_s])
        return Film(self.time_s[i:j] - start_s, self.position_m[i:j], self.q[i:j], self.angle_rad[i:j], self.arms)

    def attitude(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`q_ref_body` (n, 4) and the lever's angle (n,)."""
        q = np.stack([np.interp(time_s, self.time_s, column) for column in self.q.T], axis=1)
        return normalise(q), np.interp(time_s, self.time_s, self.angle_rad)

    def acceleration(self, time_s: FloatArray) -> FloatArray:
        """Acceleration of the body's chip in the room (n, 3)."""
        acc = _second_difference(self.position_m + rotate(self.q, self.arms.body_chip_m))
        return np.stack([np.interp(time_s, self.time_s, column) for column in acc.T], axis=1)

    def body_signals(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self._signals(time_s, self.position_m + rotate(self.q, self.arms.body_chip_m), self.q)

    def lever_signals(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        q_hinge = from_rotation_vector(self.angle_rad[:, None] * np.array([1.0, 0.0, 0.0]))
        arm = self.arms.hinge_m + rotate(q_hinge, self.arms.lever_chip_m)
        return self._signals(time_s, self.position_m + rotate(self.q, arm), multiply(self.q, q_hinge))

    def _signals(self, time_s: FloatArray, chip_m: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        force = rotate(conjugate(q), _second_difference(chip_m) + np.array([0.0, 0.0, GRAVITY_M_S2]))
        turns = to_rotation_vector(multiply(conjugate(q[:-1]), q[1:])) / STEP_S
        rate = np.concatenate([turns[:1], 0.5 * (turns[1:] + turns[:-1]), turns[-1:]])
        at = [np.stack([np.interp(time_s, self.time_s, c) for c in v.T], axis=1) for v in (force, rate)]
        return at[0], at[1]


def _second_difference(values: FloatArray) -> FloatArray:
    inner = (values[2:] - 2 * values[1:-1] + values[:-2]) / STEP_S**2
    return np.concatenate([inner[:1], inner, inner[-1:]])


def _to_and_fro(time_s: FloatArray, times_s: FloatArray, heights: FloatArray) -> FloatArray:
    """Half cosines between the turning points."""
    k = np.clip(np.searchsorted(times_s, time_s, side="right") - 1, 0, times_s.size - 2)
    u = np.clip((time_s - times_s[k]) / (times_s[k + 1] - times_s[k]), 0.0, 1.0)
    path: FloatArray = heights[k] + (heights[k + 1] - heights[k]) * 0.5 * (1 - np.cos(np.pi * u))
    return path


def _bump(time_s: FloatArray, start_s: float) -> FloatArray:
    """The position of a knock whose second derivative swings once within 36 ms, its largest value 1."""
    u = np.clip((time_s - start_s) / 0.036, 0.0, 1.0)
    # u^4 (1 - u)^4 has its largest second derivative, -1/8, in the middle.
    path: FloatArray = -(u**4) * (1 - u) ** 4 * 8 * 0.036**2
    return path
