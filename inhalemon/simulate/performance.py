"""A session as it is acted: a cursor in time that strings moves together and writes down what was done.

It has state because a performance has: each move starts from where the last one ended.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from inhalemon.simulate.motion import (
    LEVER,
    N_COORDINATES,
    PITCH,
    ROLL,
    YAW,
    Geometry,
    Glide,
    Motion,
    Ring,
    Wave,
    X,
    Y,
    Z,
)
from inhalemon.simulate.subjects import Subject
from inhalemon.values import Event, EventKind, FloatArray, Phase, PhaseKind

_DEG: Final = np.pi / 180
TABLE_M: Final = (0.22, 0.42, 0.78)
HAND_M: Final = (0.05, 0.33, 1.12)
MOUTH_M: Final = (0.0, 0.14, 1.45)


@dataclass(frozen=True, slots=True)
class ShakeSpan:
    """When the hand was shaken on purpose, envelope included."""

    start_s: float
    end_s: float


class Performance:
    """Builds a `Motion` move by move; times are seconds from the session's start."""

    def __init__(self, subject: Subject, rng: np.random.Generator, *, pose: Mapping[int, float]) -> None:
        self.subject = subject
        self.rng = rng
        self.now_s = 0.0
        self.phases: list[Phase] = []
        self.events: list[Event] = []
        self.shakes: list[ShakeSpan] = []
        self._start = np.zeros(N_COORDINATES)
        for coordinate, value in pose.items():
            self._start[coordinate] = value
        self._pose = self._start.copy()
        self._glides: list[Glide] = []
        self._waves: list[Wave] = []
        self._rings: list[Ring] = []
        self._kind: PhaseKind | None = None
        self._kind_start_s = 0.0

    # ------------------------------------------------------------------------------------------ the log of phases

    def begin(self, kind: PhaseKind) -> float:
        """The time at which the phase begins; the one before ends there."""
        if kind is not self._kind:
            self._end_phase()
            self._kind, self._kind_start_s = kind, self.now_s
        return self.now_s

    def _end_phase(self) -> None:
        if self._kind is not None and self.now_s > self._kind_start_s:
            self.phases.append(Phase(self._kind, self._kind_start_s, self.now_s))

    # -------------------------------------------------------------------------------------------------- the moves

    def wait(self, duration_s: float) -> None:
        self.now_s += duration_s

    def move(self, duration_s: float, targets: Mapping[int, float]) -> None:
        """Brings coordinates to their targets; they do not start and stop quite together, as a hand's do not."""
        for coordinate, target in targets.items():
            lead, trail = self.rng.uniform(0.0, 0.12, 2) * duration_s
            self.glide(coordinate, target, lead, duration_s - lead - trail)
        self.wait(duration_s)

    def glide(self, coordinate: int, target: float, delay_s: float, duration_s: float, end_speed: float = 0.0) -> None:
        """One coordinate to its target, from `delay_s` after the cursor, which stays."""
        change = target - self._pose[coordinate]
        self._glides.append(Glide(coordinate, self.now_s + delay_s, duration_s, change, end_speed))
        self._pose[coordinate] = target

    def to_place(
        self,
        duration_s: float,
        place_m: tuple[float, float, float],
        turns: Mapping[int, float],
        *,
        spread_m: float = 0.02,
    ) -> None:
        """Carries the device to a place of the room, scaled to the subject, and turns it on the way."""
        s = self.subject
        x, y, z = np.asarray(place_m) + self.rng.normal(0.0, spread_m, 3)
        self.move(duration_s, {X: s.hand * x, Y: s.size * y, Z: 0.9 + s.size * (z - 0.9), **turns})

    def turn_of(self, coordinate: int) -> float:
        """Where a coordinate is when all moves given so far have ended."""
        return float(self._pose[coordinate])

    def fumble(self, duration_s: float, *, reach_m: float = 0.05, turn_rad: float = 18 * _DEG) -> None:
        """Turns the device over in the hand: a few small moves."""
        end_s = self.now_s + duration_s
        while self.now_s < end_s - 0.25:
            step_s = min(float(self.rng.uniform(0.4, 0.9)) / self.subject.tempo, end_s - self.now_s)
            targets = {k: self._pose[k] + self.rng.normal(0.0, 0.5 * reach_m) for k in (X, Y, Z)}
            targets[PITCH] = self.subject.hold_pitch_rad + self.rng.normal(0.0, 0.6 * turn_rad)
            targets[ROLL] = self.subject.hold_roll_rad + self.rng.normal(0.0, 0.6 * turn_rad)
            targets[YAW] = self._pose[YAW] + self.rng.normal(0.0, 0.4 * turn_rad)
            self.move(step_s, targets)
        self.wait(max(end_s - self.now_s, 0.0))

    def knock(self, acc_m_s2: float, *, delay_s: float = 0.0) -> None:
        """A bump of the whole inhaler: a cap that pops, a table that is met."""
        shares = self.rng.normal(0.0, 0.6, 3) + np.array([0.0, 0.0, 0.8])
        for coordinate, share in zip((X, Y, Z), shares, strict=True):
            hz = float(self.rng.uniform(22.0, 38.0))
            amplitude = share * acc_m_s2 / (2 * np.pi * hz) ** 2
            self._rings.append(Ring(coordinate, self.now_s + delay_s, hz, 0.02, knock=amplitude))

    def shake(self, duration_s: float, *, acc_m_s2: float | None = None, hz: float | None = None) -> None:
        """Shakes up and down, an arc of the forearm with some wrist in it."""
        s, rng = self.subject, self.rng
        hz = hz or s.shake_hz * float(rng.uniform(0.94, 1.06))
        amplitude = (acc_m_s2 or s.shake_m_s2 * float(rng.uniform(0.93, 1.07))) / (2 * np.pi * hz) ** 2
        sine, cosine = np.zeros((3, N_COORDINATES)), np.zeros((3, N_COORDINATES))
        sideways, forward = rng.uniform(-0.25, 0.25), rng.uniform(-0.4, 0.4)
        sine[0, [X, Y, Z]] = amplitude * np.array([sideways, forward, 1.0])
        sine[1, Z] = amplitude * rng.uniform(-0.05, 0.05)
        # The wrist leads or lags the forearm a little.
        lag = rng.uniform(-0.6, 0.6)
        sine[0, PITCH], cosine[0, PITCH] = s.shake_wrist_rad * np.cos(lag), s.shake_wrist_rad * np.sin(lag)
        sine[0, ROLL] = s.shake_wrist_rad * rng.uniform(-0.3, 0.3)
        sine[2] = 0.1 * rng.uniform(0.0, 1.0) * sine[0]  # beats with the first: no two strokes are alike
        # The lever rattles in its play.
        sine[0, LEVER] = float(rng.uniform(0.0, 0.3)) * _DEG
        ramp_s = min(0.7 / hz, duration_s / 4)
        start_s, end_s = self.now_s, self.now_s + duration_s
        self._waves.append(
            Wave(
                start_s,
                ramp_s,
                end_s - ramp_s,
                ramp_s,
                np.array([hz, 2 * hz, hz - 0.37]),
                sine,
                cosine,
                warp_depth=float(rng.uniform(0.0, 0.08)),
                warp_hz=float(rng.uniform(0.3, 0.8)),
            )
        )
        self.shakes.append(ShakeSpan(start_s, end_s))
        self.wait(duration_s)

    def press(self, target_rad: float, hold_s: float, *, delay_s: float = 0.0, has_end_stop: bool = True) -> Event:
        """Presses the lever and lets it go again; the cursor stays. A press that ends short meets no end stop."""
        s, rng = self.subject, self.rng
        start_s = self.now_s + delay_s
        down_s = s.press_s * float(rng.uniform(0.9, 1.15))
        up_s = float(rng.uniform(0.12, 0.25))
        end_speed = s.end_stop if has_end_stop else 0.0
        self.glide(LEVER, target_rad, delay_s, down_s, end_speed)
        stop_s = start_s + down_s
        if has_end_stop:
            speed = end_speed * target_rad / down_s
            self._rings.append(
                Ring(LEVER, stop_s, float(rng.uniform(32.0, 45.0)), float(rng.uniform(0.008, 0.014)), speed=speed)
            )
            self._jolt(stop_s, float(rng.uniform(2.0, 6.0)))
        # The thumb's force turns the body a little under the lever, and lets it go with it.
        yielding = float(rng.uniform(-1.0, 1.0)) * _DEG
        self.glide(PITCH, self._pose[PITCH] + yielding, delay_s, down_s * 1.3)
        self.glide(LEVER, 0.0, delay_s + down_s + hold_s, up_s)
        self.glide(PITCH, self._pose[PITCH] - yielding, delay_s + down_s + hold_s, up_s * 1.3)
        kind = EventKind.PRESS if has_end_stop else EventKind.PARTIAL_PRESS
        return self._log(Event(kind, start_s, stop_s, stop_s + hold_s + up_s, float(np.rad2deg(target_rad))))

    def turn_cover(self, target_rad: float, duration_s: float, *, has_end_stop: bool) -> Event:
        """Opens or shuts the cover and waits for it; at the open end stop it springs back by its hysteresis."""
        s, rng = self.subject, self.rng
        start_s, before_rad = self.now_s, self.turn_of(LEVER)
        is_opening = target_rad > before_rad
        end_speed = float(rng.uniform(0.4, 0.9)) if has_end_stop else 0.0
        self.glide(LEVER, target_rad, 0.0, duration_s, end_speed)
        stop_s = end_s = start_s + duration_s
        if has_end_stop:
            speed = end_speed * (target_rad - before_rad) / duration_s
            self._rings.append(Ring(LEVER, stop_s, float(rng.uniform(25.0, 40.0)), 0.010, speed=speed))
            self._jolt(stop_s, float(rng.uniform(3.0, 9.0)))
        # The other hand pushes: the body gives way and comes back.
        for coordinate in (PITCH, ROLL):
            gives = float(rng.normal(0.0, 3.0)) * _DEG
            self.glide(coordinate, self._pose[coordinate] + gives, 0.0, 0.6 * duration_s)
            self.glide(coordinate, self._pose[coordinate] - gives, 0.6 * duration_s, 0.4 * duration_s)
        if is_opening and has_end_stop:
            back_s = float(rng.uniform(0.15, 0.3))
            self.glide(LEVER, target_rad - s.cover_hysteresis_rad, duration_s + 0.05, back_s)
            end_s = stop_s + 0.05 + back_s
        self.wait(end_s - start_s)
        kind = EventKind.OPEN if is_opening else EventKind.CLOSE
        largest_rad = max(target_rad, before_rad)
        return self._log(Event(kind, start_s, stop_s, end_s, float(np.rad2deg(largest_rad))))

    def _jolt(self, start_s: float, acc_m_s2: float) -> None:
        hz = float(self.rng.uniform(30.0, 45.0))
        self._rings.append(Ring(Z, start_s, hz, 0.015, knock=-acc_m_s2 / (2 * np.pi * hz) ** 2))
        self._rings.append(Ring(PITCH, start_s, hz, 0.012, knock=float(self.rng.uniform(0.01, 0.05)) * _DEG * acc_m_s2))

    def _log(self, event: Event) -> Event:
        self.events.append(event)
        return event

    # ------------------------------------------------------------------------------------------------ in the hand

    def unsteady(self, start_s: float, end_s: float, *, times: float = 1.0) -> None:
        """Adds what a living hand cannot help: sway, breath and tremor, from `start_s` to `end_s`."""
        s, rng = self.subject, self.rng
        ramp_s = min(0.5, (end_s - start_s) / 4)
        sway_hz = np.array([0.09, 0.17, 0.26, 0.43]) * rng.uniform(0.85, 1.15, 4)
        tremor_hz = s.tremor_hz * np.array([0.93, 1.0, 1.08])
        hz = np.concatenate([sway_hz, tremor_hz])
        amplitude = np.zeros((hz.size, N_COORDINATES))
        amplitude[:4, [X, Y, Z]] = s.sway_m
        amplitude[:4, [YAW, PITCH, ROLL]] = s.sway_rad / np.array([1.0, 1.2, 1.6, 2.4])[:, None]
        amplitude[4:, [X, Y, Z]] = s.tremor_m_s2 / (2 * np.pi * tremor_hz[:, None]) ** 2 * np.array([0.5, 0.4, 0.6])
        amplitude[4:, [YAW, PITCH, ROLL]] = s.tremor_rad * np.array([0.4, 0.7, 0.7])
        amplitude *= times * rng.uniform(0.3, 1.0, amplitude.shape) / np.sqrt(2)
        phase = rng.uniform(0.0, 2 * np.pi, amplitude.shape)
        self._waves.append(
            Wave(
                start_s,
                ramp_s,
                end_s - ramp_s,
                ramp_s,
                hz,
                amplitude * np.cos(phase),
                amplitude * np.sin(phase),
                0.15,
                0.21,
            )
        )

    def finish(self, geometry: Geometry) -> Motion:
        """The motion, when the last phase has ended; the cursor is the duration."""
        self._end_phase()
        start: FloatArray = self._start
        return Motion(start, tuple(self._glides), tuple(self._waves), tuple(self._rings), geometry)
