"""Where the device is held still, where it is tilted back and held so, and where it lies on a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inhalemon.settings import PhaseSettings
from inhalemon.signals import close_gaps, drop_short, moving_mean, onset, runs
from inhalemon.values import BoolArray, Event, FloatArray, Motion


@dataclass(frozen=True, slots=True)
class Path:
    """Where the device is and how it is turned, by integration: good for comparing times a few seconds apart."""

    pose: FloatArray  # (n, 6) turn about the body's axes and place in the room, in units of a clear movement
    speed: FloatArray  # (n,) of the pose, over a fifth of a second: a tremor of 5 Hz does not show
    turn_rad: FloatArray  # (n,) about the body's x: the tilt-back of the device in the hand
    elevation_rad: FloatArray  # (n,) of the body's y against level: the tilt-back of the head, whatever the roll
    height_m: FloatArray  # (n,)


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
    likeness: float  # 0 to 1


def path_of(motion: Motion, settings: PhaseSettings) -> Path:
    step = motion.step_s
    width = max(round(0.1 * motion.rate_hz), 1)
    turned = moving_mean(np.cumsum(motion.gyr_rad_s, axis=0) * step, width)
    place = moving_mean(np.cumsum(motion.velocity_ref_m_s, axis=0) * step, width)
    pose = np.concatenate([turned / settings.clear_turn_rad, place / settings.clear_move_m], axis=1)
    half = round(0.1 * motion.rate_hz)
    ends = np.concatenate([np.repeat(pose[:1], half, axis=0), pose, np.repeat(pose[-1:], half, axis=0)])
    apart = ends[2 * half :] - ends[: -2 * half]
    return Path(
        pose=pose,
        speed=np.sqrt(np.einsum("ij,ij->i", apart, apart)) / (2 * half * step),
        turn_rad=turned[:, 0],
        elevation_rad=moving_mean(motion.elevation_rad, width),
        height_m=place[:, 2],
    )


def table_mask(motion: Motion, settings: PhaseSettings) -> BoolArray:
    """Where the device lies on something that has no tremor."""
    width = round(settings.table_window_s * motion.rate_hz)
    force, gyr = motion.force_m_s2, motion.gyr_rad_s
    acc_var = (moving_mean(force * force, width) - moving_mean(force, width) ** 2).sum(axis=1)
    gyr_var = moving_mean((gyr * gyr).sum(axis=1), width)
    is_quiet = (acc_var < settings.table_acc_m_s2**2) & (gyr_var < settings.table_gyr_rad_s**2)
    return drop_short(is_quiet, round(settings.min_table_s * motion.rate_hz))


def find_holds(motion: Motion, path: Path, on_table: BoolArray, settings: PhaseSettings) -> list[Hold]:
    """The still stretches, from where the device arrives to where it leaves.

    A short disturbance after which the device is where it was (a press, a cough) does not end one.
    """
    rate = motion.rate_hz
    is_still = close_gaps((path.speed < settings.still_speed) & ~motion.is_gap, round(0.05 * rate))
    stretches: list[list[int]] = []
    for start, end in runs(drop_short(is_still, round(settings.min_hold_s * rate))).tolist():
        if stretches and start - stretches[-1][1] <= round(settings.max_disturbance_s * rate):
            before, after = path.pose[max(stretches[-1][1] - 10, 0)], path.pose[min(start + 10, end - 1)]
            is_same_place = float(np.linalg.norm(after - before)) < settings.same_place
            if is_same_place and not motion.is_gap[stretches[-1][1] : start].any():
                stretches[-1][1] = end
                continue
        stretches.append([start, end])
    bounds = [0, *(edge for stretch in stretches for edge in stretch), motion.time_s.size]
    holds = []
    for k, (start, end) in enumerate(stretches):
        first = _arrival(path.pose[bounds[2 * k] : (start + end) // 2 + 1]) + bounds[2 * k]
        last = _leaving(path.pose[(start + end) // 2 : bounds[2 * k + 3]]) + (start + end) // 2
        if last - first < 2:
            continue  # the hand only paused between two movements
        holds.append(
            Hold(
                start=first,
                end=last,
                height_m=float(np.median(path.height_m[start:end])),
                on_table=bool(np.mean(on_table[start:end]) > 0.5),
            )
        )
    return holds


def _leaving(pose: FloatArray) -> int:
    """The sample at which a hold is left; `pose` begins within the hold and ends before the next.

    Sway makes small distances uncertain, so the first moments are found backwards from two larger ones: a hand sets off
    somewhere between uniformly accelerated and with the least jerk, distance growing as time squared or cubed.
    """
    distance = np.linalg.norm(pose - pose[0], axis=1)
    far = int(np.argmax(distance >= 0.6))
    if distance[far] < 0.6:
        return int(distance.size)
    near = int(np.flatnonzero(distance[: far + 1] <= 0.25)[-1])
    # The hold itself may have wandered: measure again from where it was just before.
    here = pose[max(near - 15, 0)]
    distance = np.linalg.norm(pose - here, axis=1)
    later = np.flatnonzero(distance[near:] >= 0.6)
    far = near + int(later[0]) if later.size else far
    near = int(np.flatnonzero(distance[: far + 1] <= 0.2)[-1])
    return int(max(round(near - 1.4 * (far - near)), 0))


def _arrival(pose: FloatArray) -> int:
    """The sample at which a hold is reached; `pose` begins after the hold before and ends within this one."""
    last = int(pose.shape[0]) - 1
    return last - min(_leaving(pose[::-1]), last)


def find_stays(
    motion: Motion, path: Path, holds: Sequence[Hold], events: Sequence[Event], settings: PhaseSettings
) -> list[Stay]:
    """The holds in the hand that could be stays at the mouth.

    The traits: how far the device is tilted back into it, how far it was lifted to come there and sinks afterwards, and
    a press nearby. Without a tilt-back, a stay must be lifted and sink and last.
    """
    rate = motion.rate_hz
    found = []
    for k, hold in enumerate(holds):
        lasts_s = (hold.end - hold.start) / rate
        if hold.on_table or lasts_s < settings.min_stay_s:
            continue
        since = (holds[k - 1].start + holds[k - 1].end) // 2 if k else 0
        before = min(max(hold.start - round(settings.max_tilt_back_s * rate), since), hold.start)
        rises = [_rise(signal, before, hold) for signal in (path.elevation_rad, path.turn_rad)]
        gain_rad, low, signal = max(rises, key=lambda rise: rise[0])
        is_tilted = gain_rad >= settings.min_tilt_back_rad
        lift_m, drop_m = _lift_and_drop(path, holds, k, round(settings.reach_s * rate))
        begin_s, end_s = motion.time_s[low], motion.time_s[hold.end - 1]
        traits = (
            min(gain_rad / settings.usual_tilt_back_rad, 1.0) if is_tilted else 0.0,
            float(np.clip(lift_m / settings.mouth_lift_m, -1.0, 1.0)),
            float(np.clip(drop_m / settings.mouth_lift_m, -1.0, 1.0)),
            1.0 if any(begin_s - 1.0 < event.start_s < end_s for event in events) else 0.0,
        )
        if not is_tilted and (min(traits[1:3]) < 0.7 or lasts_s < settings.min_untilted_stay_s):
            continue
        hold_end, after_end = _afterwards(path, holds, k, settings)
        found.append(
            Stay(
                pause=_pause_before(path, holds, k, settings),
                onset=onset(signal, low, hold.start) if is_tilted else hold.start,
                end=hold.end,
                hold_end=hold_end,
                after_end=after_end,
                is_tilted=is_tilted,
                likeness=max(sum(traits), 0.0) / len(traits),
            )
        )
    return found


def _rise(signal: FloatArray, before: int, hold: Hold) -> tuple[float, int, FloatArray]:
    """How far the signal rises into the hold, from which sample on, and the signal."""
    low = before + int(np.argmin(signal[before : hold.start + 1]))
    return float(np.median(signal[hold.start : hold.end])) - float(signal[low]), low, signal


def _lift_and_drop(path: Path, holds: Sequence[Hold], k: int, reach: int) -> tuple[float, float]:
    """How far the device was lifted in the hand to come to a hold, and how far it sinks after it, m."""
    hold = holds[k]
    taken_up = max((other.end + reach // 4 for other in holds[:k] if other.on_table), default=0)
    earlier = path.height_m[min(max(hold.start - reach, taken_up), hold.start) : hold.start + 1]
    later = path.height_m[hold.end - 1 : hold.end + 2 * reach]
    return hold.height_m - float(np.percentile(earlier, 10)), hold.height_m - float(np.percentile(later, 10))


def _pause_before(path: Path, holds: Sequence[Hold], k: int, settings: PhaseSettings) -> tuple[int, int]:
    """The last hold in the hand before the device is lifted to this one; the dwell at the mouth itself is none."""
    for other in reversed(holds[:k]):
        if other.on_table:
            break
        if holds[k].height_m - other.height_m > 0.5 * settings.mouth_lift_m:
            return other.start, other.end
    return holds[k].start, holds[k].start


def _afterwards(path: Path, holds: Sequence[Hold], k: int, settings: PhaseSettings) -> tuple[int, int]:
    """Until when the device is taken away and held, and until when a small movement and stillness follow."""
    away = next(
        (
            j
            for j in range(k + 1, len(holds))
            if np.linalg.norm(_place(path, holds[j]) - _place(path, holds[k])) > settings.away
        ),
        None,
    )
    if away is None or holds[away].on_table:
        return holds[away - 1 if away else -1].end, holds[away - 1 if away else -1].end
    hold_end = after_end = holds[away].end
    if away + 1 < len(holds) and not holds[away + 1].on_table:
        moved = float(np.linalg.norm(_place(path, holds[away + 1]) - _place(path, holds[away])))
        if moved < settings.away and holds[away + 1].start - hold_end < settings.max_breath_s / 0.01:
            after_end = holds[away + 1].end
    return hold_end, after_end


def _place(path: Path, hold: Hold) -> FloatArray:
    place: FloatArray = np.median(path.pose[hold.start : hold.end, 3:], axis=0)
    return place
