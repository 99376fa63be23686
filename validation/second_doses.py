"""The order of the steps in the second generator's sessions, dose by dose, with the mistakes."""

from __future__ import annotations

from typing import Final

import numpy as np

from inhalemon.rotation import from_rotation_vector, multiply
from inhalemon.simulate.steps import DoseNotes
from inhalemon.values import DeviceKind, PhaseKind
from validation.second_actor import Actor
from validation.second_motion import GRAVITY_M_S2

_DEG: Final = np.pi / 180


def _tilted(actor: Actor) -> tuple[float, float]:
    """Pitch and roll at the mouth, on top of how the inhaler is held."""
    if actor.has("not_upright_at_press") or actor.has("tilted_at_inhalation"):
        if actor.rng.random() < 0.5 or actor.person.tilt_rad > 22 * _DEG:
            return 0.0, actor.person.side * actor.draw(60.0, 68.0) * _DEG - actor.person.hold_roll_rad
        return 66 * _DEG - actor.person.hold_pitch_rad - 0.5 * actor.person.tilt_rad, 0.0
    if actor.has("inverted_at_press"):
        return 0.0, actor.person.side * actor.draw(150.0, 175.0) * _DEG - actor.person.hold_roll_rad
    return 0.0, 0.0


def _pmdi_dose(a: Actor) -> DoseNotes:
    notes = DoseNotes(start_s=a.reel.now_s)
    if a.has("order_wrong"):
        a.begin(PhaseKind.EXHALE)
        a.wait(a.draw(2.2, 3.5))
        a.to_mouth(dwell_s=a.draw(0.8, 1.6))
        a.begin(PhaseKind.HANDLING)
        a.go(a.place(0.08, 0.28, 1.05), a.held(0.0, 0.0), a.draw(0.7, 1.0))
        notes.n_order_violations = 1
    if a.has("not_shaken"):
        a.go(None, multiply(a.held(0.0, 0.0), from_rotation_vector(a.rng.normal(0.0, 12.0, 3) * _DEG)), 0.6)
        a.go(None, a.held(0.0, 0.0), 0.5)
    elif a.has("shake_too_short"):
        a.shake(a.draw(2.6, 3.4) / a.person.shake_hz, least_m_s2=1.6 * GRAVITY_M_S2)
    else:
        a.shake(a.draw(3.2, 6.5))
    if a.has("no_inhalation"):
        a.wait(a.draw(0.8, 1.8))
        if not a.has("no_press"):
            share = a.weak_share() if a.has("press_incomplete") else 1.0
            notes.presses.append(a.press(0.0, a.draw(0.3, 0.7), share))
            a.wait(notes.presses[-1].end_s - a.reel.now_s)
        a.wait(a.draw(1.0, 2.5))
        notes.end_s = a.reel.now_s
        return notes
    if a.has("shake_to_press_delay"):
        a.wait(a.draw(11.0, 14.0))
        a.regrip()
    if a.attack == "regrips":
        a.regrip()
    if a.has("no_exhale_pause"):
        notes.pause_start_s = a.reel.now_s
        a.wait(a.draw(0.0, 0.1))
        notes.pause_end_s = a.reel.now_s
    else:
        a.exhale(notes, a.draw(1.7, 2.2 if a.person.pace > 1.3 or a.has("press_late") else 3.5))
    a.to_mouth(*_tilted(a), dwell_s=a.draw(1.4, 2.2) if a.has("press_early") else None)
    is_short = a.has("inhalation_too_short")
    duration_s = a.draw(0.8, 1.1) if is_short else a.draw(2.6, 5.0)
    if a.has("press_late"):
        duration_s = max(duration_s, 3.2)
    a.inhale(notes, duration_s)
    _presses(a, notes, is_short=is_short)
    a.wait(duration_s)
    a.hold(notes, a.draw(1.1, 1.9) if a.has("breath_hold_too_short") else a.draw(4.2, 8.0))
    a.after()
    notes.end_s = a.reel.now_s
    return notes


def _presses(a: Actor, notes: DoseNotes, *, is_short: bool) -> None:
    if a.has("no_press"):
        return
    quickness = 0.6 if is_short else 1.0
    when_s = a.draw(0.02, 0.25) if is_short else a.draw(0.02, 0.5)
    if a.has("press_early"):
        when_s = -a.draw(0.95, 1.2)
    if a.has("press_late"):
        when_s = a.draw(1.3, 2.2)
    if a.has("press_incomplete"):
        for _ in range(2 if a.attack == "weak_presses" else 1):  # pressed twice, weakly
            notes.presses.append(a.press(when_s, a.draw(0.2, 0.4), a.weak_share(), quickness))
            when_s = notes.presses[-1].end_s - a.reel.now_s + a.draw(0.25, 0.5)
        return
    held_s = a.draw(0.2, 0.5) if is_short or a.has("multiple_presses") else a.draw(0.3, 1.5)
    notes.presses.append(a.press(when_s, held_s, 1.0, quickness))
    if a.has("multiple_presses"):
        delay_s = notes.presses[-1].end_s - a.reel.now_s + a.draw(0.3, 0.6)
        notes.presses.append(a.press(delay_s, a.draw(0.2, 0.4)))


def _ellipta_dose(a: Actor, *, is_last: bool) -> DoseNotes:
    notes = DoseNotes(start_s=a.reel.now_s)
    share = a.draw(0.45, 0.72) if a.has("cover_not_fully_open") else 1.0
    hesitates = a.rng.random() < 0.3
    notes.openings.append(a.cover(share * a.person.cover_rad, is_stopped=share == 1.0, hesitates=hesitates))
    if a.has("opened_repeatedly"):
        a.wait(a.draw(0.2, 1.0))
        a.cover(0.0, is_stopped=True)
        a.wait(a.draw(0.3, 1.0))
        notes.openings.append(a.cover(a.person.cover_rad, is_stopped=True))
    if not a.has("no_exhale_pause"):  # a long pause would be one
        a.pause_somewhere()
    if a.has("inverted_after_open"):
        a.go(None, a.held(0.0, a.person.side * a.draw(140.0, 170.0) * _DEG), a.draw(0.7, 1.0))
        a.wait(a.draw(0.8, 2.0))
        a.go(None, a.held(0.0, 0.0), a.draw(0.7, 1.0))
    if a.has("shaken_after_open"):
        a.shake(a.draw(4.0, 9.0) / a.person.shake_hz, least_m_s2=1.4 * GRAVITY_M_S2)
    if a.has("no_inhalation"):
        a.wait(a.draw(1.5, 4.0))
    else:
        if a.has("order_wrong"):
            a.wait(a.draw(0.2, 0.8))
            a.cover(0.0, is_stopped=True)
            notes.n_order_violations = 1
        if a.attack == "regrips":
            a.regrip()
        if a.has("no_exhale_pause"):
            notes.pause_start_s = a.reel.now_s
            a.wait(a.draw(0.0, 0.1))
            notes.pause_end_s = a.reel.now_s
        else:
            a.exhale(notes, a.draw(1.7, 3.8))
        a.to_mouth(*_tilted(a))
        duration_s = a.draw(0.8, 1.1) if a.has("inhalation_too_short") else a.draw(2.3, 4.5)
        a.inhale(notes, duration_s)
        a.wait(duration_s)
        a.hold(notes, a.draw(1.1, 1.9) if a.has("breath_hold_too_short") else a.draw(4.2, 8.0))
        a.after()
    a.begin(PhaseKind.HANDLING)
    if a.reel.angle_rad > 0 and not (a.has("cover_not_closed") and is_last):
        a.cover(0.0, is_stopped=True)
    notes.end_s = a.reel.now_s
    return notes


def act(a: Actor, n_doses: int) -> list[DoseNotes]:
    a.take()
    doses = []
    for i in range(n_doses):
        if i:
            a.begin(PhaseKind.HANDLING)
            a.wait(a.draw(1.0, 3.0))
            a.regrip()
        if a.device is DeviceKind.PMDI:
            doses.append(_pmdi_dose(a))
        else:
            doses.append(_ellipta_dose(a, is_last=i == n_doses - 1))
    a.put_down()
    a.finish()
    return doses
