"""Who acts in the second generator's sessions, and how each step is acted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from inhalemon.rotation import from_rotation_vector, multiply
from inhalemon.simulate.steps import DoseNotes
from inhalemon.values import DeviceKind, Event, EventKind, FloatArray, Phase, PhaseKind
from validation.second_motion import GRAVITY_M_S2, Reel

_DEG: Final = np.pi / 180

ATTACKS: Final = (
    "plain",
    "slow",
    "left_hand",
    "child",
    "walking",
    "car",
    "long_pauses",
    "regrips",
    "knocks",
    "weak_presses",
    "rattling_cap",
    "cut_start",
    "cut_end",
)


@dataclass(frozen=True)
class Person:
    """Who acts, drawn anew for every session."""

    pace: float  # of durations: 1 is usual, larger is slower
    side: float  # +1 right hand, -1 left
    reach: float
    hold_pitch_rad: float
    hold_roll_rad: float
    tilt_rad: float
    tilt_s: float
    shake_hz: float
    shake_m_s2: float
    travel_rad: float
    press_s: float
    cover_rad: float
    cover_back_rad: float
    fidget: float


def _person(attack: str, rng: np.random.Generator) -> Person:
    is_child, is_slow = attack == "child", attack == "slow"
    return Person(
        pace=float(rng.uniform(1.4, 1.9) if is_slow else rng.uniform(0.6, 0.8) if is_child else rng.uniform(0.8, 1.3)),
        side=-1.0 if attack == "left_hand" or rng.random() < 0.15 else 1.0,
        reach=float(rng.uniform(0.5, 0.65) if is_child else rng.uniform(0.85, 1.2)),
        hold_pitch_rad=float(rng.uniform(-10.0, 8.0)) * _DEG,
        hold_roll_rad=float(rng.uniform(-9.0, 9.0)) * _DEG,
        tilt_rad=float(rng.uniform(11.0, 27.0)) * _DEG,
        tilt_s=float(rng.uniform(0.9, 1.4) if is_slow else rng.uniform(0.5, 1.1)),
        shake_hz=float(rng.uniform(2.2, 3.2) if is_slow else rng.uniform(2.6, 5.2)),
        shake_m_s2=float(rng.uniform(1.2, 1.7) if is_slow or is_child else rng.uniform(1.2, 3.2)) * GRAVITY_M_S2,
        travel_rad=float(rng.uniform(8.0, 20.0)) * _DEG,
        press_s=float(rng.uniform(0.4, 0.7) if is_slow else rng.uniform(0.12, 0.35)),
        cover_rad=float(rng.uniform(92.5, 98.0)) * _DEG,
        cover_back_rad=float(rng.uniform(0.0, 7.0)) * _DEG,
        fidget=float(rng.uniform(1.5, 2.5) if is_child else rng.uniform(0.4, 1.2)),
    )


def _pose(pitch_rad: float, roll_rad: float, yaw_rad: float) -> FloatArray:
    yaw, roll, pitch = np.eye(3)[2] * yaw_rad, np.eye(3)[1] * roll_rad, np.eye(3)[0] * pitch_rad
    return multiply(multiply(from_rotation_vector(yaw), from_rotation_vector(roll)), from_rotation_vector(pitch))


class Actor:
    """Plays the steps on a `Reel` and writes down what was done."""

    def __init__(self, device: DeviceKind, mistakes: frozenset[str], attack: str, rng: np.random.Generator) -> None:
        self.device, self.mistakes, self.attack, self.rng = device, mistakes, attack, rng
        self.person = _person(attack, rng)
        self.facing_rad = float(rng.uniform(-np.pi, np.pi))
        lies = rng.choice(["upright", "side", "back", "face"])
        self.rest_q = {
            "upright": _pose(0.0, 0.0, self.facing_rad + 0.7),
            "side": _pose(0.0, float(rng.choice([-1, 1])) * 90 * _DEG, self.facing_rad),
            "back": _pose(90 * _DEG, 0.0, self.facing_rad - 0.5),
            "face": _pose(-90 * _DEG, 0.0, self.facing_rad + 1.2),
        }[str(lies)]
        self.rest_m = self.place(0.35, 0.38, 0.72)
        self.starts_in_hand = bool(rng.random() < 0.25)
        start_q = self.held(0.0, 0.0) if self.starts_in_hand else self.rest_q
        self.reel = Reel(self.place(0.08, 0.28, 1.05) if self.starts_in_hand else self.rest_m, start_q)
        self.phases: list[Phase] = []
        self.events: list[Event] = []
        self.shakes: list[tuple[float, float]] = []
        self._kind, self._kind_start_s = PhaseKind.REST, 0.0
        self.in_hand_from_s = 0.0
        self.n_tried = 0

    # ------------------------------------------------------------------------------------------------ small parts

    def has(self, mistake: str) -> bool:
        return mistake in self.mistakes

    def draw(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def begin(self, kind: PhaseKind) -> None:
        if kind is self._kind:
            return
        if self.reel.now_s > self._kind_start_s:
            self.phases.append(Phase(self._kind, self._kind_start_s, self.reel.now_s))
        self._kind, self._kind_start_s = kind, self.reel.now_s

    def wait(self, duration_s: float) -> None:
        self.reel.now_s += duration_s

    def place(self, x: float, y: float, z: float) -> FloatArray:
        at = np.array([self.person.side * x, y * self.person.reach, 0.8 + self.person.reach * (z - 0.8)])
        at = at + self.rng.normal(0.0, 0.015, 3)
        c, s = np.cos(self.facing_rad), np.sin(self.facing_rad)
        return np.array([c * at[0] - s * at[1], s * at[0] + c * at[1], at[2]])

    def held(self, pitch_rad: float, roll_rad: float) -> FloatArray:
        p, rng = self.person, self.rng
        return _pose(
            p.hold_pitch_rad + pitch_rad + rng.normal(0.0, 2.0) * _DEG,
            p.hold_roll_rad + roll_rad + rng.normal(0.0, 2.0) * _DEG,
            self.facing_rad + rng.normal(0.0, 5.0) * _DEG,
        )

    def go(self, to_m: FloatArray | None, to_q: FloatArray | None, duration_s: float) -> None:
        """A move of place and attitude together, not quite at once; the cursor is where it has settled."""
        if to_m is not None:
            self.reel.carry(to_m, duration_s * self.draw(0.85, 1.0))
        if to_q is not None:
            self.reel.turn(to_q, duration_s * self.draw(0.8, 1.0), delay_s=duration_s * self.draw(0.0, 0.1))
        self.wait(duration_s * 1.1)

    def weak_share(self) -> float:
        """How far a press goes that is clearly none, and clearly more than play."""
        travel_rad = self.person.travel_rad
        least, most = max(0.22, 2.3 * _DEG / travel_rad), min(0.45, 4.0 * _DEG / travel_rad)
        return self.draw(least, max(least, most))

    def regrip(self) -> None:
        """Shifts the fingers: a quick turn, a small bump."""
        self.reel.bump(self.rng.normal(0.0, 1.5, 3))
        self.go(
            self.reel.position_m + self.rng.normal(0.0, 0.015, 3),
            multiply(self.reel.q, from_rotation_vector(self.rng.normal(0.0, 9.0, 3) * _DEG)),
            0.3,
        )
        self.go(None, self.held(0.0, 0.0), 0.4)

    def pause_somewhere(self) -> None:
        if self.attack == "long_pauses":
            self.wait(self.draw(3.0, 9.0))

    # ------------------------------------------------------------------------------------------------- the lever

    def press(self, delay_s: float, hold_s: float, share: float = 1.0, quickness: float = 1.0) -> Event:
        """A press to the end stop (`share` 1) or a weak one; the cursor stays."""
        p, reel = self.person, self.reel
        is_full = share >= 0.9
        start_s = reel.now_s + delay_s
        angle_rad = share * p.travel_rad
        down_s = p.press_s * quickness * self.draw(0.9, 1.1)
        stop_s = reel.swing(angle_rad, down_s, delay_s=delay_s, overdrive=self.draw(1.15, 1.5) if is_full else 1.0)
        if is_full:
            reel.bump(self.rng.normal([0.0, 0.0, -2.0], 1.0), delay_s=stop_s - reel.now_s - 0.012)
        give = from_rotation_vector(np.array([self.draw(-1.2, 1.2) * _DEG, 0.0, 0.0]))
        before = reel.q
        reel.turn(multiply(reel.q, give), down_s * 1.3, delay_s=delay_s)
        up_s = self.draw(0.2, 0.4)
        let_go_s = stop_s - reel.now_s + hold_s
        reel.swing(0.0, up_s, delay_s=let_go_s)
        reel.turn(before, up_s * 1.2, delay_s=let_go_s)
        kind = EventKind.PRESS if is_full else EventKind.PARTIAL_PRESS
        event = Event(kind, start_s, stop_s, stop_s + hold_s + up_s, float(np.rad2deg(angle_rad)))
        self.events.append(event)
        return event

    def cover(self, to_rad: float, *, is_stopped: bool, hesitates: bool = False) -> Event:
        p, reel = self.person, self.reel
        start_s, before = reel.now_s, reel.angle_rad
        kind = EventKind.OPEN if to_rad > before else EventKind.CLOSE
        self.begin(PhaseKind.OPEN if kind is EventKind.OPEN else PhaseKind.CLOSE)
        sway = from_rotation_vector(self.rng.normal(0.0, 4.0, 3) * _DEG)
        steady = reel.q
        duration_s = self.draw(0.5, 1.1) * p.pace
        reel.turn(multiply(reel.q, sway), duration_s)
        if hesitates:  # half the way, a moment, and on
            reel.swing(before + 0.55 * (to_rad - before), duration_s * 0.7)
            self.wait(duration_s * 0.7 + 0.25)
        stop_s = reel.swing(to_rad, duration_s, overdrive=self.draw(1.1, 1.3) if is_stopped else 1.0)
        if is_stopped:
            reel.bump(self.rng.normal(0.0, 3.0, 3), delay_s=stop_s - reel.now_s - 0.012)
        reel.turn(steady, 0.5, delay_s=stop_s - reel.now_s)
        end_s = stop_s
        if is_stopped and kind is EventKind.OPEN and p.cover_back_rad > 0:
            reel.swing(to_rad - p.cover_back_rad, 0.3, delay_s=stop_s - reel.now_s + 0.06)
            end_s += 0.36
        self.wait(end_s - reel.now_s)
        event = Event(kind, start_s, stop_s, end_s, float(np.rad2deg(max(to_rad, before))))
        self.events.append(event)
        self.begin(PhaseKind.HANDLING)
        return event

    # --------------------------------------------------------------------------------------------------- the steps

    def take(self) -> None:
        if self.starts_in_hand:
            self.begin(PhaseKind.HANDLING)
            self.wait(self.draw(0.2, 0.6))
        else:
            self.wait(self.draw(0.8, 2.0))
            if self.attack == "knocks" and self.rng.random() < 0.5:  # pushed about on the table first
                self.reel.bump(self.rng.normal(0.0, 6.0, 3))
                self.wait(0.6)
            self.in_hand_from_s = self.reel.now_s
            self.begin(PhaseKind.HANDLING)
            self.go(self.place(0.08, 0.28, 1.05), self.held(0.0, 0.0), self.draw(0.7, 1.1) * self.person.pace)
        for _ in range(int(self.rng.integers(1, 4))):  # looks at it
            turn = from_rotation_vector(self.rng.normal(0.0, 11.0, 3) * _DEG)
            shift = self.rng.normal(0.0, 0.02, 3)
            self.go(self.reel.position_m + shift, multiply(self.held(0.0, 0.0), turn), self.draw(0.4, 0.8))
        if self.attack == "knocks":  # tapped on the table's edge: a bump or two is no shake
            for _ in range(int(self.rng.integers(1, 3))):
                self.reel.bump(np.array([0.0, 0.0, self.draw(8.0, 25.0)]))
                self.wait(self.draw(0.6, 0.9))
        if self.device is DeviceKind.PMDI:
            self.reel.bump(self.rng.normal(0.0, 4.0, 3))  # cap off
        self.go(None, self.held(0.0, 0.0), 0.5)
        if self.attack == "weak_presses" and self.device is DeviceKind.PMDI and not self.has("no_press"):
            for _ in range(2):  # tries the lever, twice and weakly, before it begins
                self.n_tried += 1
                self.wait(self.press(0.0, self.draw(0.1, 0.3), self.weak_share()).end_s - self.reel.now_s + 0.3)
        self.pause_somewhere()

    def shake(self, duration_s: float, *, least_m_s2: float = 0.0) -> None:
        """Stroke by stroke, none like the other; now and then in two goes, now and then from the wrist."""
        p, rng, reel = self.person, self.rng, self.reel
        self.begin(PhaseKind.SHAKE)
        strength = max(p.shake_m_s2, least_m_s2)
        start_s = reel.now_s
        times, heights, up = [start_s], [0.0], 1.0
        t = start_s
        break_s = start_s + duration_s / 2 if duration_s > 2.5 and rng.random() < 0.25 else np.inf
        while t < start_s + duration_s:
            length_s = 0.5 / p.shake_hz * self.draw(0.9, 1.1)
            # Half cosines of length T between +-h: the largest acceleration is h (pi / T)^2.
            t += length_s
            times.append(t)
            heights.append(up * strength * self.draw(0.9, 1.15) * (length_s / np.pi) ** 2)
            up = -up
            if t > break_s:
                times.extend([t + 0.12, t + 0.35])
                heights.extend([0.0, 0.0])
                t, break_s = t + 0.35, np.inf
        times.append(t + 0.5 / p.shake_hz)
        heights.append(0.0)
        tilt = rng.normal(0.0, 0.25, 3)
        along = np.array([0.0, 0.0, 1.0]) + tilt if rng.random() < 0.7 else np.array([0.8, 0.5, 0.35]) + tilt
        largest = max(np.abs(heights))
        twist = np.clip(rng.normal(0.0, 1.0, 3), -1.2, 1.2) * self.draw(2.0, 8.0) * _DEG / largest
        reel.stroke(np.array(times), np.array(heights), along / np.linalg.norm(along), twist)
        if self.attack == "rattling_cap":
            for stroke_s in times[1:-1]:
                reel.bump(rng.normal(0.0, 3.0, 3), delay_s=stroke_s - reel.now_s)
        reel.now_s = times[-1]
        self.shakes.append((start_s, reel.now_s))
        self.begin(PhaseKind.HANDLING)

    def exhale(self, notes: DoseNotes, duration_s: float) -> None:
        """Lowers the hand a little, so that the stillness after it has a beginning, and is still."""
        away = self.rng.normal(0.0, 1.0, 3)
        away *= self.draw(0.06, 0.1) / np.linalg.norm(away)
        twist = np.array([0.0, 0.0, float(self.rng.choice([-1, 1])) * self.draw(12.0, 20.0) * _DEG])
        to_q = multiply(self.held(0.0, 0.0), from_rotation_vector(twist))
        self.go(self.reel.position_m + away, to_q, self.draw(0.4, 0.6))
        self.begin(PhaseKind.EXHALE)
        notes.pause_start_s = self.reel.now_s
        self.wait(duration_s)
        notes.pause_end_s = self.reel.now_s

    def to_mouth(self, pitch_rad: float = 0.0, roll_rad: float = 0.0, *, dwell_s: float | None = None) -> None:
        self.begin(PhaseKind.TO_MOUTH)
        duration_s = min(self.draw(0.75, 1.2) * self.person.pace, 1.7)
        self.go(self.place(0.0, 0.12, 1.42), self.held(pitch_rad, roll_rad), duration_s)
        self.wait(self.draw(0.2, 0.8) if dwell_s is None else dwell_s)

    def inhale(self, notes: DoseNotes, duration_s: float) -> None:
        """Tilts back at the mouth; the cursor stays at the onset, so that a press can be laid over it."""
        self.begin(PhaseKind.INHALE)
        p, reel = self.person, self.reel
        notes.inhalation_start_s = reel.now_s
        tilt_s = min(p.tilt_s, 0.5 * duration_s)
        notes.tilted_s = reel.now_s + tilt_s
        notes.inhalation_end_s = reel.now_s + duration_s
        # About the user's left-right axis, which is the room's: in front of the attitude, not behind it.
        across = np.array([np.cos(self.facing_rad), np.sin(self.facing_rad), 0.0])
        reel.turn(multiply(from_rotation_vector(across * p.tilt_rad), reel.q), tilt_s)
        reel.carry(reel.position_m + np.array([0.0, 0.0, 0.02]), tilt_s)

    def hold(self, notes: DoseNotes, duration_s: float) -> None:
        self.begin(PhaseKind.BREATH_HOLD)
        start_s = self.reel.now_s
        away_s = min(self.draw(0.5, 0.9) * self.person.pace, 0.55 * duration_s)
        if self.rng.random() < 0.35 and duration_s > 3:  # the head comes back first, the device a moment later
            self.go(None, self.held(0.0, 0.0), 0.5)
            self.wait(self.draw(0.1, 0.8))
        place = self.place(0.1, 0.3, self.draw(1.0, 1.25))
        self.go(place, self.held(self.draw(-6.0, 4.0) * _DEG, 0.0), away_s)
        self.wait(max(start_s + duration_s - self.reel.now_s, 0.0))
        notes.hold_end_s = self.reel.now_s

    def after(self) -> None:
        if self.rng.random() < 0.6:
            self.begin(PhaseKind.EXHALE_AFTER)
            down = self.reel.position_m - np.array([0.0, 0.0, self.draw(0.07, 0.14)])
            self.go(down, self.held(-self.draw(12.0, 22.0) * _DEG, 0.0), self.draw(0.5, 0.8))
            self.wait(self.draw(0.5, 1.5))
        self.begin(PhaseKind.HANDLING)

    def put_down(self) -> None:
        self.begin(PhaseKind.HANDLING)
        self.pause_somewhere()
        self.begin(PhaseKind.PUT_DOWN)
        self.go(self.rest_m, self.rest_q, self.draw(0.8, 1.2) * self.person.pace)
        self.reel.bump(np.array([0.0, 0.0, self.draw(2.0, 9.0)]))
        self.out_of_hand_s = self.reel.now_s
        self.wait(0.4)
        self.begin(PhaseKind.REST)
        self.wait(self.draw(0.8, 2.0))

    def finish(self) -> None:
        self.phases.append(Phase(self._kind, self._kind_start_s, self.reel.now_s))
        self._unsteady()

    def _unsteady(self) -> None:
        """What goes on all the while: a living hand, a walk, a road."""
        rng, reel = self.rng, self.reel
        start_s, end_s = self.in_hand_from_s, self.out_of_hand_s
        hz = np.concatenate([rng.uniform(0.08, 0.5, 5), rng.uniform(0.5, 1.5, 4), rng.uniform(6.0, 11.0, 3)])
        shift = rng.normal(0.0, 1.0, (hz.size, 3)) * (self.person.fidget * 0.004 / (1 + (hz / 0.25) ** 2))[:, None]
        turn = rng.normal(0.0, 1.0, (hz.size, 3)) * (self.person.fidget * 0.9 * _DEG / (1 + (hz / 0.3) ** 2))[:, None]
        reel.tremble(start_s, end_s, hz, shift, turn)
        if self.attack == "walking":
            step_hz = self.draw(1.6, 2.0)
            hz = step_hz * np.array([0.5, 1.0, 2.0, 3.0])
            acc = np.array([[0.3, 0.2, 0.1], [0.2, 0.5, 1.6], [0.2, 0.3, 0.7], [0.1, 0.1, 0.4]]) * self.draw(0.7, 1.2)
            turn = np.array([[0.2, 1.0, 0.8], [0.9, 0.3, 0.2], [0.3, 0.1, 0.1], [0.1, 0.1, 0.0]]) * self.draw(0.6, 1.2)
            reel.tremble(start_s, end_s, hz, acc / (2 * np.pi * hz[:, None]) ** 2, turn * _DEG)
        if self.attack == "car":
            hz = np.concatenate([rng.uniform(0.1, 0.25, 2), rng.uniform(1.0, 2.0, 3), rng.uniform(8.0, 22.0, 8)])
            acc = np.concatenate([np.full(2, 0.8), np.full(3, 0.35), np.full(8, 0.2)])[:, None] * [1.0, 1.0, 0.8]
            turn = np.concatenate([np.full(2, 0.5), np.full(3, 0.3), np.full(8, 0.01)])[:, None] * [0.6, 0.6, 3.0]
            reel.tremble(-1.0, reel.now_s + 1.0, hz, acc / (2 * np.pi * hz[:, None]) ** 2, turn * _DEG)
