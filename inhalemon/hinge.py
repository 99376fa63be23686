"""What a hinge says about two attitudes: the heading between their rooms, and where the hinge axis really is.

Two attitudes from rates and specific force agree on what is up, and on nothing else: each has a heading of its own,
which drifts. The hinge axis is one line on both parts. Taken into both rooms, `u` and `v`, its horizontal parts differ
by the heading between the rooms. Written as complex numbers a, b, the heading that fits a set of samples best is
arg(sum a conj b), and |a conj b| says how much the hinge shows: 1 when it is level, 0 when it is vertical.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from inhalemon import _heading_kernel as kernel
from inhalemon.rotation import as_matrix
from inhalemon.settings import LeverSettings
from inhalemon.signals import lengths, memory
from inhalemon.values import AttitudeTrack, FloatArray, IntArray

_SAMPLES_PER_BLOCK = 5  # enough to follow a hand within 0.2 s; more only cost time


@dataclass(frozen=True, slots=True)
class Blocks:
    """Means over short blocks of what any pair of axes needs, so that trying another pair costs nothing.

    With j on the body and k on the lever, a conj(b) is j @ level[i] @ k and u_z v_z is j @ upright[i] @ k in block i.
    """

    time_s: FloatArray  # (m,) the middle of each block
    level: NDArray[np.complex128]  # (m, 3, 3)
    upright: FloatArray  # (m, 3, 3)
    rise_body: FloatArray  # (m, 3) the room's vertical in the body's frame
    rise_lever: FloatArray  # (m, 3) and in the lever's
    first: IntArray  # (m,) the first sample of each block
    block_s: float

    @classmethod
    def of(cls, body: AttitudeTrack, lever: AttitudeTrack, block_s: float) -> Self:
        """Blocks of `block_s` of two attitudes at the same times; a block without a sample is left out."""
        time_s = body.time_s
        since = (time_s - time_s[0]) / block_s
        number, part = np.floor(since).astype(np.int64), np.floor(since * _SAMPLES_PER_BLOCK).astype(np.int64)
        first = np.append(0, np.flatnonzero(number[1:] != number[:-1]) + 1)
        # The first sample of every block is always taken, so that no block is empty.
        is_taken = np.append(True, part[1:] != part[:-1])
        is_taken[first] = True
        taken = np.flatnonzero(is_taken)
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
        return cls((number[first] + 0.5) * block_s + time_s[0], level, upright, rise_body, rise_lever, first, block_s)

    def __len__(self) -> int:
        return int(self.time_s.size)

    def __getitem__(self, part: slice) -> Blocks:
        names = ("time_s", "level", "upright", "rise_body", "rise_lever", "first")
        return replace(self, **{name: getattr(self, name)[part] for name in names})

    def is_still(self, max_turn_rad: float) -> NDArray[np.bool_]:
        """Where neither part leans otherwise than in the block before, to within an angle (m,)."""
        rises = (self.rise_body, self.rise_lever)
        turned = [lengths(np.diff(rise, axis=0, prepend=rise[:1])) for rise in rises]
        return np.maximum(*turned) < max_turn_rad

    def misfit(self, axes: Axes) -> FloatArray:
        """How much higher the hinge points by the body's attitude than by the lever's (m,)."""
        difference: FloatArray = self.rise_body @ axes.body - self.rise_lever @ axes.lever
        return difference


@dataclass(frozen=True, slots=True)
class Heading:
    """Heading of the lever's room in the body's room: turning the lever's attitude by it about z joins the two."""

    rad: FloatArray  # (m,)
    rate_rad_s: FloatArray  # (m,)
    sd_rad: FloatArray  # (m,)


@dataclass(frozen=True, slots=True)
class Axes:
    """The hinge in both frames, unit vectors, and how well the two are known against each other."""

    body: FloatArray  # (3,)
    lever: FloatArray  # (3,)
    sd_rad: float


@dataclass(frozen=True, slots=True)
class _Seen:
    """What each block shows of the heading, with some axes."""

    agreement: NDArray[np.complex128]  # (m,) the mean a conj(b)
    shown: FloatArray  # (m,) its size: 1 when the hinge is level, 0 when it is vertical
    scatter: FloatArray  # (m,) variance of the hinge's direction as one attitude sees it against the other, rad^2

    @classmethod
    def of(cls, blocks: Blocks, axes: Axes, settings: LeverSettings, *, centred: bool) -> Self:
        """With the scatter over a window before each block or, when `centred`, before and after.

        What heading cannot mend, the difference in elevation, shows how well the two agree just now: a loose hinge and
        a shaken sensor agree badly. Its mean square is the variance, with `sd_hinge_s` worth of what is usual: the mean
        square of all blocks (or those so far), with as much worth of `sd_hinge_rad`.
        """
        agreement = blocks.level.reshape(-1, 9) @ np.outer(axes.body, axes.lever).ravel()
        shown = np.abs(agreement)
        begin = np.searchsorted(blocks.time_s, blocks.time_s - settings.scatter_window_s)
        end = np.arange(len(blocks)) + 1
        if centred:
            end = np.searchsorted(blocks.time_s, blocks.time_s + settings.scatter_window_s, side="right")
        sums = np.zeros((2, len(blocks) + 1))
        np.cumsum(blocks.misfit(axes) ** 2, out=sums[0, 1:])
        np.cumsum(shown, out=sums[1, 1:])
        prior = settings.sd_hinge_s / blocks.block_s
        misfit, weight = sums[:, -1:] if centred else sums[:, 1:]
        usual = (misfit + prior * settings.sd_hinge_rad**2) / (weight + prior)
        misfit, weight = sums[:, end] - sums[:, begin]
        return cls(agreement, shown, (misfit + prior * usual) / (weight + prior))


def heading_difference(
    blocks: Blocks,
    axes: Axes,
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
    seen = _Seen.of(blocks, axes, settings, centred=smooth)
    return _filtered_heading(blocks, axes, seen, settings, smooth=smooth, is_shut_first=is_shut_first)


def _filtered_heading(
    blocks: Blocks, axes: Axes, seen: _Seen, settings: LeverSettings, *, smooth: bool, is_shut_first: bool
) -> Heading:
    start = blocks.level[0].trace() if is_shut_first else seen.agreement[0]
    sd_start_rad = settings.sd_shut_first_rad if is_shut_first else math.pi
    # Neighbours err alike, and for longer while nothing moves.
    alike_s = np.where(blocks.is_still(settings.still_pose_rad), settings.axis_memory_s, settings.scatter_memory_s)
    alike = np.maximum(1.0, alike_s / blocks.block_s)
    step_s = np.zeros(len(blocks))
    np.subtract(blocks.time_s[1:], blocks.time_s[:-1], out=step_s[1:])
    told, known = np.empty((2, len(blocks), 5))
    kernel.filter_heading(
        memory(step_s),
        memory(np.angle(seen.agreement)),
        memory(seen.shown),
        memory(seen.scatter * alike + axes.sd_rad**2),
        float(np.angle(start)),
        sd_start_rad**2,
        settings.sd_heading_rate_rad_s**2,
        settings.heading_walk_rad_s**2,
        settings.min_shown,
        settings.max_surprise,
        memory(told),
        memory(known),
    )
    if smooth:
        kernel.smooth_heading(memory(step_s), memory(told), memory(known))
    return Heading(known[:, 0], known[:, 1], np.sqrt(known[:, 2]))


def fit_axes(blocks: Blocks, axis: FloatArray, settings: LeverSettings, *, is_shut_first: bool) -> Axes:
    """The hinge axis on the body and on the lever, from the blocks, with `axis` as what was known before.

    Each of `n_axis_fits` rounds takes the heading from the axes so far, then one Gauss-Newton step on |u - v|^2 over
    all blocks for two small angles a side, and for an offset and a slope of the heading, which would otherwise hide
    half of what the axes are off. Tilt errors last for about `axis_memory_s`: the blocks count once in that time.
    """
    axes = Axes(axis, axis, settings.sd_axis_rad)
    if len(blocks) == 0:
        return axes
    share = min(1.0, blocks.block_s / settings.axis_memory_s)
    known = 1.0 / settings.sd_axis_rad**2
    ramp = np.stack([np.ones(len(blocks)), np.linspace(-1.0, 1.0, len(blocks))])
    for _ in range(settings.n_axis_fits):
        seen = _Seen.of(blocks, axes, settings, centred=True)
        heading = _filtered_heading(blocks, axes, seen, settings, smooth=True, is_shut_first=is_shut_first)
        turn = np.exp(-1j * heading.rad)
        weight = share / seen.scatter
        # |u - v|^2 is 2 - 2 axes.body @ (level.real + upright) @ axes.lever, the level turned by the heading; its slope
        # with heading is the imaginary part.
        turned = ((ramp * weight * turn) @ blocks.level.reshape(-1, 9)).reshape(2, 3, 3)
        agree = turned[0].real + (weight @ blocks.upright.reshape(-1, 9)).reshape(3, 3)
        slope = turned.imag
        bend = (ramp * weight * seen.shown) @ ramp.T
        body, lever = _across(axes.body), _across(axes.lever)
        total = weight.sum()
        cross = body.T @ agree @ lever
        body_slope, lever_slope = -(slope @ axes.lever @ body).T, -(axes.body @ slope @ lever).T
        normal = np.empty((6, 6))
        normal[:2, :2] = normal[2:4, 2:4] = (total + known) * np.eye(2)
        normal[:2, 2:4], normal[2:4, :2] = -cross, -cross.T
        normal[:2, 4:], normal[4:, :2] = body_slope, body_slope.T
        normal[2:4, 4:], normal[4:, 2:4] = lever_slope, lever_slope.T
        normal[4:, 4:] = bend + np.eye(2)  # a radian is known of the heading: never singular
        pull = [
            body.T @ (agree @ axes.lever + known * (axis - axes.body)),
            lever.T @ (axes.body @ agree + known * (axis - axes.lever)),
            slope @ axes.lever @ axes.body,
        ]
        variance = np.linalg.inv(normal)
        step = variance @ np.concatenate(pull)
        # What counts is one axis against the other, seen through the mean relative rotation.
        between = np.concatenate([np.eye(2), -cross / total], axis=1)
        sd_rad = math.sqrt(max(np.trace(between @ variance[:4, :4] @ between.T), 0.0) / 2.0)
        axes = Axes(_unit(axes.body + body @ step[:2]), _unit(axes.lever + lever @ step[2:4]), sd_rad)
    moved = max(float(np.linalg.norm(found - axis)) for found in (axes.body, axes.lever))
    # A hinge that hardly leans shows neither heading nor axes, and a wrong heading drags the axes far away.
    return axes if moved < settings.max_axis_sds * settings.sd_axis_rad else Axes(axis, axis, settings.sd_axis_rad)


def tilt_shown(blocks: Blocks, axes: Axes, settings: LeverSettings) -> tuple[float, float]:
    """What the hinge shows of the two tilts against each other: its variance in rad^2, and the share still unseen.

    Tilts err about the hinge as they do across it, and across it they show: by the heights at which the two attitudes
    see the hinge, and by how well the axes are known in spite of it. What the attitudes claim counts as one pose.
    """
    n_pose = settings.scatter_memory_s / settings.block_s
    n_shown = float(np.abs(blocks.level.reshape(-1, 9) @ np.outer(axes.body, axes.lever).ravel()).sum())
    misfit = float((blocks.misfit(axes) ** 2).sum())
    return misfit / (n_shown + n_pose) + axes.sd_rad**2, n_pose / (n_shown + n_pose)


def _unit(v: FloatArray) -> FloatArray:
    unit: FloatArray = v / np.linalg.norm(v)
    return unit


def _across(axis: FloatArray) -> FloatArray:
    """(3, 2): two unit vectors across a unit axis and across each other.

    Source: Duff et al. (2017), Building an orthonormal basis, revisited, JCGT 6(1).
    """
    x, y, z = axis.tolist()
    sign = math.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[1.0 + sign * x * x * a, b], [sign * b, sign + y * y * a], [-sign * x, -y]])
