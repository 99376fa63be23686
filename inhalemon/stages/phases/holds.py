"""Where the device is held still, where it is tilted back and held so, and where it lies on a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from inhalemon.settings import PhaseSettings
from inhalemon.signals import close_gaps, drop_short, lengths, moving_mean, onset, quantile, runs
from inhalemon.values import BoolArray, Event, FloatArray, Motion, Shake


@dataclass(frozen=True, slots=True)
class Path:
    """Where the device is and how it is turned, by integration: good for comparing times a few seconds apart."""

    pose: FloatArray  # (n, 3 or 6) turn about the body's axes and place in the room, in units of a clear movement
    speed: FloatArray  # (n,) of the pose, over a fifth of a second: a tremor of 5 Hz does not show
    turn_rad: FloatArray  # (n,) about the body's x: the tilt-back of the device in the hand
    elevation_rad: FloatArray  # (n,) of the body's y against level: the tilt-back of the head, whatever the roll
    place_m: FloatArray  # (n, 3) in the room
    height_m: FloatArray  # (n,)
    still_speed: float  # below it this hand holds still
    has_place: bool  # else only the turn is known, and a place means a turn as clear


@dataclass(frozen=True, slots=True)
class Hold:
    """A stretch in which the device is kept still, by sample numbers, half open."""

    start: int
    end: int
    height_m: float
    on_table: bool


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
    height_m: float
    lift_m: float  # above where the device was in the hand before


def path_of(motion: Motion, on_table: BoolArray, settings: PhaseSettings) -> Path:
    """The path, smoothed as little as lets the hand be still for a fair share of the time.

    A step or a road shakes a hand at 1-2 Hz that holds still all the same, and carries it along: where smoothing does
    not help, the path is that of the turn alone, of which neither has much.
    """
    in_hand = ~on_table
    tried = [*((smooth_s, True) for smooth_s in settings.smooth_s), (settings.smooth_s[-1], False)]
    for smooth_s, has_place in tried:
        path = _smoothed(motion, smooth_s, settings, has_place=has_place)
        if not in_hand.any() or np.mean(path.speed[in_hand] < settings.still_speed) >= settings.min_still_share:
            break
    if not in_hand.any():
        return path
    # A hand that sways never comes below the speed of its sway.
    sway = settings.times_sway * float(quantile(path.speed[in_hand], 0.25))
    return replace(path, still_speed=min(max(settings.still_speed, sway), settings.max_still_speed))


def _smoothed(motion: Motion, smooth_s: float, settings: PhaseSettings, *, has_place: bool) -> Path:
    step = motion.step_s
    width = max(round(smooth_s * motion.rate_hz), 1)
    turned = moving_mean(np.cumsum(motion.gyr_rad_s, axis=0) * step, width)
    if has_place:
        place = moving_mean(np.cumsum(motion.velocity_ref_m_s, axis=0) * step, width)
        pose = np.concatenate([turned / settings.clear_turn_rad, place / settings.clear_move_m], axis=1)
        height = place[:, 2]
    else:
        pose = turned / settings.clear_turn_rad
        place = pose * settings.clear_move_m
        height = np.zeros(motion.time_s.size)
    half = round(0.1 * motion.rate_hz)
    ends = np.concatenate([np.repeat(pose[:1], half, axis=0), pose, np.repeat(pose[-1:], half, axis=0)])
    apart = ends[2 * half :] - ends[: -2 * half]
    return Path(
        pose=pose,
        speed=lengths(apart) / (2 * half * step),
        turn_rad=turned[:, 0],
        elevation_rad=moving_mean(motion.elevation_rad, width),
        place_m=place,
        height_m=height,
        still_speed=settings.still_speed,
        has_place=has_place,
    )


def table_mask(motion: Motion, settings: PhaseSettings) -> BoolArray:
    """Where the device lies on something that has no tremor: 6-12 Hz, below most of a sensor's noise."""
    width = round(settings.table_window_s * motion.rate_hz)
    force, gyr = _without_noise(motion.force_m_s2, motion, settings), _without_noise(motion.gyr_rad_s, motion, settings)
    acc_var = (moving_mean(force * force, width) - moving_mean(force, width) ** 2).sum(axis=1)
    gyr_var = (moving_mean(gyr * gyr, width) - moving_mean(gyr, width) ** 2).sum(axis=1)
    is_quiet = (acc_var < settings.table_acc_m_s2**2) & (gyr_var < settings.table_gyr_rad_s**2)
    return drop_short(is_quiet, round(settings.min_table_s * motion.rate_hz))


def _without_noise(values: FloatArray, motion: Motion, settings: PhaseSettings) -> FloatArray:
    return moving_mean(values, max(round(settings.noise_smooth_s * motion.rate_hz), 1))


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
    holds = []
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
    force = _without_noise(motion.force_m_s2[low:end], motion, settings)
    gyr = _without_noise(motion.gyr_rad_s[low:end], motion, settings)
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
    found = []
    for k, hold in enumerate(holds):
        lasts_s = (hold.end - hold.start) / rate
        if hold.on_table or lasts_s < settings.min_stay_s:
            continue
        barrier = _prepared(motion, holds, k, strokes)
        since = max(holds[k - 1].end - round(0.1 * rate) if k else 0, barrier)
        since = max(since, hold.start - round(settings.max_tilt_back_s * rate))
        before = min(since, hold.start)
        if path.has_place:
            before = _arrived(path, before, hold, settings.at_mouth_m)
        rises = [_rise(signal, before, hold) for signal in (path.elevation_rad, path.turn_rad)]
        gain_rad, low, signal = max(rises, key=lambda rise: rise[0])
        is_tilted = settings.min_tilt_back_rad <= gain_rad <= settings.max_tilt_back_rad
        carried_in = _farthest(path, slice(barrier, low + 1), hold)
        carried_out = _farthest(path, slice(hold.end, hold.end + round(settings.leaving_s * rate)), hold)
        earlier_m = float(quantile(path.height_m[barrier : low + 1], 0.5))
        lift_m = hold.height_m - earlier_m
        is_lowered = lift_m < -settings.lowered_m
        gain = min(max(gain_rad, 0.0) / settings.usual_tilt_back_rad, 1.0)
        if path.has_place:
            there = -1.0 if is_lowered else min(carried_in / settings.mouth_way_m, 1.0) * 2.0 - 1.0
            back = min(carried_out / settings.mouth_way_m, 1.0) * 2.0 - 1.0
        else:
            there, back = _tilt_alone(path, signal, gain_rad, low, hold, round(settings.leaving_s * rate), settings)
        begin_s, end_s = motion.time_s[low], motion.time_s[hold.end - 1]
        is_pressed = any(begin_s - 1.0 < press.start_s < end_s for press in presses)
        if is_tilted:
            likeness = max(gain + there + back + is_pressed, 0.0) / 4.0
        elif min(there, back) > 0.5 and lasts_s >= settings.min_untilted_stay_s and lift_m > settings.min_lift_m:
            likeness = 0.4 * (there + back)
        else:
            continue
        last = _while_tilted(path, holds, k, signal, gain_rad, settings) if is_tilted else k
        hold_end, after_end = _afterwards(motion, path, holds, last, strokes, settings)
        found.append(
            Stay(
                pause=_pause_before(motion, path, holds, k, barrier, min(settings.away_m, 0.5 * carried_in), settings),
                onset=onset(signal, low, hold.start) if is_tilted else hold.start,
                end=holds[last].end,
                hold_end=hold_end,
                after_end=after_end,
                is_tilted=is_tilted,
                is_pressed=is_pressed,
                likeness=likeness,
                height_m=hold.height_m,
                lift_m=lift_m,
            )
        )
    return found


def _while_tilted(
    path: Path, holds: Sequence[Hold], k: int, signal: FloatArray, gain_rad: float, settings: PhaseSettings
) -> int:
    """The last of the holds from `k` on up to which the tilt is kept, at the same place: an unsteady hand holds in parts."""
    kept_rad = float(quantile(signal[holds[k].start : holds[k].end], 0.5)) - 0.5 * gain_rad
    last = k
    while last + 1 < len(holds) and not holds[last + 1].on_table:
        on = holds[last + 1]
        if signal[holds[last].end : on.end].min() < kept_rad or _distance(path, on, holds[k]) > 0.5 * settings.away_m:
            break
        last += 1
    return last


def _prepared(motion: Motion, holds: Sequence[Hold], k: int, strokes: Sequence[tuple[float, float]]) -> int:
    """The sample since when the device is in the hand with no stroke of any kind, before the hold `k`."""
    begin = holds[k].start
    taken_up = max((other.end + round(1.0 * motion.rate_hz) for other in holds[:k] if other.on_table), default=0)
    stroked = max((motion.index(end_s) for start_s, end_s in strokes if motion.index(start_s) < begin), default=0)
    return min(max(taken_up, stroked), begin)


def _farthest(path: Path, stretch: slice, hold: Hold) -> float:
    """How far from the hold's place the device was within a stretch, m; the odd sample does not count."""
    away = path.place_m[stretch] - quantile(path.place_m[hold.start : hold.end], 0.5)
    return float(quantile(lengths(away), 0.8)) if away.size else 0.0


def _arrived(path: Path, since: int, hold: Hold, near_m: float) -> int:
    """The sample since when the device is near the hold's place; a turn on the way there is no tilt-back."""
    away = path.place_m[since : hold.start] - quantile(path.place_m[hold.start : hold.end], 0.5)
    far = np.flatnonzero(lengths(away) > near_m)
    return since + (int(far[-1]) + 1 if far.size else 0)


def _rise(signal: FloatArray, before: int, hold: Hold) -> tuple[float, int, FloatArray]:
    """How far the signal rises into the hold, from which sample on, and the signal."""
    low = before + int(np.argmin(signal[before : hold.start + 1]))
    return float(quantile(signal[hold.start : hold.end], 0.5)) - float(signal[low]), low, signal


def carried_since(path: Path, begin: int, end: int) -> int:
    """The sample since when the device is carried, in one go, to where it is at `end`; not before `begin`.

    A movement has begun where its speed first stays above a tenth of its highest.
    """
    speed = path.speed[begin:end]
    if not speed.size:
        return begin
    fastest = int(np.argmax(speed))
    slow = np.flatnonzero(speed[: fastest + 1] < 0.1 * speed[fastest])
    return begin + (int(slow[-1]) if slow.size else 0)


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
    motion: Motion,
    path: Path,
    holds: Sequence[Hold],
    k: int,
    barrier: int,
    away_m: float,
    settings: PhaseSettings,
) -> tuple[int, int]:
    """The last hold in the hand before the device is carried to the hold `k`; a dwell at the mouth itself is none.

    Without one, where the way to the mouth begins, twice.
    """
    for j in range(k - 1, -1, -1):
        other = holds[j]
        if other.on_table or other.end <= barrier:
            break
        # By the turn alone, the hold next to the tilt-back is taken for the dwell.
        if _distance(path, other, holds[k]) <= away_m if path.has_place else j == k - 1:
            continue
        if quantile(motion.tilt_rad[other.start : other.end], 0.5) > np.pi / 2:
            break  # upside down is no pause
        # A fidget, wider in a hand that sways, does not end a pause; a regrip does.
        fidget = settings.regrip * path.still_speed / settings.still_speed
        while j and not holds[j - 1].on_table and _pose_distance(path, holds[j - 1], holds[j]) < fidget:
            j -= 1  # noqa: PLW2901
        first = max(holds[j].start, barrier)
        speed = path.speed[first : other.end]
        # The hand comes to rest bit by bit: the pause begins where it is as still as it gets.
        moving = np.flatnonzero(speed > max(settings.pause_speed, 2.0 * float(quantile(speed, 0.5))))
        early = moving[moving < min((other.end - first) // 2, round(settings.settling_s * motion.rate_hz))]
        return first + (int(early[-1]) + 1 if early.size else 0), other.end
    begin = max((other.end for other in holds[:k] if not other.on_table), default=barrier)
    begin = max(min(begin, holds[k].start), barrier)
    return begin, begin


def _afterwards(
    motion: Motion,
    path: Path,
    holds: Sequence[Hold],
    k: int,
    strokes: Sequence[tuple[float, float]],
    settings: PhaseSettings,
) -> tuple[int, int]:
    """Until when the device is taken away and held, and until when a small movement and stillness follow."""
    later = [motion.index(start_s) for start_s, _ in strokes if motion.index(start_s) >= holds[k].end]
    limit = min(later, default=motion.time_s.size)
    after = [hold for hold in holds[k + 1 :] if hold.start < limit and not hold.on_table]
    if path.has_place:
        away = next((j for j, hold in enumerate(after) if _distance(path, hold, holds[k]) > settings.away_m), None)
    else:  # a head that comes back turns the device as much as a breath let out: the longest hold is the breath's
        away = max(range(len(after)), key=lambda j: after[j].end - after[j].start, default=None)
    if away is None:
        end = min((after[-1] if after else holds[k]).end, limit)
        return end, end
    while away + 1 < len(after) and _pose_distance(path, after[away], after[away + 1]) < settings.fidget:
        away += 1
    hold_end = after_end = min(after[away].end, limit)
    if away + 1 < len(after) and hold_end < limit:
        # With the breath the shoulders fall, and the hand with them.
        fallen = after[away + 1]
        has_fallen = fallen.height_m < after[away].height_m - settings.fall_m
        is_small = has_fallen and _distance(path, after[away], fallen) < settings.max_fall_m
        if is_small and fallen.start - hold_end < settings.max_breath_s * motion.rate_hz:
            after_end = min(fallen.end, limit)
    return hold_end, after_end


def _pose_distance(path: Path, one: Hold, other: Hold) -> float:
    """How far apart two holds following each other are, in clear movements."""
    return float(np.linalg.norm(path.pose[other.start] - path.pose[one.end - 1]))


def _distance(path: Path, one: Hold, other: Hold) -> float:
    here, there = (quantile(path.place_m[hold.start : hold.end], 0.5) for hold in (one, other))
    return float(np.linalg.norm(here - there))
