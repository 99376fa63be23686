"""The steps that both inhalers share, and what is noted of each dose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from inhalemon.simulate.motion import PITCH, ROLL, YAW, X, Y, Z
from inhalemon.simulate.performance import HAND_M, MOUTH_M, TABLE_M, Performance
from inhalemon.values import Event, PhaseKind

_DEG: Final = np.pi / 180


@dataclass(slots=True)
class DoseNotes:
    """What happened in one dose, as it was acted; `None` is what did not happen."""

    start_s: float
    end_s: float = 0.0
    pause_start_s: float | None = None
    pause_end_s: float | None = None
    inhalation_start_s: float | None = None
    tilted_s: float | None = None  # the end of the tilt-back
    inhalation_end_s: float | None = None
    hold_end_s: float | None = None
    presses: list[Event] = field(default_factory=list)
    openings: list[Event] = field(default_factory=list)
    n_order_violations: int = 0


@dataclass(frozen=True, slots=True)
class Manner:
    """How one session is acted beside its mistakes; drawn once a session."""

    starts_in_hand: bool
    table_pitch_rad: float
    table_roll_rad: float
    leaves_at_once: bool  # inhalation ends with the device leaving the mouth, not with the tilt's release
    holds_in_mouth: bool
    slumps: bool  # a visible movement when the breath is let out
    clumsiness: float  # 1 is usual


def draw_manner(rng: np.random.Generator, *, is_harsh: bool) -> Manner:
    lies = rng.random() < 0.4
    on_side = rng.random() < 0.6
    sign = float(rng.choice([-1.0, 1.0]))
    return Manner(
        starts_in_hand=bool(rng.random() < (0.35 if is_harsh else 0.2)),
        table_pitch_rad=sign * 90 * _DEG if lies and not on_side else 0.0,
        table_roll_rad=sign * 90 * _DEG if lies and on_side else 0.0,
        leaves_at_once=bool(rng.random() < 0.5),
        holds_in_mouth=bool(rng.random() < 0.2),
        slumps=bool(rng.random() < 0.7),
        clumsiness=float(rng.uniform(1.2, 2.0) if is_harsh else rng.uniform(0.7, 1.2)),
    )


def start_pose(
    p_size: float, hand: float, manner: Manner, pitch_rad: float, roll_rad: float, yaw_rad: float
) -> dict[int, float]:
    x, y, z = HAND_M if manner.starts_in_hand else TABLE_M
    pitch = pitch_rad if manner.starts_in_hand else manner.table_pitch_rad
    roll = roll_rad if manner.starts_in_hand else manner.table_roll_rad
    return {X: hand * x, Y: p_size * y, Z: 0.9 + p_size * (z - 0.9), YAW: yaw_rad, PITCH: pitch, ROLL: roll}


def upright(p: Performance) -> dict[int, float]:
    """The subject's way of holding the inhaler upright, a little different each time."""
    s, rng = p.subject, p.rng
    return {
        PITCH: s.hold_pitch_rad + rng.normal(0.0, 1.5) * _DEG,
        ROLL: s.hold_roll_rad + rng.normal(0.0, 1.5) * _DEG,
    }


def settle(p: Performance) -> None:
    """The hand comes down to where the breath is let out: far enough to be seen, so that stillness begins after it."""
    rng, s = p.rng, p.subject
    away = rng.normal(0.0, 1.0, 3)
    away *= float(rng.uniform(0.06, 0.10)) / np.linalg.norm(away)
    turn = float(rng.choice([-1.0, 1.0]) * rng.uniform(12.0, 20.0)) * _DEG
    targets = {k: p.turn_of(k) + shift for k, shift in zip((X, Y, Z), away, strict=True)}
    p.move(float(rng.uniform(0.4, 0.6)) / max(s.tempo, 0.9), {**targets, **upright(p), YAW: p.turn_of(YAW) + turn})


def take_up(p: Performance, manner: Manner) -> float:
    """From the table into the hand, or awake in the hand; returns when the hand begins to move it."""
    rng = p.rng
    p.begin(PhaseKind.REST if not manner.starts_in_hand else PhaseKind.HANDLING)
    if manner.starts_in_hand:
        p.wait(float(rng.uniform(0.3, 0.8)))
        return 0.0
    p.wait(float(rng.uniform(1.0, 2.5)))
    lifted_s = p.begin(PhaseKind.HANDLING)
    p.to_place(
        float(rng.uniform(0.8, 1.3)) / p.subject.tempo,
        HAND_M,
        {**upright(p), YAW: p.turn_of(YAW) + rng.normal(0.0, 0.4)},
    )
    return lifted_s


def pause(p: Performance, notes: DoseNotes, duration_s: float) -> None:
    """Breathes out, the device still in the hand."""
    notes.pause_start_s = p.begin(PhaseKind.EXHALE)
    p.wait(duration_s)
    notes.pause_end_s = p.now_s


def bring_to_mouth(p: Performance, turns: dict[int, float] | None = None, *, dwell_s: float | None = None) -> None:
    rng = p.rng
    p.begin(PhaseKind.TO_MOUTH)
    pose = {**upright(p), YAW: p.turn_of(YAW) + rng.normal(0.0, 0.15), **(turns or {})}
    p.to_place(float(rng.uniform(0.8, 1.3)) / p.subject.tempo, MOUTH_M, pose, spread_m=0.01)
    p.wait(float(rng.uniform(0.25, 0.7)) if dwell_s is None else dwell_s)


def inhale(p: Performance, notes: DoseNotes, duration_s: float, meanwhile: Callable[[], None] | None = None) -> None:
    """Tilts back at the mouth and stays so; the cursor is at the inhalation's end. `meanwhile` adds a press."""
    s, rng = p.subject, p.rng
    notes.inhalation_start_s = p.begin(PhaseKind.INHALE)
    tilt_s = min(s.tilt_back_s * float(rng.uniform(0.9, 1.1)), 0.45 * duration_s)
    notes.tilted_s = p.now_s + tilt_s
    p.glide(PITCH, p.turn_of(PITCH) + s.tilt_back_rad * float(rng.uniform(0.92, 1.08)), 0.0, tilt_s)
    # The head turns about the neck: the mouth goes back and up a little.
    p.glide(Y, p.turn_of(Y) - 0.10 * np.sin(s.tilt_back_rad), 0.0, tilt_s)
    p.glide(Z, p.turn_of(Z) + 0.05 * np.sin(s.tilt_back_rad), 0.0, tilt_s)
    if meanwhile is not None:
        meanwhile()
    p.wait(duration_s)
    notes.inhalation_end_s = p.now_s


def hold_breath(p: Performance, notes: DoseNotes, manner: Manner, duration_s: float) -> None:
    """Takes the device out (or keeps it in for a while), then holds still until the breath is let out."""
    s, rng = p.subject, p.rng
    start_s = p.begin(PhaseKind.BREATH_HOLD)
    removal_s = float(rng.uniform(0.55, 0.9)) / max(s.tempo, 0.9)
    removal_s = min(removal_s, 0.6 * duration_s)
    tilt = {PITCH: s.hold_pitch_rad + float(rng.normal(0.0, 3.0)) * _DEG}
    if not manner.leaves_at_once or manner.holds_in_mouth:
        release_s = min(float(rng.uniform(0.4, 0.7)), 0.35 * duration_s)
        p.move(release_s, {PITCH: tilt[PITCH], Y: p.turn_of(Y) + 0.03})
        p.wait((0.5 if manner.holds_in_mouth else 0.05) * max(duration_s - release_s - removal_s, 0.0))
    p.to_place(removal_s, HAND_M, {**upright(p), **tilt})
    p.wait(max(start_s + duration_s - p.now_s, 0.0))
    notes.hold_end_s = p.now_s


def breathe_out(p: Performance, manner: Manner) -> None:
    """The breath is let out: the shoulders fall, and the hand with them. Some go straight on to the next motion."""
    if not manner.slumps:
        return
    rng = p.rng
    p.begin(PhaseKind.EXHALE_AFTER)
    fall_s = float(rng.uniform(0.5, 0.8))
    p.move(
        fall_s,
        {
            Z: p.turn_of(Z) - float(rng.uniform(0.05, 0.09)),
            Y: p.turn_of(Y) + float(rng.uniform(0.01, 0.04)),
            PITCH: p.turn_of(PITCH) - float(rng.uniform(9.0, 16.0)) * _DEG,
        },
    )
    p.wait(float(rng.uniform(0.6, 1.4)))


def put_down(p: Performance, manner: Manner) -> float:
    """Back on the table; returns when the hand lets go."""
    rng = p.rng
    p.begin(PhaseKind.PUT_DOWN)
    pose = {PITCH: manner.table_pitch_rad, ROLL: manner.table_roll_rad, YAW: p.turn_of(YAW) + rng.normal(0.0, 0.3)}
    p.to_place(float(rng.uniform(0.9, 1.4)) / p.subject.tempo, TABLE_M, pose)
    p.knock(float(rng.uniform(3.0, 8.0)))
    let_go_s = p.now_s
    p.wait(0.15)
    p.begin(PhaseKind.REST)
    p.wait(float(rng.uniform(1.0, 2.2)))
    return let_go_s
