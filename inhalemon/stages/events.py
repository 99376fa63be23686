"""Presses of a lever, openings and closings of a cover, from the angle of the moving part."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inhalemon import _loops_kernel as kernel
from inhalemon.devices import Device
from inhalemon.settings import EventSettings
from inhalemon.signals import close_gaps, lengths, memory, moving_mean, onset, quantile, runs
from inhalemon.values import DeviceKind, Event, EventKind, FloatArray, Motion, Shake


def find_events(
    motion: Motion, shakes: Sequence[Shake], device: Device, settings: EventSettings | None = None
) -> tuple[Event, ...]:
    """The strokes of the moving part, in order of time.

    The angle's turning points that are at least a partial stroke apart give its rises and falls. A stroke's start is
    where its motion begins, its peak where the end stop is reached, its end where the part is back (pMDI) or at rest
    (cover). A press is a quick rise and the fall after it, told against the angle just before, so that drift does not
    count; a rise during shaking is none, since the angle itself trembles there.
    """
    settings = settings or EventSettings()
    if device.kind is DeviceKind.HINGE:
        return ()
    angle = _without_gaps(motion, settings)
    angle = moving_mean(angle, max(round(settings.smooth_s * motion.rate_hz), 1))
    strokes = _strokes(motion, angle, _least_stroke(device, settings), settings)
    if device.kind is DeviceKind.ELLIPTA:
        strokes = _joined(motion, strokes, settings)
        begins = [stroke.begin for stroke in strokes[1:]] + [motion.time_s.size - 1]
        return tuple(
            _cover_event(motion, stroke, _settled(angle, stroke, begin, motion, settings))
            for stroke, begin in zip(strokes, begins, strict=False)  # without a stroke there is the end alone
        )
    return tuple(_presses(motion, strokes, shakes, device, settings))


@dataclass(frozen=True, slots=True)
class _Stroke:
    """A rise or fall of the angle, by sample numbers of its beginning and its stop."""

    begin: int
    stop: int
    from_rad: float
    to_rad: float

    @property
    def rise_rad(self) -> float:
        return self.to_rad - self.from_rad


def _least_stroke(device: Device, settings: EventSettings) -> float:
    if device.kind is DeviceKind.ELLIPTA:
        return device.partial_stroke_rad
    return max(device.partial_stroke_rad, settings.min_stroke_rad)


def _strokes(motion: Motion, angle: FloatArray, least_rad: float, settings: EventSettings) -> list[_Stroke]:
    turns = _turning_points(angle, least_rad)
    rate = np.gradient(angle, motion.step_s)
    strokes = []
    for low, high in itertools.pairwise(turns):
        part = rate[low : high + 1] * np.sign(angle[high] - angle[low])
        # Drift may lead up to a stroke, or several strokes up one after the other: each quick part is one.
        is_quick = part > max(settings.slow_rate_rad_s, 0.1 * float(part.max()))
        for begin, end in runs(close_gaps(is_quick, round(settings.max_pause_s * motion.rate_hz))).tolist():
            stop = low + end - 1
            still = low + begin - max(round(0.1 * motion.rate_hz), (end - begin) // 2)
            first = onset(angle, max(still, low), stop)
            strokes.append(_Stroke(first, stop, float(angle[first]), float(angle[stop])))
    return [stroke for stroke in strokes if abs(stroke.rise_rad) >= least_rad]


def _turning_points(angle: FloatArray, least_rad: float) -> list[int]:
    """Alternating lows and highs, each at least `least_rad` from the one before; the ends included."""
    turns = np.empty(angle.size, dtype=np.intp)
    n_turns = kernel.turning_points(memory(angle), least_rad, turns.data)
    return [int(turn) for turn in turns[:n_turns]]


def _without_gaps(motion: Motion, settings: EventSettings) -> FloatArray:
    """The angle with a straight line over each gap and the moments around it, when both attitudes were guessing."""
    margin = round(settings.gap_margin_s * motion.rate_hz)
    is_lost = moving_mean(motion.is_gap.astype(np.float64), 2 * margin + 1) > 1e-9
    if not is_lost.any() or is_lost.all():
        return motion.lever_rad
    return np.interp(motion.time_s, motion.time_s[~is_lost], motion.lever_rad[~is_lost])


def _joined(motion: Motion, strokes: Sequence[_Stroke], settings: EventSettings) -> list[_Stroke]:
    """Strokes of a cover; one that hesitates on its way and goes on is one stroke."""
    joined: list[_Stroke] = []
    for stroke in strokes:
        last = joined[-1] if joined else None
        if (
            last is not None
            and (last.rise_rad > 0) == (stroke.rise_rad > 0)
            and (stroke.begin - last.stop) * motion.step_s < settings.max_hesitation_s
        ):
            joined[-1] = _Stroke(last.begin, stroke.stop, last.from_rad, stroke.to_rad)
        else:
            joined.append(stroke)
    return joined


def _settled(angle: FloatArray, stroke: _Stroke, limit: int, motion: Motion, settings: EventSettings) -> int:
    """The sample at which a cover rests after its stop: open, it springs back a little. Before `limit`."""
    after = angle[stroke.stop : min(stroke.stop + round(settings.settling_s * motion.rate_hz), limit) + 1]
    if stroke.rise_rad < 0 or after[0] - after[-1] < settings.min_spring_back_rad:
        return stroke.stop
    return stroke.stop + after.size - 1 - onset(after[::-1], 0, after.size - 1)


def _cover_event(motion: Motion, stroke: _Stroke, end: int) -> Event:
    kind = EventKind.OPEN if stroke.rise_rad > 0 else EventKind.CLOSE
    largest = float(np.max(motion.lever_rad[stroke.begin : stroke.stop + 1]))
    return Event(
        kind=kind,
        start_s=float(motion.time_s[stroke.begin]),
        peak_s=float(motion.time_s[stroke.stop]),
        end_s=float(motion.time_s[end]),
        angle_deg=math.degrees(largest),
    )


def _presses(
    motion: Motion, strokes: Sequence[_Stroke], shakes: Sequence[Shake], device: Device, settings: EventSettings
) -> list[Event]:
    turned = np.cumsum(lengths(motion.gyr_rad_s)) * motion.step_s
    events = []
    for k, rise in enumerate(strokes):
        lasts_s = (rise.stop - rise.begin) * motion.step_s
        if rise.rise_rad <= 0 or lasts_s > settings.max_press_rise_s:
            continue
        # A gap or a bump may let the angle sink a little before the lever comes back.
        back_rad = rise.to_rad - settings.min_release * rise.rise_rad
        fall = next((s for s in strokes[k + 1 :] if s.rise_rad < 0 and s.to_rad <= back_rad), None)
        # A lever comes back by itself; only the recording's end can hide it.
        if fall is None and motion.time_s[-1] - motion.time_s[rise.stop] > settings.max_held_s:
            continue
        release = fall.begin if fall is not None else motion.time_s.size - 1
        end = fall.stop if fall is not None else motion.time_s.size - 1
        held = motion.lever_rad[rise.stop : max(min(release, rise.stop + round(0.3 * motion.rate_hz)), rise.stop + 1)]
        stroke_rad = float(quantile(held, 0.5)) - rise.from_rad
        # The two sensors disagree a little about every turn of the whole device.
        blur_rad = settings.turn_blur * float(turned[rise.stop] - turned[rise.begin])
        # What happened in a gap was guessed by both attitudes.
        nearby = motion.is_gap[
            max(rise.begin - round(0.1 * motion.rate_hz), 0) : rise.stop + round(0.1 * motion.rate_hz)
        ]
        blur_rad += settings.gap_blur_rad_s * float(np.count_nonzero(nearby)) * motion.step_s
        # The angle trembles before the first stroke that is strong enough to count.
        is_shaken = any(shake.start_s - 0.2 < motion.time_s[rise.begin] < shake.end_s - 0.1 for shake in shakes)
        if stroke_rad < device.partial_stroke_rad + blur_rad:
            continue
        if is_shaken:
            continue  # while shaking the angle itself trembles, and nobody presses
        events.append(
            Event(
                kind=EventKind.PRESS if stroke_rad >= device.full_stroke_rad else EventKind.PARTIAL_PRESS,
                start_s=float(motion.time_s[rise.begin]),
                peak_s=float(motion.time_s[rise.stop]),
                end_s=float(motion.time_s[end]),
                angle_deg=math.degrees(stroke_rad),
            )
        )
    return events
