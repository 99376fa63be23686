"""What a hinge says about two attitudes: the heading between their rooms, and where the hinge axis really is.

Two attitudes from rates and specific force agree on what is up, and on nothing else: each has a heading of its own,
which drifts. The hinge axis is one line on both parts. Taken into both rooms, `u` and `v`, its horizontal parts differ
by the heading between the rooms. Written as complex numbers a, b, the heading that fits a set of samples best is
arg(sum a conj b), and |a conj b| says how much the hinge shows: 1 when it is level, 0 when it is vertical.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from inhalemon.rotation import as_matrix
from inhalemon.settings import LeverSettings
from inhalemon.values import AttitudeTrack, FloatArray, IntArray

_SAMPLES_PER_BLOCK = 5  # enough to follow a hand within 0.2 s; more only cost time


@dataclass(frozen=True, slots=True)
class Blocks:
    """Means over short blocks of what any pair of axes needs, so that trying another pair costs nothing.

    With body axis j and lever axis k, block i sees a conj(b) = j @ level[i] @ k and u_z v_z = j @ upright[i] @ k.
    """

    time_s: FloatArray  # (m,) the middle of each block
    level: NDArray[np.complex128]  # (m, 3, 3)
    upright: FloatArray  # (m, 3, 3)
    rise_body: FloatArray  # (m, 3) the room's vertical in the body's frame
    rise_lever: FloatArray  # (m, 3) and in the lever's
    first: IntArray  # (m,) the first sample of each block

    @classmethod
    def of(cls, body: AttitudeTrack, lever: AttitudeTrack, block_s: float) -> Self:
        """Blocks of `block_s` of two attitudes at the same times; a block without a sample is left out."""
        time_s = body.time_s
        number = np.floor((time_s - time_s[0]) / block_s).astype(np.int64)
        first = np.flatnonzero(np.diff(number, prepend=-1))
        rate_hz = time_s.size / (time_s[-1] - time_s[0])
        stride = max(1, int(rate_hz * block_s / _SAMPLES_PER_BLOCK))
        # The first sample of every block is always taken, so that no block is empty.
        taken = np.union1d(np.arange(0, time_s.size, stride), first)
        rows_body = as_matrix(body.q[taken])
        rows_lever = as_matrix(lever.q[taken])
        level_body = rows_body[:, 0] + 1j * rows_body[:, 1]
        level_lever = rows_lever[:, 0] - 1j * rows_lever[:, 1]
        starts = np.searchsorted(taken, first)
        n_taken = np.diff(starts, append=taken.size)[:, None, None]
        level = (
            np.add.reduceat(level_body[:, :, None] * level_lever[:, None, :], starts).astype(np.complex128) / n_taken
        )
        upright = np.add.reduceat(rows_body[:, 2, :, None] * rows_lever[:, 2, None, :], starts) / n_taken
        rise_body = np.add.reduceat(rows_body[:, 2], starts) / n_taken[:, :, 0]
        rise_lever = np.add.reduceat(rows_lever[:, 2], starts) / n_taken[:, :, 0]
        return cls((number[first] + 0.5) * block_s + time_s[0], level, upright, rise_body, rise_lever, first)

    def __len__(self) -> int:
        return int(self.time_s.size)

    def __getitem__(self, part: slice) -> Blocks:
        return Blocks(*(getattr(self, field.name)[part] for field in fields(self)))


@dataclass(frozen=True, slots=True)
class Heading:
    """Heading of the lever's room in the body's room: turning the lever's attitude by it about z joins the two."""

    rad: FloatArray  # (m,)
    rate_rad_s: FloatArray  # (m,)
    sd_rad: FloatArray  # (m,)


def heading_difference(
    blocks: Blocks,
    axis_body: FloatArray,
    axis_lever: FloatArray,
    settings: LeverSettings,
    *,
    smooth: bool,
    is_shut_first: bool,
) -> Heading:
    """The slow heading between the two rooms, block by block, from a Kalman filter with the states offset and rate.

    With `smooth`, every block is used for every block (Rauch, Tung and Striebel's smoother); without, those up to it.
    A block that shows little of the hinge counts little, one that disagrees wildly is given a larger variance. A lever
    that is probably shut at first (`is_shut_first`) starts with its frame parallel to the body's, about.
    """
    seen = blocks.level @ axis_lever @ axis_body
    start = blocks.level[0].trace() if is_shut_first else seen[0]
    sd_start_rad = settings.sd_shut_first_rad if is_shut_first else math.pi
    measured = np.angle(seen).tolist()
    shown = np.abs(seen).tolist()
    steps = np.diff(blocks.time_s, prepend=blocks.time_s[0]).tolist()
    walk = settings.heading_walk_rad_s**2
    scatter = settings.scatter_factor * _scatter(blocks, np.abs(seen), axis_body, axis_lever, settings, centred=smooth)
    x, rate = math.atan2(start.imag, start.real), 0.0
    p00, p01, p11 = sd_start_rad**2, 0.0, settings.sd_heading_rate_rad_s**2
    told: list[tuple[float, float, float, float, float]] = []
    known: list[tuple[float, float, float, float, float]] = []
    for dt, angle, size, white in zip(steps, measured, shown, scatter.tolist(), strict=True):
        x += dt * rate
        p00 += dt * (2.0 * p01 + dt * p11) + walk * dt**3 / 3.0
        p01 += dt * p11 + walk * dt**2 / 2.0
        p11 += walk * dt
        told.append((x, rate, p00, p01, p11))
        if size > settings.min_shown:
            surprise = math.remainder(angle - x, math.tau)
            variance = white / size
            # Huber's weight: a block far off its forecast pulls no harder than one at the limit.
            excess = abs(surprise) / (settings.max_surprise * math.sqrt(p00 + variance))
            variance *= max(1.0, excess)
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


def _scatter(
    blocks: Blocks,
    shown: FloatArray,
    axis_body: FloatArray,
    axis_lever: FloatArray,
    settings: LeverSettings,
    *,
    centred: bool = True,
) -> FloatArray:
    """Variance of the hinge's direction as one attitude sees it against the other, block by block, in rad^2.

    What heading cannot mend, the difference in elevation, shows how well the two agree just now: a loose hinge and a
    shaken sensor agree badly. Its mean square over a window is the variance, with some blocks' worth of `sd_hinge_rad`.
    """
    half = round(settings.scatter_window_s / settings.block_s)
    m = len(blocks)
    rise = blocks.rise_body @ axis_body - blocks.rise_lever @ axis_lever
    end = np.arange(m) + 1
    begin = np.maximum(end - half, 0)
    if centred:
        end = np.minimum(end + half, m)
    misfit = np.diff(np.concatenate([[0.0], np.cumsum(rise**2)])[np.stack([begin, end])], axis=0)[0]
    weight = np.diff(np.concatenate([[0.0], np.cumsum(shown)])[np.stack([begin, end])], axis=0)[0]
    prior = settings.sd_hinge_blocks
    variance: FloatArray = (misfit + prior * settings.sd_hinge_rad**2) / (weight + prior)
    return variance


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


def fit_axes(
    blocks: Blocks, axis: FloatArray, settings: LeverSettings, *, is_shut_first: bool
) -> tuple[FloatArray, FloatArray]:
    """The hinge axis on the body and on the lever, from the blocks, with `axis` as what was known before.

    Each of `n_axis_fits` rounds takes the heading from the axes so far, then one Gauss-Newton step on |u - v|^2 over
    all blocks for two small angles a side, and for an offset and a slope of the heading, which would otherwise hide
    half of what the axes are off. Tilt errors last for about `axis_memory_s`: the blocks count once in that time.
    """
    axis_body = axis_lever = axis
    known = 1.0 / settings.sd_axis_rad**2
    share = settings.block_s / settings.axis_memory_s
    ramp = np.stack([np.ones(len(blocks)), np.linspace(-1.0, 1.0, len(blocks))])
    for _ in range(settings.n_axis_fits):
        heading = heading_difference(blocks, axis_body, axis_lever, settings, smooth=True, is_shut_first=is_shut_first)
        turned = np.exp(-1j * heading.rad)[:, None, None] * blocks.level
        weight = share / _scatter(blocks, np.abs(turned @ axis_lever @ axis_body), axis_body, axis_lever, settings)
        # |u - v|^2 is 2 - 2 axis_body @ (turned.real + upright) @ axis_lever; turned.imag is its slope with heading.
        agree = np.tensordot(weight, turned.real + blocks.upright, axes=1)
        slope = np.tensordot(ramp * weight, turned.imag, axes=1)
        bend = (ramp * (weight * (turned.real @ axis_lever @ axis_body))) @ ramp.T
        body, lever = _across(axis_body), _across(axis_lever)
        cross = body.T @ agree @ lever
        body_slope, lever_slope = -(slope @ axis_lever @ body).T, -(axis_body @ slope @ lever).T
        stiff = (axis_body @ agree @ axis_lever + known) * np.eye(2)
        normal = np.block(
            [
                [stiff, -cross, body_slope],
                [-cross.T, stiff, lever_slope],
                [body_slope.T, lever_slope.T, bend + np.eye(2)],  # a radian is known of the heading: never singular
            ]
        )
        pull = [
            body.T @ (agree @ axis_lever + known * (axis - axis_body)),
            lever.T @ (axis_body @ agree + known * (axis - axis_lever)),
            slope @ axis_lever @ axis_body,
        ]
        step = np.linalg.solve(normal, np.concatenate(pull))
        axis_body = _unit(axis_body + body @ step[:2])
        axis_lever = _unit(axis_lever + lever @ step[2:4])
    return axis_body, axis_lever


def _unit(v: FloatArray) -> FloatArray:
    unit: FloatArray = v / np.linalg.norm(v)
    return unit


def _across(axis: FloatArray) -> FloatArray:
    """(3, 2): two unit vectors across a unit axis and across each other."""
    least = np.eye(3)[np.argmin(np.abs(axis))]
    first = np.cross(axis, least)
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)], axis=-1)
