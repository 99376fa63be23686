"""Attitude of one sensor's part from its rates and specific force."""

from __future__ import annotations

import functools
import logging
import math
from typing import cast

import numpy as np
from numpy.typing import NDArray

from inhalemon import _attitude_kernel as kernel
from inhalemon.settings import AttitudeSettings
from inhalemon.values import AttitudeTrack, FloatArray, ImuTrack

log = logging.getLogger(__name__)

GRAVITY_M_S2 = 9.80665
GYR_SATURATED, ACC_SATURATED = 1, 2  # the bits of a sample's flags in the kernel


def estimate_attitude(track: ImuTrack, settings: AttitudeSettings | None = None) -> AttitudeTrack:
    """The attitude at every sample, with the standard deviation of its tilt, the gyro's bias and the adaptive R."""
    settings = settings or AttitudeSettings()
    _say_once_how_it_runs()
    n = track.n_samples
    q, bias = np.empty((n, 4)), np.empty((n, 3))
    tilt_var, r = np.empty(n), np.empty(n)
    akf = causal_filter(settings)
    akf.run(
        _view(track.time_s),
        _view(track.gyr_rad_s),
        _view(track.acc_m_s2),
        sample_flags(track).data,
        _view(q),
        _view(bias),
        _view(tilt_var),
        _view(r),
    )
    sd = np.sqrt(tilt_var + (settings.sd_acc_bias_m_s2 / GRAVITY_M_S2) ** 2)
    return AttitudeTrack(track.time_s, q, sd, bias, r, r_unit="m2/s2")


def causal_filter(settings: AttitudeSettings) -> kernel.AttitudeFilter:
    """The filter with the settings' numbers in the kernel's form."""
    akf = kernel.AttitudeFilter()
    akf.gyr_q = math.radians(settings.gyr_noise_deg_sqrt_s) ** 2
    akf.rate_q = settings.gyr_scale_error**2 * settings.gyr_scale_time_s
    akf.bias_q = math.radians(settings.bias_walk_deg_s_sqrt_s) ** 2
    akf.acc_q = settings.acc_noise_m_s_sqrt_s**2
    akf.gyr_saturated_q = math.radians(settings.gyr_saturated_deg_sqrt_s) ** 2
    akf.acc_saturated_q = settings.acc_saturated_m_s_sqrt_s**2
    akf.gap_s = settings.gap_s
    akf.reset_gap_s = settings.reset_gap_s
    akf.gap_rate_var = math.radians(settings.gap_rate_deg_s) ** 2
    akf.gap_acc_var = settings.gap_acc_m_s2**2
    akf.tilt_var = math.radians(settings.sd_start_tilt_deg) ** 2
    akf.velocity_var = settings.sd_start_velocity_m_s**2
    akf.bias_var = math.radians(settings.sd_start_bias_deg_s) ** 2
    akf.r_factor = settings.r_factor_s
    akf.r_start = settings.r_start_m2_s2
    akf.r_floor = settings.r_floor_m2_s2
    akf.window_s = settings.window_s
    akf.rest_rate = math.radians(settings.rest_rate_deg_s)
    akf.rest_acc = settings.rest_acc_m_s2
    akf.rest_min_s = settings.rest_min_s
    akf.rest_bias_q = math.radians(settings.rest_bias_deg_sqrt_s) ** 2
    akf.rest_bias_gate = math.radians(settings.rest_bias_gate_deg_s) ** 2
    akf.rest_r = settings.rest_r_m_sqrt_s**2
    return akf


def sample_flags(track: ImuTrack) -> NDArray[np.uint8]:
    """Which samples are saturated, as the kernel's bits."""
    flags = np.zeros(track.n_samples, dtype=np.uint8)
    for known, values, largest, bit in (
        (track.is_gyr_saturated, track.gyr_rad_s, track.gyr_range_rad_s, GYR_SATURATED),
        (track.is_acc_saturated, track.acc_m_s2, track.acc_range_m_s2, ACC_SATURATED),
    ):
        if known is not None:
            flags[known] |= bit
        elif largest is not None:
            flags[(np.abs(values) >= 0.999 * largest).any(axis=1)] |= bit
    return flags


def _view(values: FloatArray) -> memoryview[float]:
    """The array's own memory: the compiled kernel and plain Python both index it, and Python gets plain floats."""
    return cast("memoryview[float]", values.data)


@functools.cache
def _say_once_how_it_runs() -> None:
    if str(kernel.__file__).endswith(".py"):
        log.warning("the attitude kernel is not compiled; the same algorithm runs in Python, about 200 times slower")
