"""Which holds are stays at the mouth, with the pause before and the held breath after."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inhalemon.settings import PhaseSettings
from inhalemon.signals import lengths, onset, quantile
from inhalemon.stages.phases.holds import Hold
from inhalemon.stages.phases.path import Path
from inhalemon.values import Event, FloatArray, Motion


@dataclass(frozen=True, slots=True)
class Stay:
    """A candidate for a stay at the mouth: the way there, the stay, and what follows. Sample numbers, half open."""

    pause: tuple[int, int]  # held still in the hand before; empty when there is none
    onset: int  # the tilt-back begins; without one, the device arrives
    end: int  # the tilt is released or the device leaves
    hold_end: int  # after the device is taken away and held still, it moves on
    after_end: int  # a small movement (breathing out) and the stillness after it
    is_tilted: bool
    is_pressed: bool
    likeness: float  # 0 to 1
    gain_rad: float  # how far it is tilted back into the stay
    elevation_rad: float  # of the body's y while it lasts
    visit: tuple[int, int]  # from the first to the last hold at this mouth
    height_m: float
    lift_m: float  # above where the device was in the hand before


def find_stays(
    motion: Motion,
    path: Path,
    holds: Sequence[Hold],
    strokes: Sequence[tuple[float, float]],
    presses: Sequence[Event],
    settings: PhaseSettings,
) -> list[Stay]:
    """The holds in the hand that could be stays at the mouth.

    The traits: how far the device is tilted back into it, how far it was carried in the hand to come there and is
    carried away afterwards, and a press nearby. `strokes` are the bouts of shaking and the strokes of the cover, which
    bound the steps before and after.
    """
    rate = motion.rate_hz
    strokes_at = [(motion.index(start_s), motion.index(end_s)) for start_s, end_s in strokes]
    found: list[Stay] = []
    for k, hold in enumerate(holds):
        lasts_s = (hold.end - hold.start) / rate
        if hold.on_table or lasts_s < settings.min_stay_s or (found and hold.end <= found[-1].end):
            continue
        barrier = _prepared(motion, holds, k, strokes_at)
        since = max(holds[k - 1].end - round(0.1 * rate) if k else 0, barrier)
        since = max(since, hold.start - round(settings.max_tilt_back_s * rate))
        before = min(since, hold.start)
        if path.has_place:
            before = _arrived(path, before, hold, settings.at_mouth_m)
        rises = [_rise(signal, before, hold) for signal in (path.elevation_rad, path.turn_rad)]
        gain_rad, low, signal = max(rises, key=lambda rise: rise[0])
        tilted_at = onset(signal, low, hold.start)
        is_tilted = settings.min_tilt_back_rad <= gain_rad <= settings.max_tilt_back_rad
        is_pressed_here = _is_pressed(motion, presses, low, hold.end)
        # What turns while it is carried turns on the way: a glance at the counter, unless it is pressed.
        is_carried = path.has_place and _speed(motion, tilted_at) > settings.carried_m_s
        is_tilted = is_tilted and (is_pressed_here or not is_carried)
        lift_m = hold.height_m - float(quantile(path.height_m[barrier : low + 1], 0.5))
        # Out of a hold near the mouth it may have risen less, if it is pressed there.
        has_paused = k > 0 and not holds[k - 1].on_table and holds[k - 1].end > barrier
        least_m = settings.raised_m if has_paused and is_pressed_here else settings.min_lift_m
        is_lifted = lasts_s >= settings.min_untilted_stay_s and lift_m > least_m
        if not (is_tilted or is_lifted):
            continue
        carried_in = _farthest(path, slice(barrier, low + 1), hold)
        near_m = max(settings.away_m, settings.mouth_sway_m + settings.head_arm_m * gain_rad)
        # It waits where the tilt-back begins, not as far off as the head then carries it.
        waits_at = path.place_m[tilted_at].tolist() if is_tilted else hold.place_m
        waits_m = min(settings.waiting_m if is_tilted else near_m, 0.5 * carried_in)
        first, last = _visit(path, holds, k, barrier, (waits_at, waits_m), (hold.place_m, near_m))
        gone = holds[last].end
        carried_out = _farthest(path, slice(gone, gone + round(settings.leaving_s * rate)), hold)
        is_lowered = lift_m < -settings.lowered_m
        gain = min(max(gain_rad, 0.0) / settings.usual_tilt_back_rad, 1.0)
        if path.has_place:
            there = -1.0 if is_lowered else min(carried_in / settings.mouth_way_m, 1.0) * 2.0 - 1.0
            back = min(carried_out / settings.mouth_way_m, 1.0) * 2.0 - 1.0
        else:
            there, back = _tilt_alone(path, signal, gain_rad, low, hold, round(settings.leaving_s * rate), settings)
        is_pressed = _is_pressed(motion, presses, min(low, holds[first].start), hold.end)
        if is_tilted:
            likeness = max(gain + there + back + is_pressed, 0.0) / 4.0
        elif min(there, back) > 0.5:
            likeness = 0.4 * (there + back)
        else:
            continue
        end = holds[_while_tilted(path, holds, k, signal, gain_rad) if is_tilted else k].end
        hold_end, after_end = _afterwards(motion, path, holds, last, strokes_at, settings)
        found.append(
            Stay(
                pause=_pause_before(motion, path, holds, first, barrier, settings),
                onset=tilted_at if is_tilted else hold.start,
                end=end,
                hold_end=hold_end,
                after_end=after_end,
                is_tilted=is_tilted,
                is_pressed=is_pressed,
                likeness=likeness,
                gain_rad=gain_rad,
                elevation_rad=float(quantile(path.elevation_rad[hold.start : hold.end], 0.5)),
                visit=(holds[first].start, holds[last].end),
                height_m=hold.height_m,
                lift_m=lift_m,
            )
        )
    return found


def _speed(motion: Motion, at: int) -> float:
    """How fast the device is carried, m/s, over a fifth of a second."""
    around = round(0.1 * motion.rate_hz)
    return float(np.linalg.norm(motion.velocity_ref_m_s[max(at - around, 0) : at + around].mean(axis=0)))


def _is_pressed(motion: Motion, presses: Sequence[Event], begin: int, end: int) -> bool:
    """Whether a press begins in a stretch, or shortly before it."""
    begin_s, end_s = motion.time_s[begin], motion.time_s[end - 1]
    return any(begin_s - 1.0 < press.start_s < end_s for press in presses)


def _visit(
    path: Path,
    holds: Sequence[Hold],
    k: int,
    barrier: int,
    before: tuple[Sequence[float], float],
    after: tuple[Sequence[float], float],
) -> tuple[int, int]:
    """The first and the last of the holds around `k` at the same mouth: no farther from the places than is given, m.

    The device waits there before the tilt-back, and may stay there when it is undone. By the turn alone, the hold
    before is taken for the one, and none for the other.
    """

    def is_near(other: Hold, place_m: Sequence[float], near_m: float) -> bool:
        return not other.on_table and math.dist(other.place_m, place_m) <= near_m

    first = last = k
    if not path.has_place:
        return (k - 1 if k and not holds[k - 1].on_table else k), k
    while first and holds[first - 1].end > barrier and is_near(holds[first - 1], *before):
        first -= 1
    while last + 1 < len(holds) and is_near(holds[last + 1], *after):
        last += 1
    return first, last


def _while_tilted(path: Path, holds: Sequence[Hold], k: int, signal: FloatArray, gain_rad: float) -> int:
    """The last hold from `k` on with the tilt kept at the same place: an unsteady hand holds in parts."""
    kept_rad = float(quantile(signal[holds[k].start : holds[k].end], 0.5)) - 0.5 * gain_rad
    last = k
    while last + 1 < len(holds) and not holds[last + 1].on_table:
        on = holds[last + 1]
        is_released = signal[holds[last].end : on.end].min() < kept_rad
        if is_released or _pose_distance(path, holds[last], on) > path.fidget:
            break
        last += 1
    return last


def _prepared(motion: Motion, holds: Sequence[Hold], k: int, strokes: Sequence[tuple[int, int]]) -> int:
    """The sample since when the device is in the hand with no stroke of any kind, before the hold `k`."""
    begin = holds[k].start
    taken_up = max((other.end + round(1.0 * motion.rate_hz) for other in holds[:k] if other.on_table), default=0)
    stroked = max((end for start, end in strokes if start < begin), default=0)
    return min(max(taken_up, stroked), begin)


def _farthest(path: Path, stretch: slice, hold: Hold) -> float:
    """How far from the hold's place the device was within a stretch, m; the odd sample does not count."""
    away = path.place_m[stretch] - hold.place_m
    return float(quantile(lengths(away), 0.8)) if away.size else 0.0


def _arrived(path: Path, since: int, hold: Hold, near_m: float) -> int:
    """The sample since when the device is near the hold's place; a turn on the way there is no tilt-back."""
    away = path.place_m[since : hold.start] - hold.place_m
    far = np.flatnonzero(lengths(away) > near_m)
    return since + (int(far[-1]) + 1 if far.size else 0)


def _rise(signal: FloatArray, before: int, hold: Hold) -> tuple[float, int, FloatArray]:
    """How far the signal rises into the hold, from which sample on, and the signal."""
    low = before + int(np.argmin(signal[before : hold.start + 1]))
    return float(quantile(signal[hold.start : hold.end], 0.5)) - float(signal[low]), low, signal


def _tilt_alone(
    path: Path, signal: FloatArray, gain_rad: float, low: int, hold: Hold, leaving: int, settings: PhaseSettings
) -> tuple[float, float]:
    """Whether the turn into a hold is a tilt back and little else, and is undone after it; -1 to 1 each."""
    turned_rad = settings.clear_turn_rad * float(np.linalg.norm(path.pose[hold.start] - path.pose[low]))
    there = 2.0 * min(max(gain_rad, 0.0) / max(turned_rad, 1e-6), 1.0) - 1.0
    held_rad = float(quantile(signal[hold.start : hold.end], 0.5))
    fall_rad = held_rad - float(signal[hold.end - 1 : hold.end + leaving].min())
    return there, 2.0 * min(max(fall_rad, 0.0) / max(gain_rad, 1e-6), 1.0) - 1.0


def _pause_before(
    motion: Motion, path: Path, holds: Sequence[Hold], first: int, barrier: int, settings: PhaseSettings
) -> tuple[int, int]:
    """The hold in the hand before the device is carried to the mouth, whose holds begin with `first`.

    Without one, where the way to the mouth begins, twice.
    """
    j = first - 1
    is_in_hand = j >= 0 and not holds[j].on_table and holds[j].end > barrier
    # Upside down is no pause.
    if not is_in_hand or quantile(motion.tilt_rad[holds[j].start : holds[j].end], 0.5) > np.pi / 2:
        begin = max(holds[j].end, barrier) if is_in_hand else min(barrier, holds[first].start)
        return begin, begin
    end = holds[j].end
    while j and not holds[j - 1].on_table and _pose_distance(path, holds[j - 1], holds[j]) < path.fidget:
        j -= 1
    start = max(holds[j].start, barrier)
    speed = path.speed[start:end]
    # The hand comes to rest bit by bit: the pause begins where it is as still as it gets.
    moving = np.flatnonzero(speed > max(settings.pause_speed, 2.0 * float(quantile(speed, 0.5))))
    early = moving[moving < min((end - start) // 2, round(settings.settling_s * motion.rate_hz))]
    return start + (int(early[-1]) + 1 if early.size else 0), end


def _afterwards(
    motion: Motion,
    path: Path,
    holds: Sequence[Hold],
    last: int,
    strokes: Sequence[tuple[int, int]],
    settings: PhaseSettings,
) -> tuple[int, int]:
    """Until when the device is held after it was taken away, and until when a small movement and stillness follow.

    `last` is its last hold at the mouth.
    """
    later = [start for start, _ in strokes if start >= holds[last].end]
    limit = min(later, default=motion.time_s.size)
    after = [hold for hold in holds[last + 1 :] if hold.start < limit and not hold.on_table]
    if not after:
        end = min(holds[last].end, limit)
        return end, end
    away = 0
    if not path.has_place:  # a head that comes back turns the device as much as a breath let out: the longest counts
        away = max(range(len(after)), key=lambda j: after[j].end - after[j].start)
    while away + 1 < len(after) and _pose_distance(path, after[away], after[away + 1]) < path.fidget:
        away += 1
    hold_end = after_end = min(after[away].end, limit)
    if away + 1 < len(after) and hold_end < limit:
        # With the breath the shoulders fall, and the hand with them.
        fallen = after[away + 1]
        has_fallen = fallen.height_m < after[away].height_m - settings.fall_m
        is_small = has_fallen and math.dist(after[away].place_m, fallen.place_m) < settings.max_fall_m
        if is_small and fallen.start - hold_end < settings.max_breath_s * motion.rate_hz:
            after_end = min(fallen.end, limit)
    return hold_end, after_end


def _pose_distance(path: Path, one: Hold, other: Hold) -> float:
    """How far apart two holds following each other are, in clear movements."""
    return math.dist(path.pose[other.start], path.pose[one.end - 1])
