"""What a chip makes of exact motion: the errors of an MPU-9250 and an LSM9DS1.

Figures are the datasheets' (InvenSense PS-MPU-9250A-01 rev. 1.1; ST LSM9DS1 DocID025715 rev. 3): typical ones where
given, and a third of the stated limit as the standard deviation otherwise. ST gives no noise density; values as of
similar chips stand in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from inhalemon.rotation import as_matrix, from_rotation_vector
from inhalemon.values import STANDARD_GRAVITY_M_S2, FloatArray, ImuTrack, SensorInfo

Signals = Callable[[FloatArray], tuple[FloatArray, FloatArray]]  # true times (n,) -> specific force, rate, (n, 3) each

_MG: Final = 1e-3 * STANDARD_GRAVITY_M_S2
_DEG: Final = np.pi / 180


@dataclass(frozen=True, slots=True)
class ChipModel:
    """One kind of chip; standard deviations are over chips unless the name says noise."""

    model: str
    acc_noise_m_s2_rthz: float
    gyr_noise_rad_s_rthz: float
    sd_acc_bias_m_s2: float
    sd_gyr_bias_rad_s: float
    sd_scale: float  # both sensors, per axis
    sd_cross_axis: float
    acc_lsb_m_s2_per_g: float  # step, per g of full scale
    gyr_lsb_rad_s_per_deg_s: float  # step, per deg/s of full scale


MPU_9250: Final = ChipModel(
    model="MPU-9250",
    acc_noise_m_s2_rthz=0.30 * _MG,
    gyr_noise_rad_s_rthz=0.01 * _DEG,
    sd_acc_bias_m_s2=60 / 3 * _MG,
    sd_gyr_bias_rad_s=5 / 3 * _DEG,
    sd_scale=0.03 / 3,
    sd_cross_axis=0.02 / 3,
    acc_lsb_m_s2_per_g=STANDARD_GRAVITY_M_S2 / 32768,
    gyr_lsb_rad_s_per_deg_s=_DEG / 32768,
)
LSM9DS1: Final = ChipModel(
    model="LSM9DS1",
    acc_noise_m_s2_rthz=0.25 * _MG,
    gyr_noise_rad_s_rthz=0.014 * _DEG,
    sd_acc_bias_m_s2=90 / 3 * _MG,
    sd_gyr_bias_rad_s=30 / 3 * _DEG,
    sd_scale=0.03 / 3,
    sd_cross_axis=0.02 / 3,
    acc_lsb_m_s2_per_g=0.732 / 16 * _MG,  # 0.732 mg a step at 16 g
    gyr_lsb_rad_s_per_deg_s=70e-3 / 2000 * _DEG,  # 70 mdeg/s a step at 2000 deg/s
)


@dataclass(frozen=True, slots=True)
class Conditions:
    """How badly the sensors are treated; all zero with one tap is a perfect sensor."""

    chip_errors: float = 1.0  # times the chip model's deviations and noise; 0 also leaves out quantisation
    sd_mount_rad: float = 1.5 * _DEG  # of the chip's axes against its part, per axis; cut at twice this
    gyr_walk_rad_s_rts: float = 0.01 * _DEG  # in-run drift of the bias, per root second
    jitter_s: float = 0.2e-3
    max_clock_offset_s: float = 0.02
    max_clock_drift: float = 60e-6
    drop_chance: float = 5e-4  # of each row
    n_gaps: int = 0
    max_gap_s: float = 0.0
    acc_range_g: float = 16.0
    gyr_range_deg_s: float = 2000.0
    n_taps: int = 2  # sub-samples that stand for the chip's low-pass


PERFECT: Final = Conditions(
    chip_errors=0.0,
    sd_mount_rad=0.0,
    gyr_walk_rad_s_rts=0.0,
    jitter_s=0.0,
    max_clock_offset_s=0.0,
    max_clock_drift=0.0,
    drop_chance=0.0,
    n_taps=1,
)
TYPICAL: Final = Conditions()
HARSH: Final = Conditions(
    chip_errors=1.5,
    sd_mount_rad=3 * _DEG,
    gyr_walk_rad_s_rts=0.03 * _DEG,
    jitter_s=0.8e-3,
    max_clock_offset_s=0.1,
    max_clock_drift=150e-6,
    drop_chance=5e-3,
    n_gaps=2,
    max_gap_s=0.15,
    acc_range_g=8.0,
    gyr_range_deg_s=1000.0,
)


@dataclass(frozen=True, slots=True)
class Clock:
    """A sensor's clock: it reads `offset_s + (1 + drift) * t` at the true time t."""

    offset_s: float = 0.0
    drift: float = 0.0

    def reading(self, true_s: FloatArray) -> FloatArray:
        return self.offset_s + (1.0 + self.drift) * true_s


@dataclass(frozen=True, slots=True)
class Observed:
    """A track, the true instants of its rows, and what was wrong with the chip."""

    track: ImuTrack
    info: SensorInfo
    true_s: FloatArray  # (n,)
    gyr_bias_rad_s: FloatArray  # (n, 3) chip frame, in-run drift included
    q_part_chip: FloatArray  # (4,) mounting error


def observe(
    signals: Signals,
    duration_s: float,
    rate_hz: float,
    chip: ChipModel,
    conditions: Conditions,
    clock: Clock,
    rng: np.random.Generator,
) -> Observed:
    """The track that a chip records of exact motion, on its own clock.

    The chip's low-pass is an average over one sample's length, centred, so it has no delay; a real filter's few
    milliseconds are taken to be part of the clock's offset.
    """
    step_s = 1.0 / rate_hz
    true_s = np.arange(0.0, duration_s, step_s) + rng.uniform(0.0, step_s)
    true_s = true_s + np.clip(rng.normal(0.0, conditions.jitter_s, true_s.size), -0.3 * step_s, 0.3 * step_s)
    true_s = true_s[(true_s < duration_s) & _kept(true_s, conditions, rng)]
    taps_s = (np.arange(conditions.n_taps) + 0.5) / conditions.n_taps - 0.5
    instants = np.sort(np.clip((true_s[:, None] + step_s * taps_s).ravel(), 0.0, duration_s))
    acc, gyr = (v.reshape(true_s.size, conditions.n_taps, 3).mean(axis=1) for v in signals(instants))

    scale = conditions.chip_errors
    mount = np.clip(rng.normal(0.0, 1.0, 3), -2.0, 2.0) * conditions.sd_mount_rad
    q_part_chip = from_rotation_vector(mount)
    to_chip = as_matrix(q_part_chip).T
    noise_scale = scale * np.sqrt(rate_hz / 2)  # white up to half the rate
    walk = rng.normal(0.0, 1.0, (true_s.size, 3)) * conditions.gyr_walk_rad_s_rts * np.sqrt(step_s)
    gyr_bias = scale * chip.sd_gyr_bias_rad_s * _cut_normal(rng) + np.cumsum(walk, axis=0)
    acc = acc @ (_gain(chip, scale, rng) @ to_chip).T + scale * chip.sd_acc_bias_m_s2 * _cut_normal(rng)
    gyr = gyr @ (_gain(chip, scale, rng) @ to_chip).T + gyr_bias
    acc = acc + rng.normal(0.0, 1.0, acc.shape) * chip.acc_noise_m_s2_rthz * noise_scale
    gyr = gyr + rng.normal(0.0, 1.0, gyr.shape) * chip.gyr_noise_rad_s_rthz * noise_scale

    acc_range = conditions.acc_range_g * STANDARD_GRAVITY_M_S2
    gyr_range = conditions.gyr_range_deg_s * _DEG
    if scale > 0:
        acc = _digitised(acc, chip.acc_lsb_m_s2_per_g * conditions.acc_range_g, acc_range)
        gyr = _digitised(gyr, chip.gyr_lsb_rad_s_per_deg_s * conditions.gyr_range_deg_s, gyr_range)
    track = ImuTrack(
        time_s=_readings(clock, true_s),
        acc_m_s2=acc,
        gyr_rad_s=gyr,
        acc_range_m_s2=acc_range,
        gyr_range_rad_s=gyr_range,
    )
    info = SensorInfo(chip.model)
    return Observed(track, info, true_s, gyr_bias, q_part_chip)


def _readings(clock: Clock, true_s: FloatArray) -> FloatArray:
    """Clock readings, rounded to a microsecond as in the file."""
    readings: FloatArray = np.round(clock.reading(true_s), 6)
    return readings


def _kept(
    true_s: FloatArray, conditions: Conditions, rng: np.random.Generator
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    kept = rng.random(true_s.size) >= conditions.drop_chance
    for _ in range(conditions.n_gaps):
        start_s = rng.uniform(0.0, true_s[-1])
        kept &= (true_s < start_s) | (true_s > start_s + rng.uniform(0.0, conditions.max_gap_s))
    return kept


def _gain(chip: ChipModel, scale: float, rng: np.random.Generator) -> FloatArray:
    """Scale and cross-axis sensitivity, a matrix near the identity."""
    cross = rng.normal(0.0, scale * chip.sd_cross_axis, (3, 3))
    np.fill_diagonal(cross, rng.normal(0.0, scale * chip.sd_scale, 3))
    gain: FloatArray = np.eye(3) + cross
    return gain


def _cut_normal(rng: np.random.Generator) -> FloatArray:
    """Three normal numbers cut at 2.5: no chip outside its datasheet's limits passes the maker's test."""
    cut: FloatArray = np.clip(rng.normal(0.0, 1.0, 3), -2.5, 2.5)
    return cut


def _digitised(values: FloatArray, step: float, limit: float) -> FloatArray:
    digits: FloatArray = np.clip(np.round(values / step) * step, -limit, limit)
    return digits
