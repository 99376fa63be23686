"""A whole simulated session: a subject acts, two chips watch, and the truth is kept."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from types import MappingProxyType
from typing import Final

import numpy as np

from inhalemon.exceptions import SimulationError
from inhalemon.limits import MAX_RATE_HZ, MIN_RATE_HZ
from inhalemon.rotation import from_rotation_vector, multiply, tilt_from_upright
from inhalemon.simulate import sensors
from inhalemon.simulate.ellipta import act_ellipta
from inhalemon.simulate.mistakes import MISTAKES, checked_mistakes
from inhalemon.simulate.motion import Geometry, Motion
from inhalemon.simulate.performance import Performance
from inhalemon.simulate.pmdi import act_pmdi
from inhalemon.simulate.sensors import Clock, Conditions, Observed
from inhalemon.simulate.steps import DoseNotes, draw_manner, start_pose
from inhalemon.simulate.subjects import N_SUBJECTS, Subject
from inhalemon.simulate.subjects import subject as numbered_subject
from inhalemon.simulate.truth import Truth, dose_measures, strokes
from inhalemon.values import DeviceKind, FloatArray, Phase, PhaseKind, Recording, SensorName

_CONDITIONS: Final = {"perfect": sensors.PERFECT, "typical": sensors.TYPICAL, "harsh": sensors.HARSH}


def simulate_session(
    device: DeviceKind | str,
    mistakes: Iterable[str] = (),
    *,
    seed: int = 0,
    rate_hz: float | tuple[float, float] = 100.0,
    subject: int | Subject | None = None,
    profile: str = "typical",
    conditions: Conditions | None = None,
    n_doses: int = 1,
    session_id: str | None = None,
) -> tuple[Recording, Truth]:
    """A recording as the two sensors would make it, and the truth: the same for the same arguments.

    `rate_hz` is for both sensors or for (body, lever). `subject` is a number (drawn from the seed when `None`).
    `profile` is `perfect` (exact sensors), `typical` or `harsh` (clumsy hands, worse sensors, gaps); `conditions`
    replaces the profile's sensors. Each of `n_doses` doses has the same mistakes.

    Raises `SimulationError` for a device, mistake, profile or rate that cannot be simulated.
    """
    try:
        device = DeviceKind(device)
    except ValueError:
        raise SimulationError(f"device is {device!r}; expected one of {', '.join(MISTAKES)}") from None
    chosen = checked_mistakes(device, mistakes, n_doses=n_doses)
    body_hz, lever_hz = _checked_rates(rate_hz)
    if profile not in _CONDITIONS:
        raise SimulationError(f"profile is {profile!r}; expected one of {', '.join(_CONDITIONS)}")
    # Separate streams: the same seed acts the same whatever the rate and the sensors.
    acting, sensing = np.random.default_rng(seed).spawn(2)
    number = int(acting.integers(N_SUBJECTS))
    person = (
        subject if isinstance(subject, Subject) else numbered_subject(number if subject is None else subject, device)
    )

    performance, doses, motion = _act(device, chosen, person, acting, is_harsh=profile == "harsh", n_doses=n_doses)
    conditions = conditions or _CONDITIONS[profile]
    body, lever, lever_clock = _sense(motion, performance.now_s, body_hz, lever_hz, conditions, sensing)
    identity = session_id or f"{device.value}-{seed:05d}"
    recording = Recording(
        device=device,
        body=body.track,
        lever=lever.track,
        session_id=identity,
        patient_ref=f"simulated-{person.number:02d}",
        sensors=MappingProxyType({SensorName.BODY: body.info, SensorName.LEVER: lever.info}),
    )

    q_ref_body, angle_rad = motion.attitude(body.true_s)
    travel_rad = person.travel_rad if device is DeviceKind.PMDI else person.cover_rad
    spans = [(s.start_s, s.end_s) for s in performance.shakes]
    by_dose = [
        dose_measures(device, d, motion, spans, full_travel_rad=travel_rad, final_s=performance.now_s) for d in doses
    ]
    measures = by_dose[0] | {"puff_interval_s": _puff_interval_s(doses)}
    truth = Truth(
        session_id=identity,
        device=device,
        mistakes=tuple(m for m in MISTAKES[device] if m in chosen),
        phases=_fitted_to_strokes(performance.phases, motion),
        events=tuple(sorted(performance.events, key=lambda e: e.start_s)),
        measures=MappingProxyType(measures),
        time_s=body.track.time_s,
        q_ref_body=q_ref_body,
        angle_rad=angle_rad,
        tilt_rad=tilt_from_upright(q_ref_body),
        lever_time_s=lever.track.time_s,
        q_ref_lever=_lever_attitude(motion, lever.true_s),
        lever_clock=lever_clock,
        gyr_bias_body_rad_s=body.gyr_bias_rad_s,
        gyr_bias_lever_rad_s=lever.gyr_bias_rad_s,
        travel_rad=travel_rad,
    )
    return recording, truth


def _checked_rates(rate_hz: float | tuple[float, float]) -> tuple[float, float]:
    body_hz, lever_hz = rate_hz if isinstance(rate_hz, tuple) else (rate_hz, rate_hz)
    for rate in (body_hz, lever_hz):
        if not MIN_RATE_HZ <= rate <= MAX_RATE_HZ:
            raise SimulationError(f"rate_hz is {rate}; expected {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}")
    return float(body_hz), float(lever_hz)


def _act(
    device: DeviceKind,
    mistakes: frozenset[str],
    person: Subject,
    rng: np.random.Generator,
    *,
    is_harsh: bool,
    n_doses: int,
) -> tuple[Performance, list[DoseNotes], Motion]:
    manner = draw_manner(rng, is_harsh=is_harsh)
    yaw_rad = float(rng.uniform(-np.pi, np.pi))
    pose = start_pose(person.size, person.hand, manner, person.hold_pitch_rad, person.hold_roll_rad, yaw_rad)
    performance = Performance(person, rng, pose=pose)
    act = act_pmdi if device is DeviceKind.PMDI else act_ellipta
    doses = act(performance, manner, mistakes, n_doses)
    return performance, doses, performance.finish(_geometry(device, rng))


def _geometry(device: DeviceKind, rng: np.random.Generator) -> Geometry:
    """Chips a few centimetres from the hand's centre of turning; never twice in quite the same place."""
    body_chip, hinge, lever_chip = {
        DeviceKind.PMDI: ((0.0, 0.025, -0.035), (0.0, 0.02, 0.045), (0.0, -0.03, 0.015)),
        DeviceKind.ELLIPTA: ((0.005, 0.02, -0.01), (0.0, 0.015, -0.03), (0.0, -0.03, 0.02)),
    }[device]
    near: list[FloatArray] = [np.array(v) + rng.normal(0.0, 0.004, 3) for v in (body_chip, hinge, lever_chip)]
    return Geometry(*near)


def _sense(
    motion: Motion, duration_s: float, body_hz: float, lever_hz: float, conditions: Conditions, rng: np.random.Generator
) -> tuple[Observed, Observed, Clock]:
    lever_clock = Clock(
        offset_s=float(rng.uniform(-1.0, 1.0)) * conditions.max_clock_offset_s,
        drift=float(rng.uniform(-1.0, 1.0)) * conditions.max_clock_drift,
    )
    body_rng, lever_rng = rng.spawn(2)
    body = sensors.observe(motion.body_signals, duration_s, body_hz, sensors.LSM9DS1, conditions, Clock(), body_rng)
    lever = sensors.observe(
        motion.lever_signals, duration_s, lever_hz, sensors.MPU_9250, conditions, lever_clock, lever_rng
    )
    return body, lever, lever_clock


def _lever_attitude(motion: Motion, time_s: FloatArray) -> FloatArray:
    q_ref_body, angle_rad = motion.attitude(time_s)
    about_x = angle_rad[:, None] * np.array([1.0, 0.0, 0.0])
    return multiply(q_ref_body, from_rotation_vector(about_x))


def _fitted_to_strokes(phases: list[Phase], motion: Motion) -> tuple[Phase, ...]:
    """A shake is labelled from its first stroke to its last, as it is measured; its edges go to the neighbours."""
    fitted = list(phases)
    for i, phase in enumerate(phases):
        if phase.kind is not PhaseKind.SHAKE:
            continue
        found = strokes(motion, phase.start_s, phase.end_s)
        if not len(found):
            continue
        start_s, end_s = float(found[0, 0]), float(found[-1, 1])
        fitted[i] = dataclasses.replace(phase, start_s=start_s, end_s=end_s)
        if i:
            fitted[i - 1] = dataclasses.replace(fitted[i - 1], end_s=start_s)
        if i + 1 < len(phases):
            fitted[i + 1] = dataclasses.replace(fitted[i + 1], start_s=end_s)
    return tuple(fitted)


def _puff_interval_s(doses: list[DoseNotes]) -> float | None:
    starts = [d.inhalation_start_s for d in doses if d.inhalation_start_s is not None]
    return starts[1] - starts[0] if len(starts) > 1 else None
