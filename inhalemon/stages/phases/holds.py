"""Where the device is held still, and where it lies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inhalemon.settings import PhaseSettings
from inhalemon.signals import close_gaps, drop_short, lengths, moving_mean, quantile, runs
from inhalemon.stages.phases.path import Path, without_noise
from inhalemon.values import BoolArray, FloatArray, Motion, Shake


@dataclass(frozen=True, slots=True)
class Hold:
    """A stretch in which the device is kept still, by sample numbers, half open."""

    start: int
    end: int
    height_m: float
    on_table: bool


def find_holds(
    motion: Motion, path: Path, on_table: BoolArray, shakes: Sequence[Shake], settings: PhaseSettings
) -> list[Hold]:
    """The still stretches, from where the device arrives to where it leaves.

    A short disturbance after which the device is where it was (a press, a cough) does not end one.
    """
    rate = motion.rate_hz
    is_still = close_gaps((path.speed < path.still_speed) & ~motion.is_gap, round(0.05 * rate))
    for shake in shakes:  # a swing is slow where it turns
        is_still[motion.index(shake.start_s) : motion.index(shake.end_s)] = False
    # Each hold as its still parts: several when something short disturbs it.
    groups: list[list[tuple[int, int]]] = []
    for start, end in runs(drop_short(is_still, round(settings.min_hold_s * rate))).tolist():
        if groups and start - groups[-1][-1][1] <= round(settings.max_disturbance_s * rate):
            last = groups[-1][-1][1]
            apart = path.pose[min(start + 10, end - 1)] - path.pose[max(last - 10, 0)]
            if float(np.linalg.norm(apart)) < settings.same_place:
                groups[-1].append((start, end))
                continue
        groups.append([(start, end)])
    holds: list[Hold] = []
    for k, parts in enumerate(groups):
        before = groups[k - 1][-1][1] if k else 0
        after = groups[k + 1][0][0] if k + 1 < len(groups) else motion.time_s.size
        # Sway and the path's own drift go far in seconds: the movement begins shortly before it can be told from them.
        shortly = round(settings.setting_off_s * rate)
        settled = min(sum(parts[0]) // 2, parts[0][0] + shortly)
        unsettled = max(sum(parts[-1]) // 2, parts[-1][1] - shortly)
        first = _arrival(path.pose[before : settled + 1]) + before
        last = _leaving(path.pose[unsettled:after]) + unsettled
        if last - first < round(settings.min_hold_s * rate):
            continue  # the hand only paused between two movements
        whole = slice(parts[0][0], parts[-1][1])
        is_on_table = float(np.mean(on_table[whole])) > 0.5
        if is_on_table and first:
            first = _laid_down(motion, first, last, settings)
        if holds and first <= holds[-1].end and is_on_table == holds[-1].on_table:
            first = holds.pop().start  # nothing between the two went far enough to be a movement
        holds.append(Hold(first, last, float(quantile(path.height_m[first:last], 0.5)), is_on_table))
    return holds


def _laid_down(motion: Motion, arrival: int, end: int, settings: PhaseSettings) -> int:
    """The sample since when the device lies on the table: it has met it, and the hand has let go."""
    around = round(settings.letting_go_s * motion.rate_hz)
    low, high = max(arrival - around, 0), min(arrival + around, (arrival + end) // 2)
    force = without_noise(motion.force_m_s2[low:end], motion, settings)
    gyr = without_noise(motion.gyr_rad_s[low:end], motion, settings)
    apart = lengths(force - np.median(force[high - low :], axis=0)) / settings.table_acc_m_s2
    unrest = moving_mean(apart**2 + (lengths(gyr) / settings.table_gyr_rad_s) ** 2, round(0.1 * motion.rate_hz))
    moved = np.flatnonzero(unrest[: high - low] > settings.table_unrest)
    return low + int(moved[-1]) + 1 if moved.size else low


def _leaving(pose: FloatArray) -> int:
    """The sample at which a hold is left; `pose` begins within the hold and ends before the next.

    Sway makes small distances uncertain, so the first moments are found backwards from two larger ones: a hand sets off
    somewhere between uniformly accelerated and with the least jerk, distance growing as time squared or cubed.
    """
    distance = lengths(pose - pose[0])
    far = int(np.argmax(distance >= 0.6))
    if distance[far] < 0.6:
        return int(distance.size)
    near = int(np.flatnonzero(distance[: far + 1] <= 0.25)[-1])
    # The hold itself may have wandered: measure again from where it was just before.
    here = pose[max(near - 15, 0)]
    distance = lengths(pose - here)
    later = np.flatnonzero(distance[near:] >= 0.6)
    far = near + int(later[0]) if later.size else far
    near = int(np.flatnonzero(distance[: far + 1] <= 0.2)[-1])
    return int(max(round(near - 1.4 * (far - near)), 0))


def _arrival(pose: FloatArray) -> int:
    """The sample at which a hold is reached; `pose` begins after the hold before and ends within this one."""
    last = int(pose.shape[0]) - 1
    return last - min(_leaving(pose[::-1]), last)
