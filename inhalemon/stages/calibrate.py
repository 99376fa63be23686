"""Calibration of a recording from itself: the heading between the two rooms, the hinge axes, and where shut is."""

from __future__ import annotations

import itertools

import numpy as np

from inhalemon.hinge import Blocks, fit_axes, heading_difference, tilt_shown
from inhalemon.rotation import (
    conjugate,
    from_rotation_vector,
    from_two_vectors,
    multiply,
    split_twist,
    turned_about_z,
)
from inhalemon.settings import LeverSettings
from inhalemon.signals import quantile
from inhalemon.values import AttitudeTrack, Calibration, FloatArray, IntArray


def calibrate(
    body: AttitudeTrack,
    lever: AttitudeTrack,
    hinge_axis: FloatArray,
    settings: LeverSettings,
    *,
    has_shut_state: bool = True,
    are_corrected: bool = False,
) -> Calibration:
    """What turns two attitudes into the lever's angle, learned from the recording.

    Both attitudes are at the same times (the body's clock). `hinge_axis` (3,) is the device profile's: a unit vector in
    the frames' nominal alignment, about which opening is positive. Without a shut state (a plain hinge), zero is the
    frames' own: the angle at which they are parallel.

    `are_corrected` says that the sensors' biases against each other were removed, so that both attitudes err alike
    while the lever is shut.

    A finished recording (`settings.smooth`) is calibrated once from all of it. A recording under way is calibrated
    again whenever it is a tenth longer, and every sample is given what was known from the samples up to it.

    Raises `ValueError` when the two attitudes are at different times.
    """
    if not np.array_equal(body.time_s, lever.time_s):
        raise ValueError("body and lever must be at the same times: resample the lever's attitude first")
    axis = np.asarray(hinge_axis, dtype=np.float64) / np.linalg.norm(hinge_axis)
    time_s = body.time_s
    n = time_s.size
    blocks = Blocks.of(body, lever, settings.block_s)
    if settings.smooth:
        axes = fit_axes(blocks, axis, settings, is_shut_first=has_shut_state)
        heading = heading_difference(blocks, axes, settings, smooth=True, is_shut_first=has_shut_state)
        q_shut, sd_shut_rad = from_two_vectors(axes.body, axes.lever), 0.0
        if has_shut_state:
            q_shut, sd_shut_rad = _shut(body, lever, blocks.first, heading.rad, axes.body, q_shut, settings)
        shown_rad2, unseen = (0.0, 1.0) if has_shut_state else tilt_shown(blocks, axes, settings)
        return Calibration(
            axis_body=np.broadcast_to(axes.body, (n, 3)),
            q_shut=np.broadcast_to(q_shut, (n, 4)),
            sd_shut_rad=np.broadcast_to(sd_shut_rad, n),
            sd_alike_rad=settings.sd_alike_rad if are_corrected else None,
            heading_rad=np.interp(time_s, blocks.time_s, heading.rad),
            sd_heading_rad=np.interp(time_s, blocks.time_s, heading.sd_rad),
            tilt_shown_rad2=np.broadcast_to(shown_rad2, n),
            tilt_unseen=np.broadcast_to(unseen, n),
        )
    result = Calibration(np.empty((n, 3)), np.empty((n, 4)), *np.empty((5, n)))
    ends = np.append(blocks.first[1:], n)
    for begin, end in _growing(len(blocks), settings.first_fit_blocks, settings.fit_again):
        axes = fit_axes(blocks[:begin], axis, settings, is_shut_first=has_shut_state)
        heading = heading_difference(blocks[:end], axes, settings, smooth=False, is_shut_first=has_shut_state)
        q_shut, sd_shut_rad = from_two_vectors(axes.body, axes.lever), settings.sd_zero_rad * has_shut_state
        if has_shut_state and begin:
            past = blocks.first[:begin]
            q_shut, sd_shut_rad = _shut(body, lever, past, heading.rad[:begin], axes.body, q_shut, settings)
        part = slice(int(blocks.first[begin]), int(ends[end - 1]))
        result.axis_body[part] = axes.body
        result.q_shut[part] = q_shut
        result.sd_shut_rad[part] = sd_shut_rad
        # Inside a block only the blocks before it are known; inside the first, only the very first sample.
        block = np.repeat(np.arange(begin, end), ends[begin:end] - blocks.first[begin:end])
        before = np.maximum(block - 1, 0)
        ahead = np.where(block > 0, time_s[part] - blocks.time_s[before], 0.0)
        result.heading_rad[part] = heading.rad[before] + heading.rate_rad_s[before] * ahead
        result.sd_heading_rad[part] = heading.sd_rad[before]
        shown_rad2, unseen = (0.0, 1.0) if has_shut_state else tilt_shown(blocks[:begin], axes, settings)
        result.tilt_shown_rad2[part] = shown_rad2
        result.tilt_unseen[part] = unseen
    return result


def _growing(n_blocks: int, first: int, by: float) -> list[tuple[int, int]]:
    """[(0, first), (first, first + by * first), ...] up to `n_blocks`, each at least one longer than the last."""
    edges = [0]
    while edges[-1] < n_blocks:
        edges.append(min(n_blocks, max(first, edges[-1] + 1, round((1.0 + by) * edges[-1]))))
    return list(itertools.pairwise(edges))


def _shut(
    body: AttitudeTrack,
    lever: AttitudeTrack,
    at: IntArray,
    heading_rad: FloatArray,
    axis_body: FloatArray,
    q_aligned: FloatArray,
    settings: LeverSettings,
) -> tuple[FloatArray, float]:
    """`q_body_lever` of the shut lever, and the standard deviation of its turn about the hinge in rad.

    Shut is the smallest angle that the lever keeps for a while and that mounting alone can explain. Where there is none
    (always open, or never still), it is `q_aligned`, the frames' own zero, and the deviation says that it was not seen.
    """
    q_body_lever = multiply(conjugate(body.q[at]), turned_about_z(heading_rad, lever.q[at]))
    twist, _ = split_twist(multiply(q_body_lever, conjugate(q_aligned)), axis_body)
    change = np.abs(np.diff(twist, prepend=twist[0]))
    is_kept = (change < settings.max_shut_change_rad) & (np.roll(change, -1) < settings.max_shut_change_rad)
    kept = np.sort(twist[is_kept & (np.abs(twist) < settings.max_zero_rad)])
    width = settings.shut_width_rad
    n_near = np.searchsorted(kept, kept + width, side="right") - np.arange(kept.size)
    n_wanted = settings.min_shut_s / settings.block_s
    if kept.size == 0 or n_near.max() < n_wanted:
        return q_aligned, settings.sd_zero_rad
    lowest = int(np.argmax(n_near >= max(n_wanted, settings.min_shut_share * n_near.max())))
    middle_rad = float(quantile(kept[lowest : lowest + n_near[lowest]], 0.5))
    near = kept[np.abs(kept - middle_rad) < width / 2]
    n_independent = 1.0 + near.size * settings.block_s / settings.axis_memory_s
    q_shut = multiply(from_rotation_vector(np.mean(near) * axis_body), q_aligned)
    return q_shut, float(np.std(near) / np.sqrt(n_independent))
