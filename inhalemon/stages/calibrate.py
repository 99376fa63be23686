"""Calibration of a recording from itself: the heading between the two rooms, the hinge axes, and where shut is."""

from __future__ import annotations

import itertools

import numpy as np

from inhalemon.hinge import Blocks, Heading, fit_axes, heading_difference
from inhalemon.rotation import about_z, conjugate, from_two_vectors, multiply, split_twist
from inhalemon.settings import LeverSettings
from inhalemon.values import AttitudeTrack, Calibration, FloatArray


def calibrate(
    body: AttitudeTrack,
    lever: AttitudeTrack,
    hinge_axis: FloatArray,
    settings: LeverSettings,
    *,
    has_shut_state: bool = True,
) -> Calibration:
    """What turns two attitudes into the lever's angle, learned from the recording.

    Both attitudes are at the same times (the body's clock). `hinge_axis` (3,) is the device profile's: a unit vector in
    the frames' nominal alignment, about which opening is positive. Without a shut state (a plain hinge), zero is the
    frames' own: the angle at which they are parallel.

    A finished recording (`settings.smooth`) is calibrated once from all of it. A recording under way is calibrated
    again whenever its length has doubled, and every sample is given what was known from the samples up to it.

    Raises `ValueError` when the two attitudes are at different times.
    """
    if not np.array_equal(body.time_s, lever.time_s):
        raise ValueError("body and lever must be at the same times: resample the lever's attitude first")
    axis = np.asarray(hinge_axis, dtype=np.float64) / np.linalg.norm(hinge_axis)
    time_s = body.time_s
    n = time_s.size
    blocks = Blocks.of(body, lever, settings.block_s)
    if settings.smooth:
        axis_body, axis_lever = fit_axes(blocks, axis, settings)
        heading = heading_difference(blocks, axis_body, axis_lever, settings, smooth=True)
        heading_rad = np.interp(time_s, blocks.time_s, heading.rad)
        sd_heading_rad = np.interp(time_s, blocks.time_s, heading.sd_rad)
        zero_rad, sd_zero_rad = 0.0, 0.0
        if has_shut_state:
            zero_rad, sd_zero_rad = _shut_angle(body, lever, blocks, axis_body, axis_lever, heading, settings)
        return Calibration(
            axis_body=np.broadcast_to(axis_body, (n, 3)),
            axis_lever=np.broadcast_to(axis_lever, (n, 3)),
            heading_rad=heading_rad,
            sd_heading_rad=sd_heading_rad,
            zero_rad=np.full(n, zero_rad),
            sd_zero_rad=np.full(n, sd_zero_rad),
        )
    result = Calibration(
        axis_body=np.empty((n, 3)),
        axis_lever=np.empty((n, 3)),
        heading_rad=np.empty(n),
        sd_heading_rad=np.empty(n),
        zero_rad=np.zeros(n),
        sd_zero_rad=np.zeros(n),
    )
    ends = np.append(blocks.first[1:], n)
    for begin, end in _doubling(len(blocks), settings.first_fit_blocks):
        past = blocks[:begin]
        axis_body, axis_lever = fit_axes(past, axis, settings) if begin else (axis, axis)
        heading = heading_difference(blocks[:end], axis_body, axis_lever, settings, smooth=False)
        part = slice(int(blocks.first[begin]), int(ends[end - 1]))
        result.axis_body[part] = axis_body
        result.axis_lever[part] = axis_lever
        # Inside a block only the blocks before it are known; inside the first, only the very first sample.
        block = np.repeat(np.arange(begin, end), ends[begin:end] - blocks.first[begin:end])
        before = np.maximum(block - 1, 0)
        ahead = np.where(block > 0, time_s[part] - blocks.time_s[before], 0.0)
        result.heading_rad[part] = heading.rad[before] + heading.rate_rad_s[before] * ahead
        result.sd_heading_rad[part] = heading.sd_rad[before]
        if has_shut_state and begin:
            past_heading = Heading(heading.rad[:begin], heading.rate_rad_s[:begin], heading.sd_rad[:begin])
            zero = _shut_angle(body, lever, past, axis_body, axis_lever, past_heading, settings)
            result.zero_rad[part], result.sd_zero_rad[part] = zero
        elif has_shut_state:
            result.sd_zero_rad[part] = settings.sd_zero_rad
    return result


def _doubling(n_blocks: int, first: int) -> list[tuple[int, int]]:
    """[(0, first), (first, 2 first), ...] up to `n_blocks`."""
    edges = [0]
    while edges[-1] < n_blocks:
        edges.append(min(n_blocks, max(first, 2 * edges[-1])))
    return list(itertools.pairwise(edges))


def _shut_angle(
    body: AttitudeTrack,
    lever: AttitudeTrack,
    blocks: Blocks,
    axis_body: FloatArray,
    axis_lever: FloatArray,
    heading: Heading,
    settings: LeverSettings,
) -> tuple[float, float]:
    """The twist of the shut lever and its standard deviation, both in rad.

    Shut is the smallest angle that the lever keeps for a while and that mounting alone can explain. Where there is none
    (always open, or never still), zero is the frames' own, and the standard deviation says that it was not seen.
    """
    middle = blocks.first
    q_lever = multiply(about_z(heading.rad), lever.q[middle])
    q_body_lever = multiply(conjugate(body.q[middle]), q_lever)
    twist, _ = split_twist(multiply(q_body_lever, conjugate(from_two_vectors(axis_body, axis_lever))), axis_body)
    change = np.abs(np.diff(twist, prepend=twist[0]))
    is_kept = (change < settings.max_shut_change_rad) & (np.roll(change, -1) < settings.max_shut_change_rad)
    kept = np.sort(twist[is_kept & (np.abs(twist) < settings.max_zero_rad)])
    width = settings.shut_width_rad
    n_near = np.searchsorted(kept, kept + width, side="right") - np.arange(kept.size)
    n_wanted = settings.min_shut_s / settings.block_s
    if kept.size == 0 or n_near.max() < n_wanted:
        return 0.0, settings.sd_zero_rad
    lowest = int(np.argmax(n_near >= max(n_wanted, settings.min_shut_share * n_near.max())))
    near = kept[lowest : lowest + n_near[lowest]]
    middle_rad = float(np.median(near))
    near = kept[np.abs(kept - middle_rad) < width / 2]
    return float(np.mean(near)), float(
        np.std(near) / np.sqrt(near.size * settings.block_s / settings.axis_memory_s + 1)
    )
