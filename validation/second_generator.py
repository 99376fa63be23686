"""A second, different maker of sessions, to attack the method with what the first simulator never does.

`second_session(device, mistakes, seed=..., attack=...)` answers as `inhalemon.simulate_session` does. The motion is
made by other means (`second_motion.py`); the sensors, the list of mistakes and the definitions of measures are shared.

Run as a script it prints what it can do: `python -m validation.second_generator`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from types import MappingProxyType

import numpy as np

from inhalemon.rotation import from_rotation_vector, multiply, tilt_from_upright
from inhalemon.simulate import sensors
from inhalemon.simulate.mistakes import MISTAKES, checked_mistakes, draw_mistakes
from inhalemon.simulate.sensors import Clock, Conditions
from inhalemon.simulate.steps import DoseNotes
from inhalemon.simulate.truth import Truth, dose_measures, strokes
from inhalemon.values import DeviceKind, Event, Phase, PhaseKind, Recording, SensorName
from validation.second_actor import ATTACKS, Actor
from validation.second_doses import act
from validation.second_motion import Arms, Film


def second_session(
    device: DeviceKind | str,
    mistakes: Iterable[str] = (),
    *,
    seed: int = 0,
    rate_hz: float | tuple[float, float] = 100.0,
    attack: str | None = None,
    conditions: Conditions = sensors.TYPICAL,
    n_doses: int = 1,
    session_id: str | None = None,
) -> tuple[Recording, Truth]:
    """A recording and its truth, as `inhalemon.simulate_session` gives them; the attack is drawn when not named."""
    device = DeviceKind(device)
    chosen = checked_mistakes(device, mistakes, n_doses=n_doses)
    acting, sensing = np.random.default_rng([77, seed]).spawn(2)
    drawn = str(acting.choice(ATTACKS))
    attack = drawn if attack is None else attack
    if attack not in ATTACKS:
        raise ValueError(f"attack is {attack!r}; expected one of {', '.join(ATTACKS)}")
    a = Actor(device, chosen, attack, acting)
    doses = act(a, n_doses)
    film = a.reel.film(_arms(acting), acting)
    film, phases, events = _cut(a, film, doses)

    body_hz, lever_hz = rate_hz if isinstance(rate_hz, tuple) else (rate_hz, rate_hz)
    clock = Clock(
        float(sensing.uniform(-1, 1)) * conditions.max_clock_offset_s,
        float(sensing.uniform(-1, 1)) * conditions.max_clock_drift,
    )
    duration_s = float(film.time_s[-1])
    body_rng, lever_rng = sensing.spawn(2)
    body = sensors.observe(film.body_signals, duration_s, body_hz, sensors.LSM9DS1, conditions, Clock(), body_rng)
    lever = sensors.observe(film.lever_signals, duration_s, lever_hz, sensors.MPU_9250, conditions, clock, lever_rng)
    identity = session_id or f"second-{device.value}-{attack}-{seed:05d}"
    recording = Recording(
        device=device,
        body=body.track,
        lever=lever.track,
        session_id=identity,
        sensors=MappingProxyType({SensorName.BODY: body.info, SensorName.LEVER: lever.info}),
    )
    travel_rad = a.person.travel_rad if device is DeviceKind.PMDI else a.person.cover_rad
    measures = dose_measures(device, doses[0], film, a.shakes, full_travel_rad=travel_rad, final_s=duration_s)
    if a.n_tried:
        measures["partial_press_count"] = (measures["partial_press_count"] or 0.0) + a.n_tried
    starts = [d.inhalation_start_s for d in doses if d.inhalation_start_s is not None]
    q_ref_body, angle_rad = film.attitude(body.true_s)
    q_at_lever, angle_at_lever = film.attitude(lever.true_s)
    truth = Truth(
        session_id=identity,
        device=device,
        mistakes=tuple(m for m in MISTAKES[device] if m in chosen),
        phases=_shakes_fitted(phases, film),
        events=events,
        measures=MappingProxyType(measures | {"puff_interval_s": starts[1] - starts[0] if len(starts) > 1 else None}),
        time_s=body.track.time_s,
        q_ref_body=q_ref_body,
        angle_rad=angle_rad,
        tilt_rad=tilt_from_upright(q_ref_body),
        lever_time_s=lever.track.time_s,
        q_ref_lever=multiply(q_at_lever, from_rotation_vector(angle_at_lever[:, None] * np.eye(3)[0])),
        lever_clock=clock,
        gyr_bias_body_rad_s=body.gyr_bias_rad_s,
        gyr_bias_lever_rad_s=lever.gyr_bias_rad_s,
        travel_rad=travel_rad,
    )
    return recording, truth


def _arms(rng: np.random.Generator) -> Arms:
    """Other places for the chips than the first simulator's, and larger arms: the hand turns about the wrist."""
    wrist = np.array([0.0, 0.04, -0.05])
    scatter = rng.normal(0.0, 0.006, (3, 3))
    return Arms(
        np.array([0.01, 0.0, 0.03]) + wrist + scatter[0],
        np.array([0.0, 0.02, 0.05]) + wrist + scatter[1],
        np.array([0.0, -0.025, 0.01]) + scatter[2],
    )


def _cut(a: Actor, film: Film, doses: list[DoseNotes]) -> tuple[Film, tuple[Phase, ...], tuple[Event, ...]]:
    """Cuts the recording short where the attack says so; labels and notes are counted from the cut."""
    start_s, end_s = 0.0, float(film.time_s[-1])
    if a.attack == "cut_start":  # switched on late: in the hand, just before the first step
        start_s = max(doses[0].start_s - a.draw(0.3, 1.0), 0.0)
    if a.attack == "cut_end":  # switched off as soon as the last step is done, still in the hand
        end_s = min(doses[-1].end_s + a.draw(0.1, 0.4), end_s)
    phases = tuple(
        dataclasses.replace(p, start_s=max(p.start_s, start_s) - start_s, end_s=min(p.end_s, end_s) - start_s)
        for p in a.phases
        if p.end_s > start_s and p.start_s < end_s
    )
    events = tuple(
        dataclasses.replace(e, start_s=e.start_s - start_s, peak_s=e.peak_s - start_s, end_s=e.end_s - start_s)
        for e in sorted(a.events, key=lambda e: e.start_s)
    )
    a.shakes = [(s - start_s, e - start_s) for s, e in a.shakes]
    by_time = {id(old): new for old, new in zip(sorted(a.events, key=lambda e: e.start_s), events, strict=True)}
    for notes in doses:
        notes.presses = [by_time[id(e)] for e in notes.presses]
        notes.openings = [by_time[id(e)] for e in notes.openings]
        for field in dataclasses.fields(DoseNotes):
            value = getattr(notes, field.name)
            if field.name.endswith("_s") and value is not None:
                setattr(notes, field.name, value - start_s)
    return film.cut(start_s, end_s), phases, events


def _shakes_fitted(phases: tuple[Phase, ...], film: Film) -> tuple[Phase, ...]:
    fitted = list(phases)
    for i, phase in enumerate(phases):
        found = strokes(film, phase.start_s, phase.end_s) if phase.kind is PhaseKind.SHAKE else np.empty((0, 2))
        if found.size:
            fitted[i] = dataclasses.replace(phase, start_s=float(found[0, 0]), end_s=float(found[-1, 1]))
            if i:
                fitted[i - 1] = dataclasses.replace(fitted[i - 1], end_s=fitted[i].start_s)
            if i + 1 < len(fitted):
                fitted[i + 1] = dataclasses.replace(fitted[i + 1], start_s=fitted[i].end_s)
    return tuple(fitted)


def main() -> None:
    rng = np.random.default_rng(0)
    for i, attack in enumerate(ATTACKS):
        for device in ("pmdi", "ellipta"):
            recording, truth = second_session(device, draw_mistakes(device, rng), seed=i, attack=attack)
            print(
                f"{truth.session_id:36s} {recording.body.time_s[-1]:6.1f} s  {', '.join(truth.mistakes) or 'correct'}"
            )


if __name__ == "__main__":
    main()
