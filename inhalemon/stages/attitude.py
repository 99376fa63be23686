"""Attitude of one sensor's part from its rates and specific force.

`akf`, the default, is an adaptive Kalman filter of the error of attitude. Its innovation is the horizontal specific
force gathered into velocity: a hand goes nowhere in the long run, so the velocity is zero, give or take R, and R is
taken from the innovations of the last seconds, as the source takes its own. docs/method.md has the equations, and what
each departs from. The arithmetic is in `_attitude_kernel.py` and what
it uses; the source's own filter is in `_source_kernel.py`.
"""

from __future__ import annotations

import functools
import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inhalemon import _attitude_kernel as kernel
from inhalemon import _smoother_kernel as smoothing
from inhalemon import _source_kernel as source_kernel
from inhalemon.exceptions import RecordingError, SettingsError
from inhalemon.rotation import from_source, from_two_vectors, to_source
from inhalemon.settings import AttitudeMethod, AttitudeSettings
from inhalemon.signals import memory
from inhalemon.values import STANDARD_GRAVITY_M_S2, AttitudeTrack, FloatArray, ImuTrack

log = logging.getLogger(__name__)

GYR_SATURATED, ACC_SATURATED = 1, 2  # the bits of a sample's flags in the kernel
BLOCK = 8192  # samples between the states that the smoother keeps: most sessions are one block, gone through once


def estimate_attitude(track: ImuTrack, settings: AttitudeSettings | None = None) -> AttitudeTrack:
    """The attitude at every sample, with the standard deviation of its tilt, the gyro's bias and the adaptive R.

    With `settings.smooth` the whole recording is used for every sample, otherwise only what came before it, as
    `AttitudeStream` does. The source's methods and `gyro` know no smoothing; for them `smooth` changes nothing.

    Raises `RecordingError` for an empty track.
    """
    settings = settings or AttitudeSettings()
    if track.n_samples == 0:
        raise RecordingError("too_short", found="no sample", wanted="one sample or more")
    _say_once_how_it_runs()
    if settings.method is AttitudeMethod.AKF:
        return _akf(track, settings)
    if settings.method is AttitudeMethod.GYRO:
        return _gyro(track, settings)
    return _source(track, settings)


class AttitudeStream:
    """The causal `akf`, sample by sample, for use while recording: the same numbers as `estimate_attitude` gives.

    Raises `SettingsError` for another method.
    """

    def __init__(self, settings: AttitudeSettings | None = None) -> None:
        self.settings = settings or AttitudeSettings()
        if self.settings.method is not AttitudeMethod.AKF:
            raise SettingsError(
                f"method is {str(self.settings.method)!r}; expected 'akf', the one that runs in a stream"
            )
        self._akf = _new_filter(self.settings)
        self._time_s = 0.0

    def push(
        self,
        time_s: float,
        acc_m_s2: FloatArray,
        gyr_rad_s: FloatArray,
        *,
        is_acc_saturated: bool = False,
        is_gyr_saturated: bool = False,
    ) -> AttitudeTrack:
        """The attitude at this sample, as a track of one. Raises `RecordingError` when time does not increase."""
        track = ImuTrack(np.array([time_s]), np.reshape(acc_m_s2, (1, 3)), np.reshape(gyr_rad_s, (1, 3)))
        if self._akf.is_started and time_s <= self._time_s:
            raise RecordingError(
                "time_not_increasing", column="time_s", found=f"{time_s} after {self._time_s}", wanted="increasing"
            )
        flags = GYR_SATURATED * is_gyr_saturated + ACC_SATURATED * is_acc_saturated
        gyr, acc = track.gyr_rad_s[0].tolist(), track.acc_m_s2[0].tolist()
        self._akf.step(time_s - self._time_s, gyr[0], gyr[1], gyr[2], acc[0], acc[1], acc[2], flags, -1.0)
        self._time_s = time_s
        out = _Estimate.empty(1)
        self._akf.write(0, *out.views)
        return _as_track(track, out, self.settings)


# --------------------------------------------------------------------------------------------------- the default


@dataclass(frozen=True, slots=True)
class _Estimate:
    """What the kernel writes."""

    q: FloatArray  # (n, 4)
    bias: FloatArray  # (n, 3)
    tilt_var: FloatArray  # (n,)
    r: FloatArray  # (n,)
    innovation: FloatArray  # (n, 3), or (0, 3) when nobody smooths

    @classmethod
    def empty(cls, n: int, *, n_innovations: int = 0) -> _Estimate:
        return cls(np.empty((n, 4)), np.empty((n, 3)), np.empty(n), np.empty(n), np.empty((n_innovations, 3)))

    @property
    def views(self) -> tuple[memoryview[float], ...]:
        return tuple(memory(values) for values in (self.q, self.bias, self.tilt_var, self.r, self.innovation))


def _akf(track: ImuTrack, settings: AttitudeSettings) -> AttitudeTrack:
    out = _Estimate.empty(track.n_samples, n_innovations=track.n_samples if settings.smooth else 0)
    samples = (memory(track.time_s), memory(track.gyr_rad_s), memory(track.acc_m_s2), _sample_flags(track).data)
    akf = _new_filter(settings)
    akf.run(*samples, *out.views)
    if settings.smooth:
        smoothing.centred_r(
            samples[0],
            memory(out.innovation),
            settings.window_s,
            settings.r_floor_m2_s2,
            settings.r_largest_m2_s2,
            memory(out.r),
        )
        _smooth(samples, out, settings, akf.scale)
    return _as_track(track, out, settings)


def _smooth(
    samples: tuple[memoryview[float], memoryview[float], memoryview[float], memoryview[int]],
    out: _Estimate,
    settings: AttitudeSettings,
    scale: list[float],
) -> None:
    """Replaces the causal estimate by the smoothed one.

    The filter runs once and keeps its state at every block's start; then, from the last block to the first, it runs
    through the block again with a tape, and the smoother reads the tape backwards. The memory needed does not grow
    with what the smoother must know of a sample.
    """
    time_s, gyr, acc, flags = samples
    n = len(time_s)
    q, bias, tilt_var, r, _ = out.views
    tape, marks = np.empty((min(BLOCK, n), 128)), np.empty((min(BLOCK, n), 7), dtype=np.intp)
    is_row = np.zeros(n, dtype=np.uint8)
    akf = _new_filter(settings)
    akf.start_s = 0.0  # a finished recording needs no careful start: what comes later corrects it
    akf.b = out.bias[-1].tolist()  # ... but one near enough to be linear about: the bias as it was known at the end
    akf.has_rested = True
    akf.scale = scale  # what does not change is known best at the end, ...
    akf.errors.end = 8  # ... and is not estimated again
    states = []
    for first in range(0, n, BLOCK):
        states.append(kernel.AttitudeFilter())
        states[-1].take(akf)
        if first + BLOCK < n:
            akf.skip(time_s, gyr, acc, flags, r, first, first + BLOCK)
    smoother = smoothing.Smoother()
    for block in range(len(states) - 1, -1, -1):
        first = block * BLOCK
        akf.take(states.pop())
        n_rows = akf.write_tape(time_s, gyr, acc, flags, r, first, min(first + BLOCK, n), memory(tape), marks.data)
        smoother.run(memory(tape), marks.data, n_rows, q, bias, tilt_var)
        is_row[marks[:n_rows, 0]] = 1
    too_large = np.reshape(scale, (3, 3)).T  # a share of what is left of the rate without its bias
    without_scale = np.asarray(gyr) @ (np.eye(3) - too_large) + out.bias[-1] @ too_large
    smoothing.fill(time_s, memory(without_scale), is_row.data, q, bias, tilt_var)


def _new_filter(settings: AttitudeSettings) -> kernel.AttitudeFilter:
    """The filter with the settings' numbers in the kernel's form."""
    akf = kernel.AttitudeFilter()
    akf.update_s = settings.update_s
    akf.gyr_delay_s = settings.gyr_delay_s
    akf.gyr_q = settings.gyr_noise_rad_sqrt_s**2
    akf.rate_q = settings.gyr_scale_error**2 * settings.gyr_scale_time_s
    akf.bias_q = settings.bias_walk_rad_s_sqrt_s**2
    akf.acc_q = settings.acc_noise_m_s_sqrt_s**2
    akf.clip_rate = settings.clip_rate_rad_s
    akf.clip_acc = settings.clip_acc_m_s2
    akf.gyr_saturated_q = settings.gyr_saturated_rad_sqrt_s**2
    akf.acc_saturated_q = settings.acc_saturated_m_s_sqrt_s**2
    akf.start_s = settings.start_s
    akf.gap_s = settings.gap_s
    akf.reset_gap_s = settings.reset_gap_s
    akf.gap_rate_var = settings.gap_rate_rad_s**2
    akf.gap_acc_var = settings.gap_acc_m_s2**2
    akf.tilt_var = settings.sd_start_tilt_rad**2
    akf.velocity_var = settings.sd_start_velocity_m_s**2
    akf.bias_var = settings.sd_start_bias_rad_s**2
    akf.scale_var = settings.sd_start_scale**2
    akf.r_is_constant = not settings.is_adaptive
    akf.r_factor = settings.r_factor_s
    akf.r_start = settings.r_start_m2_s2
    akf.r_start_s = settings.r_start_s
    akf.r_floor = settings.r_floor_m2_s2
    akf.r_largest = settings.r_largest_m2_s2
    akf.window_s = settings.window_s
    akf.rest_rate = settings.rest_rate_rad_s
    akf.rest_acc = settings.rest_acc_m_s2
    akf.rest_min_s = settings.rest_min_s
    akf.rest_bias_q = settings.rest_bias_rad_sqrt_s**2
    akf.rest_bias_gate = settings.rest_bias_gate_rad_s**2
    akf.rest_r = settings.rest_r_m_sqrt_s**2
    return akf


def _as_track(track: ImuTrack, out: _Estimate, settings: AttitudeSettings) -> AttitudeTrack:
    """Brings the attitude from the gyro's delayed time to the sample's, and adds to sd what the filter cannot know."""
    smoothing.finish(
        memory(track.gyr_rad_s),
        memory(out.bias),
        settings.gyr_delay_s,
        (settings.sd_acc_bias_m_s2 / STANDARD_GRAVITY_M_S2) ** 2,
        0.5 * settings.sd_delay_s**2,
        memory(out.q),
        memory(out.tilt_var),
    )
    return AttitudeTrack(track.time_s, out.q, out.tilt_var, out.bias, out.r, r_unit="m2/s2")


# ------------------------------------------------------------------------------------- the source's, to compare


def _source(track: ImuTrack, settings: AttitudeSettings) -> AttitudeTrack:
    """Equations (1)-(17) of the source, word for word, in its convention; `ekf` is the same with R constant."""
    n = track.n_samples
    x, tilt_var, r = np.empty((n, 4)), np.empty(n), np.empty(n)
    of_source = source_kernel.SourceFilter()
    of_source.gyr_var = settings.source_gyr_noise_rad_s**2
    of_source.acc_var = settings.source_acc_noise_m_s2**2
    of_source.g = STANDARD_GRAVITY_M_S2
    of_source.n_window = settings.source_window_n if settings.method is AttitudeMethod.AKF_SOURCE else 1
    of_source.x = to_source(_upright_start(track)).tolist()
    of_source.p = (np.eye(4).ravel() * settings.sd_start_tilt_rad**2 / 4).tolist()
    window = np.empty((of_source.n_window, 12))
    samples = (memory(track.time_s), memory(track.gyr_rad_s), memory(track.acc_m_s2))
    of_source.run(*samples, memory(window), memory(x), memory(tilt_var), memory(r))
    return AttitudeTrack(track.time_s, from_source(x), np.sqrt(tilt_var), np.zeros((n, 3)), r, r_unit="m2/s4")


def _gyro(track: ImuTrack, settings: AttitudeSettings) -> AttitudeTrack:
    """The rates alone, from the tilt that the first sample shows; its error grows with time, and so does its sd."""
    n = track.n_samples
    q, bias, tilt_var = np.empty((n, 4)), np.zeros((n, 3)), np.zeros(n)
    q[0] = _upright_start(track)
    is_row = np.zeros(n, dtype=np.uint8)
    smoothing.fill(
        memory(track.time_s), memory(track.gyr_rad_s), is_row.data, memory(q), memory(bias), memory(tilt_var)
    )
    since_s = track.time_s - track.time_s[0]
    start = abs(float(np.linalg.norm(track.acc_m_s2[0])) / STANDARD_GRAVITY_M_S2 - 1.0)
    bias_sd = settings.sd_start_bias_rad_s
    sd = np.sqrt(start**2 + (settings.sd_acc_bias_m_s2 / STANDARD_GRAVITY_M_S2) ** 2 + (bias_sd * since_s) ** 2)
    return AttitudeTrack(track.time_s, q, sd, bias, np.zeros(n))


def _upright_start(track: ImuTrack) -> FloatArray:
    """The attitude that makes the first specific force point up."""
    acc = track.acc_m_s2[0]
    up = np.array([0.0, 0.0, 1.0])
    return from_two_vectors(up, acc if acc.any() else up)


# ------------------------------------------------------------------------------------------------- to the kernel


def _sample_flags(track: ImuTrack) -> NDArray[np.uint8]:
    """Which samples are known to be saturated, as the kernel's bits; it finds by itself those that stand still."""
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


@functools.cache
def _say_once_how_it_runs() -> None:
    if str(kernel.__file__).endswith(".py"):
        log.warning("the attitude kernel is not compiled; the same algorithm runs in Python, about 160 times slower")
