"""Two sensors, two clocks: the lever's times brought to the body's clock by the motion that both sensors share."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass

import numpy as np

from inhalemon import _loops_kernel as kernel
from inhalemon.rotation import components
from inhalemon.settings import ClockSettings
from inhalemon.signals import means_between, memory, quantile
from inhalemon.values import BoolArray, ClockFit, FloatArray, ImuTrack, IntArray, Recording

_REST_BLOCK_S = 0.5
_MIN_LENGTH_S = 1.0
_MIN_SAMPLES = 4  # that a cubic needs
_MAX_REST_SD_RAD_S = 0.02
_MAX_HELD_SD_RAD_S = 0.1  # held still in the hand: better than nothing


@dataclass(frozen=True, slots=True)
class _Rates:
    """One sensor's angular rates without their rest bias."""

    time_s: FloatArray  # (n,)
    gyr_rad_s: FloatArray  # (3, n) each axis by itself
    is_good: BoolArray  # (n,) neither saturated nor beside a gap
    noise_rad_s: float  # root mean square of all three axes when stillest
    has_rest: bool  # so still, that the bias is known


# What is fitted: the lever's clock against the body's, its gyroscope's scale (less one), both biases, and the y and z
# of both hinge axes (1, y, z). The biases are fitted when no rest told them, the axes when the lever may move.
_OFFSET, _DRIFT, _SCALE = 0, 1, 2
_BIAS_BODY, _BIAS_LEVER, _AXIS_BODY, _AXIS_LEVER = slice(3, 6), slice(6, 9), slice(9, 11), slice(11, 13)
_N_UNKNOWNS = 13
_LEAST_SHARE = 1e-9  # left unexplained: clocks that agree perfectly are no better than that


@dataclass(frozen=True, slots=True)
class _Fitted:
    unknowns: FloatArray  # (13,)
    fit: ClockFit
    share_left: float  # of the lever's variance, not explained by the body's motion
    cost: float  # minus twice the logarithm of the likelihood, with what is known before of drift, scales and biases
    agreed: float  # of the motion in a typical second, how much is within the sensors' tolerance


def align_clocks(recording: Recording, settings: ClockSettings) -> tuple[Recording, ClockFit]:
    """The recording with the lever's times on the body's clock, and what was found of the two clocks.

    Both sensors turn together while the lever is still, so the length of their angular rate agrees in every mounting
    and at every lever angle. A coarse offset over all lags comes from the cross-correlation of the two lengths; offset,
    drift and the ratio of the gyroscopes' scales then from weighted least squares on the samples (Gauss-Newton, with
    the body's rates interpolated as vectors); without a rest that tells the biases, they are fitted too. Tukey's
    weights leave out the lever's own strokes and impacts. Standard deviations come from the scatter of one-second
    blocks (the sandwich estimator), since the residuals are not white.

    A shake's speed repeats itself twice a period. The fit is therefore tried at all lags that look alike; of those at
    which a typical second agrees within the sensors' tolerance, the closest is taken.

    Where the lever hardly rests, the part of the rate across the hinge is compared instead, which the hinge's own
    motion does not touch; the two hinge axes are then fitted too, near x (the constraint of Seel, Raisch, Schauer 2014,
    doi:10.3390/s140406891, with time as a further unknown).

    When too little motion is shared the clocks are taken as they are (`is_found` false). Should they not overlap at
    all then, the lever is moved so that both begin together, which only keeps the recording readable.
    """
    fit = _shared_motion(recording.body, recording.lever, settings) or _unknown(recording, settings)
    if fit.offset_s == 0.0 and fit.drift == 0.0:
        return recording, fit
    time_s = recording.lever.time_s
    moved = time_s + fit.offset_s + fit.drift * (time_s - fit.reference_s)
    return recording.with_tracks(lever=dataclasses.replace(recording.lever, time_s=moved)), fit


def _shared_motion(body_track: ImuTrack, lever_track: ImuTrack, settings: ClockSettings) -> ClockFit | None:
    tracks = (body_track, lever_track)
    if any(track.n_samples < _MIN_SAMPLES or np.ptp(track.time_s) < _MIN_LENGTH_S for track in tracks):
        return None
    body, lever = _rates(body_track), _rates(lever_track)
    return _fit(body, lever, settings, lever_moves=False) or _fit(body, lever, settings, lever_moves=True)


def _unknown(recording: Recording, settings: ClockSettings) -> ClockFit:
    body_s, lever_s = recording.body.time_s, recording.lever.time_s
    overlap_s = min(body_s[-1], lever_s[-1]) - max(body_s[0], lever_s[0])
    return ClockFit(
        offset_s=0.0 if overlap_s > 0 else float(body_s[0] - lever_s[0]),
        drift=0.0,
        reference_s=float(lever_s[0]),
        sd_offset_s=settings.max_offset_s,
        sd_drift=settings.sd_drift,
        is_found=False,
    )


def _rates(track: ImuTrack) -> _Rates:
    time_s = track.time_s
    step_s = np.diff(time_s)
    usual_s = track.usual_step_s
    n_block = max(4, round(_REST_BLOCK_S / usual_s))
    blocks = track.gyr_rad_s[: time_s.size // n_block * n_block].reshape(-1, n_block, 3)
    means = np.full(n_block, 1.0 / n_block) @ blocks
    variance = np.einsum("ijk,ijk->i", blocks, blocks) / n_block - np.einsum("ij,ij->i", means, means)
    stillest = int(np.argmin(variance))
    noise = float(np.sqrt(max(variance[stillest], 0.0)))
    gyr = components(track.gyr_rad_s)
    if noise < _MAX_HELD_SD_RAD_S:
        gyr = gyr - means[stillest][:, None]
    is_whole = step_s < 2.5 * usual_s
    is_good = np.ones(time_s.size, dtype=np.bool_)
    is_good[1:] &= is_whole
    is_good[:-1] &= is_whole
    if track.is_gyr_saturated is not None:
        is_good &= ~track.is_gyr_saturated
    return _Rates(time_s, gyr, is_good, noise, has_rest=noise < _MAX_REST_SD_RAD_S)


def _fit(body: _Rates, lever: _Rates, settings: ClockSettings, *, lever_moves: bool) -> ClockFit | None:
    """Offset and drift from all of the session, widening from its liveliest part so that drift cannot mislead.

    `None` when the two sensors do not agree well enough to be believed.
    """
    axis = np.zeros(2) if lever_moves else None
    body_speed, lever_speed = _length(body.gyr_rad_s, axis)[0], _length(lever.gyr_rad_s, axis)[0]
    steepness = np.abs(np.diff(lever_speed, append=lever_speed[-1]))
    middle_s, half_s = _liveliest(body.time_s, body_speed, settings.chunk_s)

    @functools.cache
    def telling(first: int, last: int) -> IntArray:
        chosen: IntArray = first + np.flatnonzero(lever.is_good[first:last])
        if chosen.size > settings.max_samples:
            # The steepest samples say most of the offset; drift needs some of every second.
            half = settings.max_samples // 2
            order = np.argpartition(steepness[chosen], -half)
            rest = np.sort(order[:-half])
            spread = rest[:: -(-rest.size // half)]
            chosen = chosen[np.sort(np.concatenate([order[-half:], spread]))]
        return chosen

    def refined(start: FloatArray, reference_s: float, half_s: float, *, beat: float = np.inf) -> _Fitted | None:
        first = int(lever.time_s.searchsorted(reference_s - half_s))
        last = int(lever.time_s.searchsorted(reference_s + half_s, side="right"))
        chosen = telling(first, last)
        return _refine(body, lever, chosen, start, reference_s, settings, lever_moves=lever_moves, beat=beat)

    found: _Fitted | None = None
    for offset_s in _coarse_offsets(body.time_s, body_speed, lever.time_s, lever_speed, middle_s, half_s, settings):
        start = np.zeros(_N_UNKNOWNS)
        start[_OFFSET] = offset_s
        beat = found.cost if found is not None else np.inf
        candidate = refined(start, middle_s - offset_s, half_s, beat=beat)
        if candidate is not None:
            found = candidate
            if found.share_left < settings.clear_share and found.agreed > settings.clear_agreed:
                break
    while found is not None and (middle_s - half_s > body.time_s[0] or middle_s + half_s < body.time_s[-1]):
        half_s *= 4.0
        found = refined(found.unknowns, found.fit.reference_s, half_s)
    return found.fit if found is not None and found.fit.is_found else None


def _liveliest(time_s: FloatArray, speed: FloatArray, chunk_s: float) -> tuple[float, float]:
    """The middle and half length of the stretch with the most motion."""
    if time_s[-1] - time_s[0] <= chunk_s:
        return float(time_s[0] + time_s[-1]) / 2, chunk_s / 2
    energy = np.concatenate([[0.0], np.cumsum(speed**2)])
    end = np.searchsorted(time_s, time_s + chunk_s)
    start = int(np.argmax(energy[end] - energy[:-1]))
    return float(time_s[start]) + chunk_s / 2, chunk_s / 2


def _coarse_offsets(
    body_time_s: FloatArray,
    body_speed: FloatArray,
    lever_time_s: FloatArray,
    lever_speed: FloatArray,
    middle_s: float,
    half_s: float,
    settings: ClockSettings,
) -> list[float]:
    """The lags at which the two speeds agree best, to a bin: one, or more when others come near it.

    All lags are tried; a plausible one is preferred unless another agrees clearly better.
    """
    bin_s = settings.coarse_bin_s
    a = _changes(body_time_s, body_speed, settings)
    b = _changes(lever_time_s, lever_speed, settings)
    centres = body_time_s[0] + (np.arange(a.size) + 1.0) * bin_s
    a = np.where(np.abs(centres - middle_s) <= half_s, a, 0.0)
    power = float(np.sqrt((a @ a) * (b @ b)))
    if power == 0.0:
        return []
    size = 1 << int(a.size + b.size).bit_length()
    agreement = np.fft.irfft(np.conj(np.fft.rfft(b, size)) * np.fft.rfft(a, size), size) / power
    lags = np.arange(size)
    offsets = body_time_s[0] - lever_time_s[0] + np.where(lags > size // 2, lags - size, lags) * bin_s
    is_peak = (agreement >= np.roll(agreement, 1)) & (agreement >= np.roll(agreement, -1))
    agreement = np.where(np.abs(offsets) <= settings.max_offset_s, agreement + settings.near_preference, agreement)
    peaks = np.flatnonzero(is_peak & (agreement > settings.peak_share * agreement.max()))
    best_first = peaks[np.argsort(-agreement[peaks], kind="stable")]
    return [float(offset) for offset in offsets[best_first[: settings.max_peaks]]]


def _changes(time_s: FloatArray, speed: FloatArray, settings: ClockSettings) -> FloatArray:
    """Change of the logarithm of the mean speed from bin to bin: the lever's own strokes do not outshout the rest.

    The bins' sums come from the running integral, so any rate will do.
    """
    edges = np.arange(time_s[0], time_s[-1], settings.coarse_bin_s)
    means = means_between(time_s, speed[:, None], edges)[0]
    return np.diff(np.log(settings.faint_rad_s + means))


def _refine(
    body: _Rates,
    lever: _Rates,
    chosen: IntArray,
    start: FloatArray,
    reference_s: float,
    settings: ClockSettings,
    *,
    lever_moves: bool,
    beat: float,
) -> _Fitted | None:
    """Gauss-Newton from `start` on the chosen samples of the lever.

    `None` when there are too few, no motion, or when the fit costs no less than `beat`.
    """
    time_s, gyr_lever = lever.time_s[chosen], lever.gyr_rad_s.take(chosen, axis=1)
    since = time_s - reference_s
    sd = np.array(
        [np.inf, settings.sd_drift, settings.sd_scale, *[settings.sd_bias_rad_s] * 6, *[settings.sd_axis_rad] * 4]
    )
    has_rest = body.has_rest and lever.has_rest
    free = np.array([True] * 3 + [not has_rest] * 6 + [lever_moves] * 4)
    prior = np.diag(sd[free] ** -2.0)
    unknowns = start.copy()
    there, towards_lever, along_lever = _length(gyr_lever, unknowns[_AXIS_LEVER] if lever_moves else None)
    for _ in range(settings.n_iterations):
        rate, change, is_inside = _interpolated(body, time_s + unknowns[_OFFSET] + unknowns[_DRIFT] * since)
        if np.count_nonzero(is_inside) < settings.min_samples:
            return None
        here, towards, along = _length(rate - unknowns[_BIAS_BODY, None], unknowns[_AXIS_BODY] if lever_moves else None)
        if lever_moves or not has_rest:  # the lever's biases or its axis are fitted
            there, towards_lever, along_lever = _length(
                gyr_lever - unknowns[_BIAS_LEVER, None], unknowns[_AXIS_LEVER] if lever_moves else None
            )
        slope = (towards * change).sum(axis=0)
        rows = [slope, slope * since, here]
        if not has_rest:
            rows += [*-towards, *towards_lever]
        if lever_moves:
            rows += [-along * towards[1], -along * towards[2]]
            rows += [along_lever * towards_lever[1], along_lever * towards_lever[2]]
        design = np.array(rows)
        residual = there - (1.0 + unknowns[_SCALE]) * here
        weight = _weights(residual, here, is_inside, settings)
        weighted = design * weight
        normal = weighted @ design.T + prior
        step = np.linalg.solve(normal, weighted @ residual - prior @ unknowns[free])
        step[_OFFSET] = min(max(step[_OFFSET], -settings.max_step_s), settings.max_step_s)
        unknowns[free] += step
        if abs(step[_OFFSET]) < settings.converged_s and np.all(np.abs(step[3:]) < settings.converged_rest):
            break
    residual = residual - step @ design
    variance = np.average((there - np.average(there, weights=weight)) ** 2, weights=weight)
    left = np.average(residual**2, weights=weight)
    share_left = float(left / variance)
    block = np.floor(time_s - time_s[0]).astype(np.int64)
    # The residuals of one second are alike, so each counts once.
    likelihood = np.unique(block).size * math.log(max(share_left, _LEAST_SHARE))
    cost = float(likelihood + unknowns[free] @ prior @ unknowns[free])
    if not cost < beat:  # nor when there is no motion to explain
        return None
    inverse = np.linalg.inv(normal)
    scores = np.array([np.bincount(block, row * residual) for row in weighted])
    covariance = inverse @ (scores @ scores.T + prior) @ inverse
    sd_offset, sd_drift = np.sqrt(np.diag(covariance))[:2]
    noise = min(np.hypot(body.noise_rad_s, lever.noise_rad_s), settings.sd_noise_rad_s)
    tolerance = settings.tolerance_rad_s + settings.tolerance_share * here
    agreed = _typical(block, slope**2 * is_inside, np.abs(residual) < tolerance)
    is_close = left <= min(settings.max_share_left * variance + noise**2, settings.max_share_noise * variance)
    fit = ClockFit(
        offset_s=float(unknowns[_OFFSET]),
        drift=float(unknowns[_DRIFT]),
        reference_s=reference_s,
        sd_offset_s=float(np.hypot(sd_offset, settings.sd_floor_s)),
        sd_drift=float(sd_drift),
        is_found=bool(is_close and sd_offset <= settings.max_sd_offset_s and agreed >= settings.min_agreed),
    )
    return _Fitted(unknowns, fit, share_left, cost, agreed)


def _typical(block: IntArray, motion: FloatArray, is_agreed: BoolArray) -> float:
    """The share of the motion that agrees in the middle block: half of all motion is in blocks that agree better.

    The lever's own strokes spoil the few blocks they are in. A lag of half a shake's period, at which the speeds look
    alike, disagrees a little everywhere, and weights that follow the residuals would forgive it.
    """
    of_block = np.bincount(block, motion)
    share = np.bincount(block, motion * is_agreed) / np.maximum(of_block, 1e-30)
    order = np.argsort(share, kind="stable")
    sums = np.cumsum(of_block[order])
    return float(share[order][np.searchsorted(sums, sums[-1] / 2)])


def _weights(residual: FloatArray, here: FloatArray, is_inside: BoolArray, settings: ClockSettings) -> FloatArray:
    """Tukey's weights over the variance: sensor noise, a share of the speed, and nothing for the lever's own motion."""
    spread = 1.4826 * float(quantile(np.abs(residual[is_inside]), 0.5))
    variance = max(spread, settings.sd_noise_rad_s) ** 2 + (settings.sd_scale * here) ** 2
    beyond = residual**2 / (settings.tukey**2 * variance)
    return np.where(is_inside, np.maximum(1.0 - beyond, 0.0) ** 2 / variance, 0.0)


def _length(rate: FloatArray, axis_yz: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Length (n,) and direction (3, n) of the rate, or of its part across an axis, and the part along the axis (n,)."""
    along = np.zeros(rate.shape[1])
    across = rate
    if axis_yz is not None:
        axis = np.array([1.0, *axis_yz])
        axis /= np.linalg.norm(axis)
        along = axis @ rate
        across = rate - axis[:, None] * along
    length = np.sqrt((across * across).sum(axis=0)) + 1e-9
    return length, across / length, along


def _interpolated(body: _Rates, at: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """The body's rate (3, n) and its change at any times, by cubics (Catmull-Rom, uneven times), and where it is known.

    The vectors are interpolated, not their lengths: the length has a corner where the motion turns back.
    """
    rate, change = np.empty((2, 3, at.size))
    before = np.empty(at.size, dtype=np.intp)
    kernel.interpolate(
        memory(body.time_s), memory(body.gyr_rad_s), memory(at), memory(rate), memory(change), before.data
    )
    is_within = (at >= body.time_s[before]) & (at <= body.time_s[before + 1])
    return rate, change, is_within & body.is_good[before] & body.is_good[before + 1]
