"""An Ellipta session as it is acted: rest, take up, open, breathe out, to the mouth, inhale, hold, close, put down."""

from __future__ import annotations

from typing import Final

import numpy as np

from inhalemon.simulate.motion import LEVER, PITCH, ROLL
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


def act_ellipta(p: Performance, manner: Manner, mistakes: frozenset[str], n_doses: int) -> list[DoseNotes]:
    """Acts `n_doses` doses, each with the same mistakes; a cover is left open only after the last."""
    rng = p.rng
    taken_s = take_up(p, manner)
    p.begin(PhaseKind.HANDLING)
    p.fumble(float(rng.uniform(0.6, 2.0)) * manner.clumsiness, turn_rad=14 * _DEG * manner.clumsiness)
    p.move(float(rng.uniform(0.4, 0.7)), upright(p))
    doses = []
    for i in range(n_doses):
        if i:
            p.begin(PhaseKind.HANDLING)
            p.fumble(float(rng.uniform(1.5, 3.0)), reach_m=0.03, turn_rad=8 * _DEG)
            p.move(0.5, upright(p))
        notes = _dose(p, manner, mistakes)
        stays_open = "cover_not_closed" in mistakes and i == n_doses - 1
        if p.turn_of(LEVER) > 0 and not stays_open:
            _close(p)
        elif stays_open and rng.random() < 0.3:  # shut half-way only
            p.begin(PhaseKind.CLOSE)
            half_rad = p.subject.cover_rad * float(rng.uniform(0.38, 0.44))
            p.turn_cover(half_rad, float(rng.uniform(0.4, 0.8)) / p.subject.tempo, has_end_stop=False)
        notes.end_s = p.now_s
        doses.append(notes)
    p.begin(PhaseKind.HANDLING)
    p.wait(float(rng.uniform(0.2, 0.6)))
    let_go_s = put_down(p, manner)
    p.unsteady(taken_s, let_go_s, times=manner.clumsiness)
    return doses


def _dose(p: Performance, manner: Manner, mistakes: frozenset[str]) -> DoseNotes:
    rng = p.rng
    notes = DoseNotes(start_s=p.now_s)
    _open(p, notes, mistakes)
    if "opened_repeatedly" in mistakes:
        p.begin(PhaseKind.HANDLING)
        p.wait(float(rng.uniform(0.4, 1.0)))
        _close(p)
        p.begin(PhaseKind.HANDLING)
        p.wait(float(rng.uniform(0.4, 1.0)))
        _open(p, notes, mistakes)
    p.begin(PhaseKind.HANDLING)
    if "inverted_after_open" in mistakes:
        _turn_over(p)
    if "shaken_after_open" in mistakes:
        p.begin(PhaseKind.SHAKE)
        strength = max(p.subject.shake_m_s2, 1.3 * 9.81)
        p.shake(float(rng.uniform(4.6, 9.0)) / p.subject.shake_hz, acc_m_s2=strength, hz=p.subject.shake_hz)
        p.begin(PhaseKind.HANDLING)
    if "no_inhalation" in mistakes:
        settle(p)
        p.wait(float(rng.uniform(2.0, 4.0)))
        return notes
    if "order_wrong" in mistakes:  # the cover is shut again before inhaling
        p.wait(float(rng.uniform(0.3, 0.8)))
        _close(p)
        p.begin(PhaseKind.HANDLING)
        notes.n_order_violations = 1
    if "no_exhale_pause" in mistakes:
        notes.pause_start_s = p.now_s
        p.wait(float(rng.uniform(0.0, 0.15)))
        notes.pause_end_s = p.now_s
    else:
        settle(p)
        pause(p, notes, float(rng.uniform(1.7, 3.6)))
    turns = {}
    if "tilted_at_inhalation" in mistakes:
        if rng.random() < 0.5:
            turns = {ROLL: p.subject.hand * float(rng.uniform(58.0, 72.0)) * _DEG, PITCH: 0.0}
        else:
            turns = {PITCH: float(rng.uniform(60.0, 72.0)) * _DEG - p.subject.tilt_back_rad}
    bring_to_mouth(p, turns)
    inhale(p, notes, float(rng.uniform(0.75, 1.1) if "inhalation_too_short" in mistakes else rng.uniform(2.3, 4.2)))
    hold_s = float(rng.uniform(1.0, 1.9) if "breath_hold_too_short" in mistakes else rng.uniform(4.2, 7.5))
    hold_breath(p, notes, manner, hold_s)
    breathe_out(p, manner)
    return notes


def _open(p: Performance, notes: DoseNotes, mistakes: frozenset[str]) -> None:
    rng, s = p.rng, p.subject
    p.begin(PhaseKind.OPEN)
    duration_s = float(rng.uniform(0.5, 1.0)) / s.tempo
    if "cover_not_fully_open" in mistakes:
        notes.openings.append(
            p.turn_cover(s.cover_rad * float(rng.uniform(0.45, 0.72)), duration_s, has_end_stop=False)
        )
    else:
        notes.openings.append(p.turn_cover(s.cover_rad, duration_s, has_end_stop=True))


def _close(p: Performance) -> None:
    p.begin(PhaseKind.CLOSE)
    p.turn_cover(0.0, float(p.rng.uniform(0.45, 0.9)) / p.subject.tempo, has_end_stop=True)


def _turn_over(p: Performance) -> None:
    """Upside down for a while, by the wrist, and back."""
    rng = p.rng
    over = p.subject.hand * float(rng.uniform(135.0, 170.0)) * _DEG
    p.begin(PhaseKind.HANDLING)
    p.to_place(float(rng.uniform(0.7, 1.0)), HAND_M, {ROLL: over})
    p.wait(float(rng.uniform(0.8, 1.8)))
    p.to_place(float(rng.uniform(0.7, 1.0)), HAND_M, upright(p))
