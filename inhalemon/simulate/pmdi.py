"""A pMDI session as it is acted: take up, cap off, shake, breathe out, to the mouth, inhale and press, hold."""

from __future__ import annotations

from typing import Final

import numpy as np

from inhalemon.simulate.motion import PITCH, ROLL, YAW
from inhalemon.simulate.performance import HAND_M, Performance
from inhalemon.simulate.steps import (
    DoseNotes,
    Manner,
    breathe_out,
    bring_to_mouth,
    hold_breath,
    inhale,
    pause,
    put_down,
    settle,
    take_up,
    upright,
)
from inhalemon.values import PhaseKind

_DEG: Final = np.pi / 180


def act_pmdi(p: Performance, manner: Manner, mistakes: frozenset[str], n_doses: int) -> list[DoseNotes]:
    """Acts `n_doses` doses, each with the same mistakes."""
    rng = p.rng
    taken_s = take_up(p, manner)
    p.begin(PhaseKind.HANDLING)
    p.fumble(float(rng.uniform(1.0, 2.5)) * manner.clumsiness, turn_rad=14 * _DEG * manner.clumsiness)
    p.knock(float(rng.uniform(2.0, 9.0)))  # the cap comes off
    p.move(float(rng.uniform(0.4, 0.7)), upright(p))
    doses = []
    for i in range(n_doses):
        if i:
            p.begin(PhaseKind.HANDLING)
            p.fumble(float(rng.uniform(1.5, 3.0)), reach_m=0.03, turn_rad=8 * _DEG)
            p.move(0.5, upright(p))
        doses.append(_dose(p, manner, mistakes))
    p.begin(PhaseKind.HANDLING)
    p.fumble(float(rng.uniform(0.8, 1.8)))  # the cap goes on
    let_go_s = put_down(p, manner)
    p.unsteady(taken_s, let_go_s, times=manner.clumsiness)
    return doses


def _dose(p: Performance, manner: Manner, mistakes: frozenset[str]) -> DoseNotes:
    notes = DoseNotes(start_s=p.now_s)
    if "order_wrong" in mistakes:
        _to_mouth_too_soon(p, notes)
    _shake(p, mistakes)
    if "no_inhalation" in mistakes:
        _never_inhale(p, notes, mistakes)
    else:
        _breathe_out_and_to_mouth(p, notes, mistakes)
        _inhale_and_press(p, notes, manner, mistakes)
        breathe_out(p, manner)
    notes.end_s = p.now_s
    return notes


def _to_mouth_too_soon(p: Performance, notes: DoseNotes) -> None:
    """Breathes out and is at the mouth already when the shake is remembered."""
    rng = p.rng
    p.begin(PhaseKind.EXHALE)
    p.wait(float(rng.uniform(2.2, 3.2)))
    bring_to_mouth(p, dwell_s=float(rng.uniform(0.8, 1.5)))
    p.begin(PhaseKind.HANDLING)
    p.to_place(float(rng.uniform(0.8, 1.1)), HAND_M, upright(p))
    p.wait(0.2)
    notes.n_order_violations = 1


def _shake(p: Performance, mistakes: frozenset[str]) -> None:
    rng = p.rng
    if "not_shaken" in mistakes:
        p.begin(PhaseKind.HANDLING)
        p.fumble(float(rng.uniform(0.8, 1.6)), reach_m=0.03, turn_rad=10 * _DEG)
        return
    p.begin(PhaseKind.SHAKE)
    if "shake_too_short" in mistakes:
        # Four strokes at least, or it would not be a shake: two cycles take 0.4-0.7 s.
        strength = max(p.subject.shake_m_s2, 1.5 * 9.81)
        p.shake(float(rng.uniform(3.3, 4.2)) / p.subject.shake_hz, acc_m_s2=strength, hz=p.subject.shake_hz)
    else:
        p.shake(float(rng.uniform(3.2, 6.5)))


def _breathe_out_and_to_mouth(p: Performance, notes: DoseNotes, mistakes: frozenset[str]) -> None:
    rng = p.rng
    p.begin(PhaseKind.HANDLING)
    if "shake_to_press_delay" in mistakes:
        settle(p)
        p.wait(float(rng.uniform(25.0, 28.0) if rng.random() < 0.15 else rng.uniform(5.0, 6.5)))
        p.fumble(float(rng.uniform(5.5, 7.0)), reach_m=0.03, turn_rad=10 * _DEG)
    if "no_exhale_pause" in mistakes:
        notes.pause_start_s = p.now_s
        p.wait(float(rng.uniform(0.0, 0.15)))
        notes.pause_end_s = p.now_s
    else:
        settle(p)
        # A late press must not come too late after the shake as well.
        pause(p, notes, float(rng.uniform(1.7, 2.0 if "press_late" in mistakes else 3.2)))
    turns = {}
    if "not_upright_at_press" in mistakes:
        if rng.random() < 0.6 or p.subject.tilt_back_rad > 22 * _DEG:
            turns = {ROLL: p.subject.hand * float(rng.uniform(60.0, 72.0)) * _DEG, PITCH: 0.0}
        else:  # lying back: over the limit before the tilt-back, and not inverted after it
            turns = {PITCH: 66 * _DEG - 0.5 * p.subject.tilt_back_rad}
    elif "inverted_at_press" in mistakes:
        turns = {ROLL: p.subject.hand * float(rng.uniform(140.0, 172.0)) * _DEG, PITCH: 0.0}
    bring_to_mouth(p, turns, dwell_s=float(rng.uniform(1.3, 2.3)) if "press_early" in mistakes else None)


def _inhale_and_press(p: Performance, notes: DoseNotes, manner: Manner, mistakes: frozenset[str]) -> None:
    rng, s = p.rng, p.subject
    duration_s = float(rng.uniform(0.75, 1.1) if "inhalation_too_short" in mistakes else rng.uniform(2.6, 4.8))
    hold_s = float(rng.uniform(1.0, 1.9) if "breath_hold_too_short" in mistakes else rng.uniform(4.2, 7.5))
    full_rad = s.travel_rad * float(rng.uniform(0.98, 1.02))
    lasts_s = float(rng.uniform(0.3, 0.6 if "multiple_presses" in mistakes else 1.6))
    coordination_s = float(rng.uniform(0.05, 0.5))
    if "inhalation_too_short" in mistakes:
        coordination_s *= 0.6
    if "press_early" in mistakes:
        coordination_s = -float(rng.uniform(0.9, 1.15))
    is_tilted = not mistakes.isdisjoint(("not_upright_at_press", "inverted_at_press"))  # at the mouth, not after it
    is_after = "press_late" in mistakes and not is_tilted and rng.random() < 0.25
    if "press_late" in mistakes and not is_after:
        duration_s = max(duration_s, 3.4)
        coordination_s = float(rng.uniform(1.3, 2.4))
    if is_after:
        duration_s = min(duration_s, 2.5)
        coordination_s = duration_s + float(rng.uniform(0.9, 1.1))

    def press() -> None:
        if "no_press" in mistakes:
            return
        if "press_incomplete" in mistakes:
            # Clearly over 15 % and 1.5 deg, clearly under 60 % and 5 deg: partial, calibrated or not.
            least, most = max(0.22 * s.travel_rad, 2.2 * _DEG), min(0.45 * s.travel_rad, 4.0 * _DEG)
            angle_rad = float(rng.uniform(least, max(least, most)))
            notes.presses.append(p.press(angle_rad, lasts_s, delay_s=coordination_s, has_end_stop=False))
            return
        notes.presses.append(p.press(full_rad, lasts_s, delay_s=coordination_s))
        if "multiple_presses" in mistakes:
            for _ in range(int(rng.integers(1, 3))):
                delay_s = notes.presses[-1].end_s - p.now_s + float(rng.uniform(0.25, 0.5))
                notes.presses.append(p.press(full_rad, float(rng.uniform(0.2, 0.4)), delay_s=delay_s))

    inhale(p, notes, duration_s, press)
    hold_breath(p, notes, manner, hold_s)


def _never_inhale(p: Performance, notes: DoseNotes, mistakes: frozenset[str]) -> None:
    """Shaken and pressed into the air in front, and never brought to the mouth."""
    rng = p.rng
    p.begin(PhaseKind.HANDLING)
    settle(p)
    p.wait(float(rng.uniform(0.8, 2.0)))
    if "no_press" not in mistakes:
        full_rad = p.subject.travel_rad * float(rng.uniform(0.98, 1.02))
        if "press_incomplete" in mistakes:
            full_rad = max(0.25 * p.subject.travel_rad, 2.2 * _DEG)
        event = p.press(full_rad, float(rng.uniform(0.3, 0.8)), has_end_stop="press_incomplete" not in mistakes)
        notes.presses.append(event)
        p.wait(event.end_s - event.start_s)
    p.wait(float(rng.uniform(1.0, 2.5)))
    p.move(0.6, {**upright(p), YAW: p.turn_of(YAW) + float(rng.normal(0.0, 0.2))})
