"""What speaks for each step at each moment: stays and holds, strokes, and the windows' clusters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from inhalemon.devices import Device
from inhalemon.settings import PhaseSettings
from inhalemon.signals import quantile
from inhalemon.stages.phases.holds import Hold, find_holds
from inhalemon.stages.phases.order import LABELS
from inhalemon.stages.phases.path import Path, carried_since, path_of, table_mask
from inhalemon.stages.phases.stays import Stay, find_stays
from inhalemon.stages.phases.windows import Windows, cut_windows, window_mean
from inhalemon.values import DeviceKind, Event, EventKind, FloatArray, Motion, PhaseKind, Shake

# 0, 0.5 or 1: half the bytes of a double hold that, and an hour has 360,000 samples.
Masks = NDArray[np.float32]
_COLUMN = {kind: k for k, kind in enumerate(LABELS)}


@dataclass(frozen=True, slots=True)
class Evidence:
    """What speaks for each label: by sample (`masks`) and, as a cost, by window."""

    windows: Windows
    masks: Masks  # (labels, n)
    costs: FloatArray  # (m, labels)


def gather_evidence(
    motion: Motion, shakes: Sequence[Shake], events: Sequence[Event], device: Device, settings: PhaseSettings
) -> Evidence:
    """The clustered windows and the candidate steps, as costs of labels."""
    on_table = table_mask(motion, settings)
    path = path_of(motion, on_table, settings)
    holds = find_holds(motion, path, on_table, shakes, settings)
    presses = [event for event in events if event.kind in (EventKind.PRESS, EventKind.PARTIAL_PRESS)]
    strokes = [(shake.start_s, shake.end_s) for shake in shakes]
    strokes += [(event.start_s, event.end_s) for event in events if event.kind in (EventKind.OPEN, EventKind.CLOSE)]
    stays = find_stays(motion, path, holds, strokes, presses, settings)
    stays = _one_a_dose(stays, motion, shakes, events, device, settings)
    windows = cut_windows(motion, path, shakes, settings)
    masks = _masks(motion, path, holds, stays, shakes, events, settings)
    return Evidence(windows, masks, _costs(masks, windows, settings))


def _one_a_dose(
    stays: Sequence[Stay],
    motion: Motion,
    shakes: Sequence[Shake],
    events: Sequence[Event],
    device: Device,
    settings: PhaseSettings,
) -> list[Stay]:
    """The stay at the mouth between one preparation (shaking, opening) and the next."""
    is_ellipta = device.kind is DeviceKind.ELLIPTA
    if is_ellipta:
        begins = [event.start_s for event in events if event.kind is EventKind.OPEN]
    else:
        begins = [shake.start_s for shake in shakes]
    parts: dict[int, list[Stay]] = {}
    for stay in stays:
        part = sum(begin <= motion.time_s[stay.onset] for begin in begins)
        if stay.likeness >= settings.min_likeness:
            parts.setdefault(part, []).append(stay)
    early = parts.pop(0, []) if begins else []
    if is_ellipta:
        likely = [_while_open(rivals, motion, device) for rivals in parts.values()]
        return [_at_mouth(rivals, settings) for rivals in likely if rivals]
    kept = [_at_mouth(rivals, settings) for rivals in parts.values()]
    early = [stay for stay in early if stay.lift_m > settings.min_lift_m and _is_alike(stay, kept, motion, settings)]
    # Before any preparation nothing is inhaled without a press.
    early = [stay if stay.is_pressed else replace(stay, is_tilted=False) for stay in early]
    return [_at_mouth(early, settings), *kept] if early else kept


def _while_open(rivals: Sequence[Stay], motion: Motion, device: Device) -> list[Stay]:
    """The stays while the cover is open; only for want of those, the ones with a tilt-back while it is shut."""

    def is_open(stay: Stay) -> bool:
        return float(quantile(motion.lever_rad[stay.onset : stay.end], 0.5)) > device.partial_stroke_rad

    return [stay for stay in rivals if is_open(stay)] or [stay for stay in rivals if stay.is_tilted]


def _is_alike(early: Stay, kept: Sequence[Stay], motion: Motion, settings: PhaseSettings) -> bool:
    """Whether a stay looks like the later ones before their tilt-back; a glance at the counter does not.

    That lifts the device less and turns its face to the eyes; and what was not held in the hand before has only been
    picked up. Places before and after a shake cannot be compared.
    """
    is_inhaled = early.is_tilted and early.is_pressed
    if not kept:
        return early.is_tilted or early.is_pressed
    is_lifted = early.lift_m > settings.min_lift_share * max(stay.lift_m for stay in kept)
    is_high = early.height_m > settings.min_lift_share * max(stay.height_m for stay in kept)
    raised_rad = [abs(early.elevation_rad - (stay.elevation_rad - stay.gain_rad)) for stay in kept]
    aside_rad = [abs(_turn(motion.heading_rad[early.onset] - motion.heading_rad[stay.onset])) for stay in kept]
    is_turned = min(raised_rad) > settings.usual_tilt_back_rad or min(aside_rad) > settings.max_aside_rad
    is_picked_up = early.pause[0] == early.pause[1]
    return is_lifted and is_high and (is_inhaled or not (is_turned or is_picked_up))


def _turn(angle_rad: float) -> float:
    """The same turn between -pi and pi."""
    return math.remainder(angle_rad, 2.0 * math.pi)


def _at_mouth(rivals: Sequence[Stay], settings: PhaseSettings) -> Stay:
    """The stay among rivals where the device is tilted back farthest, of the visit that is the mouth's likeliest.

    That is the highest of them, and where the tilt is clearest: nowhere else the device is held as high.
    """

    def preference(stay: Stay) -> float:
        gain = min(stay.gain_rad / settings.usual_tilt_back_rad, 2.0) if stay.is_tilted else 0.0
        return stay.likeness + 2.0 * stay.height_m + 0.1 * gain

    likeliest = max(rivals, key=preference)
    start, end = likeliest.visit
    least = likeliest.likeness - settings.one_trait
    tilted = [stay for stay in rivals if stay.is_tilted and stay.likeness > least]
    tilted = [stay for stay in tilted if stay.visit[0] < end and stay.visit[1] > start]
    return max(tilted, key=lambda stay: stay.elevation_rad) if tilted else likeliest


def _masks(
    motion: Motion,
    path: Path,
    holds: Sequence[Hold],
    stays: Sequence[Stay],
    shakes: Sequence[Shake],
    events: Sequence[Event],
    settings: PhaseSettings,
) -> Masks:
    """How much each sample looks like each step, 0 to 1, (labels, n). Handling is half believed everywhere."""
    all_masks: Masks = np.zeros((len(LABELS), motion.time_s.size), dtype=np.float32)
    masks = dict(zip(LABELS, all_masks, strict=True))
    masks[PhaseKind.HANDLING][:] = 0.5
    for shake in shakes:
        masks[PhaseKind.SHAKE][motion.index(shake.start_s) : motion.index(shake.end_s) + 1] = 1.0
    for event in events:
        if event.kind in (EventKind.OPEN, EventKind.CLOSE):
            masks[PhaseKind(event.kind.value)][motion.index(event.start_s) : motion.index(event.end_s) + 1] = 1.0
    for k, hold in enumerate(holds):
        if not hold.on_table:
            continue
        masks[PhaseKind.REST][hold.start : hold.end] = 1.0
        begin = max(holds[k - 1].end if k else 0, hold.start - round(settings.max_put_down_s * motion.rate_hz))
        # Only the last movement before the table puts the device down.
        masks[PhaseKind.PUT_DOWN][carried_since(path, begin, hold.start) : hold.start] = 1.0
    for stay in stays:
        first, last = stay.pause
        masks[PhaseKind.EXHALE][first:last] = 1.0
        masks[PhaseKind.TO_MOUTH][last : stay.onset if stay.is_tilted else stay.end] = 1.0
        if stay.is_tilted:
            masks[PhaseKind.INHALE][stay.onset : stay.end] = 1.0
            masks[PhaseKind.BREATH_HOLD][stay.end : stay.hold_end] = 1.0
            masks[PhaseKind.EXHALE_AFTER][stay.hold_end : stay.after_end] = 1.0
    return all_masks


def _costs(masks: Masks, windows: Windows, settings: PhaseSettings) -> FloatArray:
    """What each label costs in each window (m, labels): nothing where all speaks for it."""
    shares = window_mean(masks, windows.edges).T
    costs = np.ascontiguousarray(settings.cost_unlike * (1.0 - shares))
    # What the clusters look like: a shaking one is no rest, a still one no shake, and pauses are still.
    costs[:, _COLUMN[PhaseKind.SHAKE]] += settings.cost_unlike_cluster * (1.0 - windows.shaking)
    costs[:, _COLUMN[PhaseKind.REST]] += settings.cost_unlike_cluster * (1.0 - windows.stillness)
    costs[:, _COLUMN[PhaseKind.EXHALE]] += settings.cost_restless_pause * (1.0 - windows.stillness)
    shaken, at_rest = shares[:, _COLUMN[PhaseKind.SHAKE]], shares[:, _COLUMN[PhaseKind.REST]]
    costs[:, _COLUMN[PhaseKind.HANDLING]] = settings.cost_handling + shaken + at_rest
    return costs
