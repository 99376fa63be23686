"""Where the device is held still, and where it lies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inhalemon import _loops_kernel as kernel
from inhalemon.settings import PhaseSettings
from inhalemon.signals import close_gaps, drop_short, lengths, memory, moving_mean, quantile, runs
from inhalemon.stages.phases.path import Path, without_noise
from inhalemon.values import BoolArray, Motion, Shake


@dataclass(frozen=True, slots=True)
class Hold:
    """A stretch in which the device is kept still, by sample numbers, half open."""

    start: int
    end: int
    place_m: tuple[float, ...]  # its middle
    height_m: float
    on_table: bool


def find_holds(
    motion: Motion, path: Path, on_table: BoolArray, shakes: Sequence[Shake], settings: PhaseSettings
) -> list[Hold]:
    """The still stretches, from where the device arrives to where it leaves.

    A short disturbance after which the device is where it was (a press, a cough) does not end one.
    """
    rate = motion.rate_hz
    is_still = close_gaps((path.speed < path.still_speed) & ~motion.is_gap, round(settings.bridged_s * rate))
    for shake in shakes:  # a swing is slow where it turns
        is_still[motion.index(shake.start_s) : motion.index(shake.end_s)] = False
    # Each hold as its still parts: several when something short disturbs it.
    groups: list[list[tuple[int, int]]] = []
    for start, end in runs(drop_short(is_still, round(settings.min_hold_s * rate))).tolist():
        if groups and start - groups[-1][-1][1] <= round(settings.max_disturbance_s * rate):
            last = groups[-1][-1][1]
            beside = round(settings.beside_s * rate)
            apart = path.pose[min(start + beside, end - 1)] - path.pose[max(last - beside, 0)]
            if float(np.linalg.norm(apart)) < settings.same_place:
                groups[-1].append((start, end))
                continue
        groups.append([(start, end)])
    holds: list[Hold] = []
    pose = (memory(path.pose.T), path.pose.shape[1])
    wandering = round(settings.wandering_s * rate)
    for k, parts in enumerate(groups):
        before = groups[k - 1][-1][1] if k else 0
        after = groups[k + 1][0][0] if k + 1 < len(groups) else motion.time_s.size
        # Sway and the path's own drift go far in seconds: the movement begins shortly before it can be told from them.
        shortly = round(settings.setting_off_s * rate)
        settled = min(sum(parts[0]) // 2, parts[0][0] + shortly)
        unsettled = max(sum(parts[-1]) // 2, parts[-1][1] - shortly)
        first = max(_leaving(pose, settled, before - 1, wandering, settings), before)
        last = _leaving(pose, unsettled, after, wandering, settings)
        if last - first < round(settings.min_hold_s * rate):
            continue  # the hand only paused between two movements
        whole = slice(parts[0][0], parts[-1][1])
        is_on_table = int(np.count_nonzero(on_table[whole])) > 0.5 * (whole.stop - whole.start)
        if is_on_table and first:
            first = _laid_down(motion, first, last, settings)
        if holds and first <= holds[-1].end and is_on_table == holds[-1].on_table:
            first = holds.pop().start  # nothing between the two went far enough to be a movement
        place_m = tuple(quantile(path.place_m[first:last], 0.5).tolist())
        holds.append(Hold(first, last, place_m, place_m[2] if path.has_place else 0.0, is_on_table))
    return holds


def _laid_down(motion: Motion, arrival: int, end: int, settings: PhaseSettings) -> int:
    """The sample since when the device lies on the table: it has met it, and the hand has let go."""
    around = round(settings.letting_go_s * motion.rate_hz)
    low, high = max(arrival - around, 0), min(arrival + around, (arrival + end) // 2)
    force = without_noise(motion.force_m_s2[low:end], motion, settings)
    gyr = without_noise(motion.gyr_rad_s[low:end], motion, settings)
    apart = lengths(force - quantile(force[high - low :], 0.5)) / settings.table_acc_m_s2
    unrest = moving_mean(apart**2 + (lengths(gyr) / settings.table_gyr_rad_s) ** 2, round(0.1 * motion.rate_hz))
    moved = np.flatnonzero(unrest[: high - low] > settings.table_unrest)
    return low + int(moved[-1]) + 1 if moved.size else low


def _leaving(
    pose: tuple[memoryview[float], int], begin: int, stop: int, wandering: int, settings: PhaseSettings
) -> int:
    """The sample at which a hold is left: `begin` is within it and `stop` before the next, or after the one before.

    `pose` is the path's, (columns, n), and how many columns there are.

    Backwards, from a `begin` after `stop`, it is where the hold is reached. `stop` when it is not left.
    Sway makes small distances uncertain, so the first moments are found backwards from two larger ones: a hand sets off
    somewhere between uniformly accelerated and with the least jerk, distance growing as time squared or cubed.
    """
    step = 1 if stop > begin else -1
    far2 = settings.far_from_hold**2
    far = kernel.first_far(*pose, begin, begin, stop, step, far2)
    if far == stop:
        return stop
    near = kernel.first_near(*pose, begin, far, begin - step, -step, settings.near_middle**2)
    # The hold itself may have wandered: measure again from where it was just before.
    here = begin + step * max(abs(near - begin) - wandering, 0)
    farther = kernel.first_far(*pose, here, near, stop, step, far2)
    far = far if farther == stop else farther
    near = kernel.first_near(*pose, here, far, begin - step, -step, settings.near_hold**2)
    return begin + step * max(round(abs(near - begin) - 1.4 * abs(far - near)), 0)
