"""What a hinge says about two attitudes: the heading between their rooms, and where the hinge axis really is.

Two attitudes from rates and specific force agree on what is up, and on nothing else: each has a heading of its own,
which drifts. The hinge axis is one line on both parts. Taken into both rooms, `u` and `v`, its horizontal parts differ
by the heading between the rooms. Written as complex numbers a, b, the heading that fits a set of samples best is
arg(sum a conj b), and |a conj b| says how much the hinge shows: 1 when it is level, 0 when it is vertical.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from inhalemon.rotation import as_matrix
from inhalemon.settings import LeverSettings
from inhalemon.values import FloatArray, IntArray

_SAMPLES_PER_BLOCK = 10  # enough to follow a hand within 0.2 s; more only cost time


@dataclass(frozen=True, slots=True)
class Blocks:
    """Means over short blocks of what any pair of axes needs, so that trying another pair costs nothing.

    With body axis j and lever axis k, block i sees a conj(b) = j @ level[i] @ k and u_z v_z = j @ upright[i] @ k.
    """

    time_s: FloatArray  # (m,) the middle of each block
    level: NDArray[np.complex128]  # (m, 3, 3)
    upright: FloatArray  # (m, 3, 3)
    first: IntArray  # (m,) the first sample of each block

    @classmethod
    def of(cls, time_s: FloatArray, q_ref_body: FloatArray, q_ref_lever: FloatArray, block_s: float) -> Self:
        """Blocks of `block_s`; one without a sample is left out."""
        number = np.floor((time_s - time_s[0]) / block_s).astype(np.int64)
        first = np.flatnonzero(np.diff(number, prepend=-1))
        rate_hz = time_s.size / (time_s[-1] - time_s[0])
        stride = max(1, int(rate_hz * block_s / _SAMPLES_PER_BLOCK))
        # The first sample of every block is always taken, so that no block is empty.
        taken = np.union1d(np.arange(0, time_s.size, stride), first)
        body = as_matrix(q_ref_body[taken])
        lever = as_matrix(q_ref_lever[taken])
        level_body = body[:, 0] + 1j * body[:, 1]
        level_lever = lever[:, 0] - 1j * lever[:, 1]
        starts = np.searchsorted(taken, first)
        n_taken = np.diff(starts, append=taken.size)[:, None, None]
        level = (
            np.add.reduceat(level_body[:, :, None] * level_lever[:, None, :], starts).astype(np.complex128) / n_taken
        )
        upright = np.add.reduceat(body[:, 2, :, None] * lever[:, 2, None, :], starts) / n_taken
        return cls((number[first] + 0.5) * block_s + time_s[0], level, upright, first)

    def __len__(self) -> int:
        return int(self.time_s.size)

    def __getitem__(self, part: slice) -> Blocks:
        return Blocks(self.time_s[part], self.level[part], self.upright[part], self.first[part])


@dataclass(frozen=True, slots=True)
class Heading:
    """Heading of the lever's room in the body's room: turning the lever's attitude by it about z joins the two."""

    rad: FloatArray  # (m,)
    rate_rad_s: FloatArray  # (m,)
    sd_rad: FloatArray  # (m,)


def heading_difference(
    blocks: Blocks, axis_body: FloatArray, axis_lever: FloatArray, settings: LeverSettings, *, smooth: bool
) -> Heading:
    """The slow heading between the two rooms, block by block, from a Kalman filter with the states offset and rate.

    With `smooth`, every block is used for every block (Rauch, Tung and Striebel's smoother); without, those up to it.
    A block that shows little of the hinge counts little, one that disagrees wildly is given a larger variance.
    """
    seen = blocks.level @ axis_lever @ axis_body
    start = math.atan2(seen[0].imag, seen[0].real)
    measured = np.angle(seen).tolist()
    shown = np.abs(seen).tolist()
    steps = np.diff(blocks.time_s, prepend=blocks.time_s[0]).tolist()
    walk = settings.heading_walk_rad_s**2
    white = settings.sd_heading_block_rad**2
    x, rate = start, 0.0
    p00, p01, p11 = math.pi**2, 0.0, settings.sd_heading_rate_rad_s**2
    told: list[tuple[float, float, float, float, float]] = []
    known: list[tuple[float, float, float, float, float]] = []
    for dt, angle, size in zip(steps, measured, shown, strict=True):
        x += dt * rate
        p00 += dt * (2.0 * p01 + dt * p11) + walk * dt**3 / 3.0
        p01 += dt * p11 + walk * dt**2 / 2.0
        p11 += walk * dt
        told.append((x, rate, p00, p01, p11))
        if size > settings.min_shown:
            surprise = math.remainder(angle - x, math.tau)
            variance = white / size**2
            # A block far off its forecast is believed as far as its own size allows, never more.
            variance = max(variance, surprise**2 / settings.max_surprise**2 - p00)
            gain = p00 / (p00 + variance)
            gain_rate = p01 / (p00 + variance)
            x += gain * surprise
            rate += gain_rate * surprise
            p11 -= gain_rate * p01
            p01 -= gain * p01
            p00 -= gain * p00
        known.append((x, rate, p00, p01, p11))
    if smooth:
        _smooth(known, told, steps)
    rad, rates, variances, _, _ = (np.array(column) for column in zip(*known, strict=True))
    return Heading(rad, rates, np.sqrt(variances))


def _smooth(
    known: list[tuple[float, float, float, float, float]],
    told: list[tuple[float, float, float, float, float]],
    steps: list[float],
) -> None:
    """Rauch, Tung and Striebel's backward pass over (offset, rate, variances), in place."""
    for i in range(len(known) - 2, -1, -1):
        dt = steps[i + 1]
        x, rate, p00, p01, p11 = known[i]
        x_told, rate_told, t00, t01, t11 = told[i + 1]
        x_next, rate_next, n00, n01, n11 = known[i + 1]
        determinant = t00 * t11 - t01 * t01
        a, b, c, d = p00 + dt * p01, p01, p01 + dt * p11, p11
        g00, g01 = (a * t11 - b * t01) / determinant, (b * t00 - a * t01) / determinant
        g10, g11 = (c * t11 - d * t01) / determinant, (d * t00 - c * t01) / determinant
        dx, drate = x_next - x_told, rate_next - rate_told
        e00, e01, e11 = n00 - t00, n01 - t01, n11 - t11
        known[i] = (
            x + g00 * dx + g01 * drate,
            rate + g10 * dx + g11 * drate,
            p00 + g00 * g00 * e00 + 2.0 * g00 * g01 * e01 + g01 * g01 * e11,
            p01 + g00 * g10 * e00 + (g00 * g11 + g01 * g10) * e01 + g01 * g11 * e11,
            p11 + g10 * g10 * e00 + 2.0 * g10 * g11 * e01 + g11 * g11 * e11,
        )


def fit_axes(blocks: Blocks, axis: FloatArray, settings: LeverSettings, n_fits: int) -> tuple[FloatArray, FloatArray]:
    """The hinge axis on the body and on the lever, refitted to the blocks with `axis` as what was known before.

    Each fit takes the heading from the axes so far, then the axes from |u - v|^2 over all blocks, linearised about
    `axis` in two small angles a side, with a prior of `sd_axis_rad`. The blocks count as independent every
    `axis_memory_s`, because tilt errors last that long.
    """
    across = _across(axis)
    axis_body = axis_lever = axis
    n_independent = len(blocks) * settings.block_s / settings.axis_memory_s
    weight = n_independent * (settings.sd_axis_rad / settings.sd_axis_fit_rad) ** 2
    for _ in range(n_fits):
        heading = heading_difference(blocks, axis_body, axis_lever, settings, smooth=True)
        turn = np.exp(-1j * heading.rad)
        # The mean relative rotation: |u - v|^2 is on average 2 - 2 axis_body @ mean @ axis_lever.
        mean = ((turn[:, None, None] * blocks.level).real + blocks.upright).mean(axis=0)
        cross = across.T @ mean @ across
        size = float(axis @ mean @ axis)
        normal = np.block([[size * np.eye(2), -cross], [-cross.T, size * np.eye(2)]]) * weight + np.eye(4)
        pull = weight * np.concatenate([across.T @ mean @ axis, across.T @ mean.T @ axis])
        small = np.linalg.solve(normal, pull)
        axis_body, axis_lever = axis + across @ small[:2], axis + across @ small[2:]
        axis_body, axis_lever = axis_body / np.linalg.norm(axis_body), axis_lever / np.linalg.norm(axis_lever)
    return axis_body, axis_lever


def _across(axis: FloatArray) -> FloatArray:
    """(3, 2): two unit vectors across a unit axis and across each other."""
    least = np.eye(3)[np.argmin(np.abs(axis))]
    first = np.cross(axis, least)
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)], axis=-1)
