"""The people of the simulator: no two hold, shake, tilt and press alike.

The ranges are the project's own choice (no published figures were found for most); docs/simulator.md lists them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from inhalemon.values import DeviceKind

_DEG: Final = np.pi / 180
N_SUBJECTS: Final = 40


@dataclass(frozen=True, slots=True)
class Subject:
    """One person with one inhaler of each kind."""

    number: int
    tempo: float  # 1 is usual, larger is quicker
    hand: float  # +1 right, -1 left: the side to which habits lean
    size: float  # of the reach, 1 an adult's
    tremor_hz: float
    tremor_m_s2: float  # amplitude of the acceleration
    tremor_rad: float
    sway_rad: float
    sway_m: float
    shake_hz: float
    shake_m_s2: float  # amplitude of the grip's acceleration
    shake_wrist_rad: float  # rotation that goes with it
    hold_pitch_rad: float
    hold_roll_rad: float
    tilt_back_rad: float  # head and device together, at inhalation
    tilt_back_s: float
    travel_rad: float  # of the pMDI's lever
    press_s: float
    end_stop: float  # speed at the end stop, in travel / press_s
    cover_rad: float  # the Ellipta cover's full travel
    cover_hysteresis_rad: float  # by which it springs back


def subject(number: int, device: DeviceKind) -> Subject:
    """The subject of that number, always the same; `number` counts from 0 without an end.

    Every fifth has a pathological tremor (4-6 Hz), every fourth is left-handed, every seventh is a child.
    """
    rng = np.random.default_rng([20261120, number])
    is_trembling, is_child = number % 5 == 4, number % 7 == 6
    size = rng.uniform(0.6, 0.75) if is_child else rng.uniform(0.85, 1.15)
    is_pmdi = device is DeviceKind.PMDI
    return Subject(
        number=number,
        tempo=float(rng.uniform(0.75, 1.3)),
        hand=-1.0 if number % 4 == 3 else 1.0,
        size=float(size),
        tremor_hz=float(rng.uniform(4.0, 6.0) if is_trembling else rng.uniform(8.0, 12.0)),
        tremor_m_s2=float(rng.uniform(0.25, 0.9) if is_trembling else rng.uniform(0.02, 0.12)),
        tremor_rad=float(rng.uniform(0.2, 0.6) * _DEG if is_trembling else rng.uniform(0.01, 0.05) * _DEG),
        sway_rad=float(rng.uniform(0.2, 0.8) * _DEG),
        sway_m=float(rng.uniform(0.001, 0.003)),
        shake_hz=float(rng.uniform(3.0, 5.0)),
        shake_m_s2=float(9.81 * np.exp(rng.uniform(np.log(0.95), np.log(3.2)))),
        shake_wrist_rad=float(rng.uniform(3.0, 14.0) * _DEG),
        hold_pitch_rad=float(rng.uniform(-8.0, 5.0) * _DEG),
        hold_roll_rad=float(rng.uniform(-6.0, 6.0) * _DEG),
        tilt_back_rad=float(rng.uniform(12.0, 28.0) * _DEG if is_pmdi else rng.uniform(10.0, 26.0) * _DEG),
        tilt_back_s=float(rng.uniform(0.45, 0.9)),
        travel_rad=float(rng.uniform(8.0, 20.0) * _DEG),
        press_s=float(rng.uniform(0.07, 0.22)),
        end_stop=float(rng.uniform(0.6, 1.3)),
        cover_rad=float(rng.uniform(93.0, 98.0) * _DEG),
        cover_hysteresis_rad=float(rng.uniform(1.0, 5.0) * _DEG),
    )
