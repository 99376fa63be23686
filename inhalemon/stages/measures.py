"""The measures of one dose, each with its standard deviation, or the reason why it cannot be had."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from inhalemon.devices import Device
from inhalemon.measures import unit_of
from inhalemon.settings import MeasureSettings
from inhalemon.signals import lengths, quantile, runs
from inhalemon.values import (
    DeviceKind,
    Event,
    EventKind,
    Measure,
    Motion,
    Phase,
    PhaseKind,
    Shake,
)

_AT_REST = (PhaseKind.PUT_DOWN, PhaseKind.REST)
# A recording that ends in one of these was cut: what comes after was not seen.
_UNFINISHED = (PhaseKind.OPEN, PhaseKind.EXHALE, PhaseKind.TO_MOUTH, PhaseKind.INHALE, PhaseKind.BREATH_HOLD)
_INVERTED_RAD = math.radians(90.0)


def measure_dose(
    motion: Motion,
    phases: Sequence[Phase],
    shakes: Sequence[Shake],
    events: Sequence[Event],
    device: Device,
    span: tuple[float, float],
    *,
    earlier_inhalation_s: float | None = None,
    settings: MeasureSettings | None = None,
) -> Mapping[str, Measure]:
    """Every measure of the dose within `span`, by name; the names and meanings are those of `inhalemon.measures`.

    `earlier_inhalation_s` is when the dose before was inhaled. A measure over a stretch with a long gap in the samples
    is not given.
    """
    settings = settings or MeasureSettings()
    dose = _Dose.of(motion, phases, shakes, events, span, settings)
    measures = _inhalation(dose, device) | _interval(dose, earlier_inhalation_s)
    if device.kind is DeviceKind.ELLIPTA:
        measures |= _cover(dose, device)
    else:
        measures |= _shake(dose) | _press(dose)
    if not motion.is_gap.any():
        return measures
    return {name: _with_gap(motion, name, measure, settings) for name, measure in measures.items()}


@dataclass(frozen=True, slots=True)
class _Dose:
    motion: Motion
    phases: tuple[Phase, ...]
    shakes: tuple[Shake, ...]
    presses: tuple[Event, ...]
    strokes: tuple[Event, ...]  # of a cover
    span: tuple[float, float]
    inhale: Phase | None
    ends_in: PhaseKind | None  # what is under way at the end, also when it began in the dose before
    settings: MeasureSettings

    @staticmethod
    def of(
        motion: Motion,
        phases: Sequence[Phase],
        shakes: Sequence[Shake],
        events: Sequence[Event],
        span: tuple[float, float],
        settings: MeasureSettings,
    ) -> _Dose:
        start_s, end_s = span
        own = tuple(phase for phase in phases if start_s <= phase.start_s < end_s)
        mine = [event for event in events if start_s <= event.start_s < end_s]
        return _Dose(
            motion=motion,
            phases=own,
            shakes=tuple(shake for shake in shakes if start_s <= shake.start_s < end_s),
            presses=tuple(e for e in mine if e.kind in (EventKind.PRESS, EventKind.PARTIAL_PRESS)),
            strokes=tuple(e for e in mine if e.kind in (EventKind.OPEN, EventKind.CLOSE)),
            span=span,
            inhale=next((phase for phase in own if phase.kind is PhaseKind.INHALE), None),
            ends_in=next((phase.kind for phase in reversed(phases) if phase.start_s < end_s), None),
            settings=settings,
        )

    def first(self, kind: PhaseKind) -> Phase | None:
        return next((phase for phase in self.phases if phase.kind is kind), None)

    def samples(self, start_s: float, end_s: float) -> slice:
        first = self.motion.index(start_s)
        return slice(first, max(self.motion.index(end_s), first + 1))

    @property
    def main_press(self) -> Event | None:
        """The press of the dose: the first full one after shaking; a weak try, or one before, only for want of it."""
        prepared_s = self.shakes[0].start_s if self.shakes else self.span[0]
        full = [press for press in self.presses if press.kind is EventKind.PRESS]
        rivals = [
            [press for press in kind if press.start_s >= since_s]
            for kind in (full, self.presses)
            for since_s in (prepared_s, self.span[0])
        ]
        return next((found[0] for found in rivals if found), None)

    @property
    def is_unsteady(self) -> bool:
        """Whether the hand is hardly ever still: walking, or in a car. Then what is not seen may still have been."""
        at_rest = [phase for phase in self.phases if phase.kind in (*_AT_REST, PhaseKind.SHAKE)]
        in_hand = np.zeros(self.motion.time_s.size, dtype=bool)
        in_hand[self.samples(*self.span)] = True
        for phase in at_rest:
            in_hand[self.samples(phase.start_s, phase.end_s)] = False
        if not in_hand.any():
            return False
        return float(np.mean(self.motion.activity[in_hand] < 1.0)) < self.settings.min_still_share

    @property
    def sd_onset_s(self) -> float:
        """Of the inhalation's start: in the middle of being carried, a turn on the way may have been taken for it."""
        if self.inhale is None:
            return self.settings.sd_inhalation_start_s
        onset_s = self.inhale.start_s
        velocity = self.motion.velocity_ref_m_s[self.samples(onset_s - 0.1, onset_s + 0.1)].mean(axis=0)
        is_carried = float(np.linalg.norm(velocity)) > self.settings.carried_m_s
        return self.settings.sd_onset_carried_s if is_carried else self.settings.sd_inhalation_start_s

    @property
    def no_onset(self) -> str:
        return "no_tilt_back_seen" if self.first(PhaseKind.TO_MOUTH) else "no_inhalation_seen"


def _inhalation(dose: _Dose, device: Device) -> dict[str, Measure]:
    s, inhale = dose.settings, dose.inhale
    to_mouth = dose.first(PhaseKind.TO_MOUTH)
    stays = sum(phase.kind is PhaseKind.INHALE for phase in dose.phases) or int(to_mouth is not None)
    unsteady = Measure(None, reason="hand_never_still")
    pause = _exhale_pause(dose)
    measures = {
        "mouth_stays": unsteady if not stays and dose.is_unsteady else Measure(float(stays), 0.0),
        "exhale_pause_s": unsteady if not pause.value and dose.is_unsteady else pause,
        "order_violations": _order_violations(dose, device.steps),
    }
    if inhale is None:
        missing = Measure(None, reason=dose.no_onset)
        names = ("inhalation_start_s", "inhalation_s", "breath_hold_s", "tilt_at_inhalation_deg")
        return measures | dict.fromkeys(names, missing)
    start_s, end_s = inhale.start_s, inhale.end_s
    held_s = start_s + min(1.0, 0.45 * (end_s - start_s))
    tilt = dose.motion.tilt_rad[dose.samples(held_s, end_s)]
    is_cut = end_s >= dose.motion.time_s[-1] - s.sd_inhalation_end_s
    cut = Measure(None, reason="recording_ended_before")
    measures["inhalation_start_s"] = Measure(start_s, dose.sd_onset_s, None, start_s, start_s)
    measures["tilt_at_inhalation_deg"] = Measure(
        math.degrees(float(quantile(tilt, 0.95))), _sd_tilt_deg(dose, start_s), None, start_s, end_s
    )
    sd = math.hypot(dose.sd_onset_s, s.sd_inhalation_end_s)
    measures["inhalation_s"] = cut if is_cut else Measure(end_s - start_s, sd, None, start_s, end_s)
    measures["breath_hold_s"] = cut if is_cut else _breath_hold(dose, end_s)
    return measures


def _exhale_pause(dose: _Dose) -> Measure:
    at_mouth = [phase for phase in dose.phases if phase.kind is PhaseKind.TO_MOUTH]
    if dose.inhale is None and not at_mouth:
        return Measure(None, reason="no_inhalation_seen")
    to_mouth = dose.inhale or at_mouth[-1]
    before = [phase for phase in dose.phases if phase.kind is PhaseKind.EXHALE and phase.start_s < to_mouth.start_s]
    sd = dose.settings.sd_exhale_pause_s
    if not before:
        return Measure(0.0, sd, None, to_mouth.start_s, to_mouth.start_s)
    pause = before[-1]
    return Measure(pause.end_s - pause.start_s, sd, None, pause.start_s, pause.end_s)


def _breath_hold(dose: _Dose, end_s: float) -> Measure:
    s = dose.settings
    hold = next((p for p in dose.phases if p.kind is PhaseKind.BREATH_HOLD and p.start_s >= end_s - 0.2), None)
    if hold is not None and hold.end_s >= dose.motion.time_s[-1] - 0.1:
        return Measure(None, reason="recording_ended_before")
    hold_end_s = hold.end_s if hold else end_s
    if any(p.kind is PhaseKind.EXHALE_AFTER and abs(p.start_s - hold_end_s) < 0.1 for p in dose.phases):
        return Measure(hold_end_s - end_s, s.sd_breath_hold_s, None, end_s, hold_end_s)
    sd, removal_s = s.sd_breath_unseen_s, 0.5 * s.max_removal_s
    is_still = dose.motion.activity[dose.samples(end_s + removal_s, dose.span[1])] < 1.0
    moved_s = removal_s + float(np.argmax(is_still) if is_still.any() else is_still.size) * dose.motion.step_s
    if moved_s > s.max_removal_s:
        # Too long for one movement: the breath may have been let out in it, and was, if little stillness follows.
        sd = math.hypot(sd, (moved_s - removal_s) / math.sqrt(12.0))
        if 0.0 < hold_end_s - end_s < 2.0 * moved_s:
            hold_end_s = end_s + 0.5 * (removal_s + moved_s)
    return Measure(hold_end_s - end_s, sd, None, end_s, hold_end_s)


def _order_violations(dose: _Dose, steps: Sequence[PhaseKind]) -> Measure:
    """How often strokes (shaking, opening, closing) and what is done at the mouth come in another order than `steps`.

    Each stay at the mouth and full press after which a stroke comes that belongs before it counts, and a last stroke
    before inhaling that belongs after it. A step that `steps` leaves out is in nobody's way.
    """
    place = {step: k for k, step in enumerate(steps)}
    inhaled_s = dose.inhale.start_s if dose.inhale else dose.span[1]
    strokes = [(shake.start_s, PhaseKind.SHAKE) for shake in dose.shakes]
    strokes += [(stroke.start_s, PhaseKind(stroke.kind.value)) for stroke in dose.strokes]
    strokes = sorted(stroke for stroke in strokes if stroke[0] < inhaled_s and stroke[1] in place)
    stays = (phase for phase in dose.phases if phase.kind is PhaseKind.TO_MOUTH)
    presses = (press for press in dose.presses if press.kind is EventKind.PRESS)
    at_mouth = [
        *((stay.start_s, PhaseKind.TO_MOUTH) for stay in stays),
        *((p.start_s, PhaseKind.INHALE) for p in presses),
    ]
    count = sum(
        any(later_s > start_s and place[stroke] < place[step] for later_s, stroke in strokes)
        for start_s, step in at_mouth
        if step in place
    )
    if dose.inhale is not None and strokes and PhaseKind.INHALE in place:
        count += place[strokes[-1][1]] > place[PhaseKind.INHALE]
    return Measure(float(count), 0.0)


def _interval(dose: _Dose, earlier_s: float | None) -> dict[str, Measure]:
    if earlier_s is None:
        return {"puff_interval_s": Measure(None, reason="first_dose")}
    if dose.inhale is None:
        return {"puff_interval_s": Measure(None, reason=dose.no_onset)}
    start_s = dose.inhale.start_s
    sd = math.hypot(dose.settings.sd_inhalation_start_s, dose.sd_onset_s)
    return {"puff_interval_s": Measure(start_s - earlier_s, sd, None, earlier_s, start_s)}


def _shake(dose: _Dose) -> dict[str, Measure]:
    """Shaking before the press; without a press before the inhalation; without either in the whole dose."""
    s = dose.settings
    press = dose.main_press
    until_s = press.start_s if press else dose.inhale.start_s if dose.inhale else dose.span[1]
    before = [shake for shake in dose.shakes if shake.start_s < until_s]
    if not before:
        none = Measure(0.0, 0.0)
        return {
            "shake_duration_s": none,
            "shake_cycles": none,
            "shake_to_press_s": Measure(None, reason="not_shaken"),
        }
    start_s, end_s = before[0].start_s, before[-1].end_s
    to_press = Measure(None, reason="no_press")
    if press:
        sd = math.hypot(s.sd_shake_s, s.sd_press_s)
        to_press = Measure(press.start_s - end_s, sd, None, end_s, press.start_s)
    return {
        "shake_duration_s": Measure(end_s - start_s, math.sqrt(2.0) * s.sd_shake_s, None, start_s, end_s),
        "shake_cycles": _cycles(before, start_s, end_s),
        "shake_to_press_s": to_press,
    }


def _cycles(shakes: Sequence[Shake], start_s: float, end_s: float) -> Measure:
    """Up-and-downs of some bouts: half as many as strokes."""
    n_strokes = sum(shake.stroke_end_s.size for shake in shakes)
    sd_strokes = math.hypot(*(shake.sd_strokes for shake in shakes))
    return Measure(n_strokes / 2.0, sd_strokes / 2.0, None, start_s, end_s)


def _press(dose: _Dose) -> dict[str, Measure]:
    s, presses = dose.settings, dose.presses
    full = [press for press in presses if press.kind is EventKind.PRESS]
    where = (presses[0].start_s, presses[-1].end_s) if presses else (None, None)
    measures = {
        "press_count": Measure(float(len(full)), 0.0, None, *where),
        "partial_press_count": Measure(float(len(presses) - len(full)), 0.0, None, *where),
    }
    first = dose.main_press
    if first is None:
        names = ("press_angle_deg", "tilt_at_press_deg", "coordination_s", "press_after_mouth_s")
        return measures | dict.fromkeys(names, Measure(None, reason="no_press"))
    # Presses to the end stop are equal: the first of those that cannot be told from the largest.
    least_deg = max(press.angle_deg for press in presses) - 2.0 * s.sd_press_angle_deg
    largest = next(press for press in presses if press.angle_deg >= least_deg)
    near = dose.samples(largest.peak_s - 0.05, largest.peak_s + 0.05)
    measures["press_angle_deg"] = Measure(largest.angle_deg, s.sd_press_angle_deg, None, largest.start_s, largest.end_s)
    measures["tilt_at_press_deg"] = Measure(
        math.degrees(float(quantile(dose.motion.tilt_rad[near], 0.5))),
        _sd_tilt_deg(dose, largest.peak_s),
        None,
        largest.start_s,
        largest.end_s,
    )
    if dose.inhale is None:
        missing = Measure(None, reason=dose.no_onset)
        return measures | {"coordination_s": missing, "press_after_mouth_s": missing}
    onset_s = dose.inhale.start_s
    sd = math.hypot(s.sd_press_s, dose.sd_onset_s)
    shown = (min(onset_s, first.start_s), max(onset_s, first.start_s))
    measures["coordination_s"] = Measure(first.start_s - onset_s, sd, None, *shown)
    measures["press_after_mouth_s"] = Measure(
        first.start_s - _left_mouth_s(dose, dose.inhale), s.sd_inhalation_end_s, None, *shown
    )
    return measures


def _left_mouth_s(dose: _Dose, inhale: Phase) -> float:
    """When the device has gone from where it was while inhaling; the end of the dose if it never does."""
    motion = dose.motion
    at = dose.samples(inhale.start_s, dose.span[1])
    place = np.cumsum(motion.velocity_ref_m_s[at], axis=0) * motion.step_s
    n_inhale = min(max(motion.index(inhale.end_s) - at.start, 1), len(place))  # a dose may end while it lasts
    here = quantile(place[n_inhale // 2 : n_inhale], 0.5)
    away = lengths(place[n_inhale:] - here) > dose.settings.left_mouth_m
    if not away.any():
        return dose.span[1]
    return float(motion.time_s[at.start + n_inhale + int(np.argmax(away))])


def _cover(dose: _Dose, device: Device) -> dict[str, Measure]:
    s, motion = dose.settings, dose.motion
    angle = motion.lever_rad[dose.samples(*dose.span)]
    inhaled_s = dose.inhale.start_s if dose.inhale else dose.span[1]
    openings = [stroke for stroke in dose.strokes if stroke.kind is EventKind.OPEN and stroke.start_s < inhaled_s]
    full_deg = math.degrees(device.full_stroke_rad)
    last_s = dose.span[1]
    stroked_s = dose.strokes[-1].end_s if dose.strokes else dose.span[0]
    final = motion.lever_rad[dose.samples(max(last_s - 0.5, stroked_s), last_s)]
    is_cut = last_s >= motion.time_s[-1] - 0.1 and dose.ends_in in _UNFINISHED
    shown = (openings[0].start_s, openings[-1].end_s) if openings else (None, None)
    measures = {
        "cover_angle_max_deg": Measure(
            max((o.angle_deg for o in openings), default=math.degrees(float(quantile(angle, 0.99)))),
            s.sd_cover_angle_deg,
            None,
            *shown,
        ),
        "cover_final_deg": Measure(None, reason="recording_ended_before")
        if is_cut
        else Measure(math.degrees(float(quantile(final, 0.5))), s.sd_cover_shut_deg, None, last_s - 0.5, last_s),
        "cover_openings": Measure(float(sum(o.angle_deg >= full_deg for o in openings)), 0.0, None, *shown),
    }
    names = ("shake_after_open_cycles", "tilt_after_open_max_deg", "inverted_after_open_s", "open_to_inhale_s")
    if not openings:
        return measures | dict.fromkeys(names, Measure(None, reason="not_opened"))
    opened_s = openings[-1].peak_s
    # Without an inhalation: until the device is shut or put down.
    ends = [stroke.start_s for stroke in dose.strokes if stroke.start_s > opened_s]
    ends += [phase.start_s for phase in dose.phases if phase.kind in _AT_REST and phase.start_s > opened_s]
    inhaled_s = inhaled_s if dose.inhale else min([inhaled_s, *ends])
    between = dose.samples(opened_s, inhaled_s)
    tilt = motion.tilt_rad[between]
    shaken = [shake for shake in dose.shakes if opened_s <= shake.start_s < inhaled_s]
    where = (opened_s, inhaled_s)
    measures["shake_after_open_cycles"] = _cycles(shaken, *where)
    measures["tilt_after_open_max_deg"] = Measure(
        math.degrees(float(tilt.max())), _sd_tilt_deg(dose, opened_s), None, *where
    )
    inverted_s = float(np.count_nonzero(tilt > _INVERTED_RAD)) * motion.step_s
    measures["inverted_after_open_s"] = Measure(inverted_s, s.sd_inverted_s if inverted_s else 0.0, None, *where)
    measures["open_to_inhale_s"] = (
        Measure(inhaled_s - opened_s, math.hypot(s.sd_cover_stop_s, dose.sd_onset_s), None, *where)
        if dose.inhale
        else Measure(None, reason=dose.no_onset)
    )
    return measures


def _sd_tilt_deg(dose: _Dose, at_s: float) -> float:
    sd = float(dose.motion.sd_tilt_rad[dose.motion.index(at_s)])
    return math.degrees(math.hypot(sd, dose.settings.sd_mount_rad))


def _with_gap(motion: Motion, name: str, measure: Measure, settings: MeasureSettings) -> Measure:
    """A measure whose stretch has a gap says so: no value over a long one, less sure over a short one."""
    if measure.value is None or measure.start_s is None or measure.end_s is None:
        return measure
    first, last = motion.index(measure.start_s), motion.index(measure.end_s) + 1
    if not motion.is_gap[first:last].any():
        return measure
    gaps = [(start, end) for start, end in runs(motion.is_gap).tolist() if end > first and start < last]
    longest_s = max(end - start for start, end in gaps) * motion.step_s
    inside_s = float(np.count_nonzero(motion.is_gap[first:last])) * motion.step_s
    if longest_s > settings.max_gap_s or inside_s > settings.max_gap_share * (measure.end_s - measure.start_s):
        return Measure(None, reason="gap_in_the_recording")
    near = round(0.2 * motion.rate_hz)
    at_an_end = any(start < first + near or end > last - near for start, end in gaps)
    sd = measure.sd or 0.0
    if at_an_end and measure.value and unit_of(name) == "s":
        sd = math.hypot(sd, longest_s / 2.0)
    return replace(measure, sd=sd, reason="crosses_a_gap")
