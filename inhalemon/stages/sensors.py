"""What the two sensors say of each other's errors while the lever is shut, before any attitude is estimated."""

from __future__ import annotations

import dataclasses

import numpy as np

from inhalemon.rotation import (
    IDENTITY,
    as_matrix,
    conjugate,
    from_rotation_vector,
    multiply,
    split_twist,
)
from inhalemon.settings import SensorSettings
from inhalemon.signals import lengths, means_between, quantile, squares
from inhalemon.values import STANDARD_GRAVITY_M_S2, BoolArray, FloatArray, ImuTrack, Recording

_TUKEY = 4.0  # standard deviations beyond which a block has no say
_N_ROUNDS = 10  # of weighing and fitting
_FIRST_SCALE = 0.2  # of the rate: at first the mounting may be 10 deg off and must not look like an outlier
_NARROWING = 0.7  # from round to round
_MIN_TELLING = 5  # blocks
_TOO_MUCH = 6.0  # standard deviations of what a chip may have
_EYE = np.eye(3)


def correct_sensors(recording: Recording, hinge_axis: FloatArray, settings: SensorSettings) -> Recording:
    """The recording with the sensors' errors removed as far as the shut lever and gravity show them.

    While the lever is shut, both sensors ride on one rigid body. Their rates then differ by the mounting and by the
    difference of their gyro biases, whatever the motion; in quiet moments their specific forces differ by the mounting
    and by the difference of their accelerometer biases, and the length of each is g. So, from means over short blocks:

    1. each gyro's bias, about, from its middle rate in quiet stretches;
    2. mounting and what is left of the relative gyro bias, from the rates, by Tukey-weighted least squares;
    3. the lever's angle so far from the integrated difference about the hinge, which says when it is shut;
    4. step 2 again on the shut blocks; then both accelerometers' biases by least squares with a prior.

    The relative gyro bias is taken from the lever's rates: what bias remains is the same for both. Both clocks are the
    body's. `hinge_axis` is the device profile's, positive for opening. Uses the whole recording.
    """
    blocks = _Blocks.of(recording.body, recording.lever, settings.block_s, settings.max_gap_s)
    if int(blocks.is_whole.sum()) * settings.block_s < settings.min_common_s:
        return recording
    axis = np.asarray(hinge_axis, dtype=np.float64) / np.linalg.norm(hinge_axis)
    quiet = _Quiet.of(blocks, settings)
    bias_body = _rest_bias(blocks.gyr_body, quiet.body, quiet.n_blocks)
    bias_lever = _rest_bias(blocks.gyr_lever, quiet.lever, quiet.n_blocks)
    blocks = dataclasses.replace(blocks, gyr_body=blocks.gyr_body - bias_body, gyr_lever=blocks.gyr_lever - bias_lever)
    q_body_lever, bias_between, is_shut = _shut_mounting(blocks, axis, settings)
    acc_bias_body, acc_bias_lever = _acc_biases(blocks, quiet, q_body_lever, is_shut, settings)
    if max(np.abs(acc_bias_body).max(), np.abs(acc_bias_lever).max()) > _TOO_MUCH * settings.sd_acc_bias_m_s2:
        # No chip is that far off: the lever was not shut when it seemed so.
        return recording
    return recording.with_tracks(
        body=_less(recording.body, bias_body, acc_bias_body),
        lever=_less(recording.lever, bias_lever + bias_between, acc_bias_lever),
    )


def _less(track: ImuTrack, gyr_bias_rad_s: FloatArray, acc_bias_m_s2: FloatArray) -> ImuTrack:
    return dataclasses.replace(
        track, gyr_rad_s=track.gyr_rad_s - gyr_bias_rad_s, acc_m_s2=track.acc_m_s2 - acc_bias_m_s2
    )


@dataclasses.dataclass(frozen=True, slots=True)
class _Blocks:
    """Time means of both sensors over the same short blocks."""

    acc_body: FloatArray  # (m, 3)
    gyr_body: FloatArray  # (m, 3)
    acc_lever: FloatArray  # (m, 3)
    gyr_lever: FloatArray  # (m, 3)
    is_whole: BoolArray  # (m,) samples of both in every block
    block_s: float

    @classmethod
    def of(cls, body: ImuTrack, lever: ImuTrack, block_s: float, max_gap_s: float) -> _Blocks:
        start_s = max(body.time_s[0], lever.time_s[0])
        end_s = min(body.time_s[-1], lever.time_s[-1])
        edges = start_s + block_s * np.arange(max(int((end_s - start_s) / block_s), 0) + 1)
        acc_body, gyr_body, has_body = _means(body, edges, max_gap_s)
        acc_lever, gyr_lever, has_lever = _means(lever, edges, max_gap_s)
        return cls(acc_body, gyr_body, acc_lever, gyr_lever, has_body & has_lever, block_s)


def _means(track: ImuTrack, edges: FloatArray, max_gap_s: float) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Means of specific force and rate between edges, for signals straight between samples; and which have no gap."""
    acc, gyr = (means_between(track.time_s, values, edges).T for values in (track.acc_m_s2, track.gyr_rad_s))
    step_s = np.diff(track.time_s)
    has_samples: BoolArray = np.diff(np.searchsorted(track.time_s, edges)) > 0
    for gap in np.flatnonzero(step_s > max(max_gap_s, 2.5 / track.rate_hz)):
        first, last = np.searchsorted(edges, track.time_s[[gap, gap + 1]], side="right") - 1
        has_samples[max(first, 0) : last + 1] = False
    return np.ascontiguousarray(acc), np.ascontiguousarray(gyr), has_samples


@dataclasses.dataclass(frozen=True, slots=True)
class _Quiet:
    """Which stretches of `n_blocks` blocks are quiet: rest, or a hand that holds still."""

    body: BoolArray  # (k,)
    lever: BoolArray  # (k,)
    n_blocks: int

    @classmethod
    def of(cls, blocks: _Blocks, settings: SensorSettings) -> _Quiet:
        n = max(round(settings.quiet_s / blocks.block_s), 2)
        is_whole = _stretches(blocks.is_whole.astype(np.float64), n).all(axis=1)
        body, lever = (
            is_whole
            & (_variance(_stretches(acc, n)) < settings.quiet_acc_m_s2**2)
            & (_variance(_stretches(gyr, n)) < settings.quiet_gyr_rad_s**2)
            for acc, gyr in ((blocks.acc_body, blocks.gyr_body), (blocks.acc_lever, blocks.gyr_lever))
        )
        return cls(body, lever, n)


def _stretches(values: FloatArray, n: int) -> FloatArray:
    """(k, n, ...) from (m, ...): the last few may be left out."""
    return values[: values.shape[0] // n * n].reshape(-1, n, *values.shape[1:])


def _variance(stretches: FloatArray) -> FloatArray:
    """The variance of all three axes together within each stretch (k,)."""
    n = stretches.shape[1]
    apart = stretches - (np.full((1, n), 1.0 / n) @ stretches)
    variance: FloatArray = np.einsum("ijk,ijk->i", apart, apart) / n
    return variance


def _rest_bias(gyr: FloatArray, is_quiet: BoolArray, n: int) -> FloatArray:
    """The middle rate of the quiet stretches (3,): a slow turn now and then does not move it."""
    if not is_quiet.any():
        return np.zeros(3)
    return quantile(_stretches(gyr, n)[is_quiet].mean(axis=1), 0.5)


def _shut_mounting(
    blocks: _Blocks, axis: FloatArray, settings: SensorSettings
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """`q_body_lever` of the shut lever, the lever's gyro bias against the body's, and which blocks are shut."""
    whole = blocks.is_whole
    q = IDENTITY
    bias = np.zeros(3)
    length2 = squares(blocks.gyr_body)
    weight = np.zeros(whole.size)
    turned, misfit = _misfit(blocks, q, bias)
    for scale in np.maximum(settings.sd_gyr_scale, _FIRST_SCALE * _NARROWING ** np.arange(_N_ROUNDS)).tolist():
        size = lengths(misfit)
        scatter = max(1.4826 * float(quantile(size[whole], 0.5)), settings.sd_gyr_rad_s)
        variance = scatter**2 + scale**2 * length2
        weight = np.where(whole, np.maximum(1.0 - size * size / (_TUKEY**2 * variance), 0.0) ** 2, 0.0)
        q, bias = _fitted(turned, misfit, q, bias, weight / variance, settings)
        turned, misfit = _misfit(blocks, q, bias)

    rate = misfit @ axis
    angle = np.cumsum(np.where(whole, rate, 0.0)) * blocks.block_s
    is_still = whole & (np.abs(rate) < settings.max_hinge_rate_rad_s)
    across = np.sqrt(np.maximum(length2 - (blocks.gyr_body @ axis) ** 2, 0.0))
    telling = (weight > 0.5) & (across > settings.min_across_rad_s)
    if int(telling.sum()) >= _MIN_TELLING:
        # The angle at which the moving blocks agree may be the open one: the mounting's turn about the hinge tells.
        angle = angle - quantile(angle[telling], 0.5)
        turn = float(split_twist(q, axis)[0])
        if abs(turn) > settings.max_mounting_rad:
            q = multiply(q, from_rotation_vector(np.asarray(-turn * axis, dtype=np.float64)))
            angle = angle + turn
    elif is_still.any():
        # Hardly any motion: shut is the smallest angle that is kept for a second.
        kept = np.sort(angle[is_still])
        angle = angle - kept[min(round(1.0 / blocks.block_s), kept.size - 1)]
    is_shut = is_still & (np.abs(angle) < settings.shut_band_rad)
    if int(is_shut.sum()) * blocks.block_s >= settings.min_common_s:
        variance = settings.sd_gyr_rad_s**2 + settings.sd_gyr_scale**2 * length2
        turned, misfit = _misfit(blocks, q, bias)
        q, bias = _fitted(turned, misfit, q, bias, np.where(is_shut, 1.0 / variance, 0.0), settings)
    return q, bias, is_shut


def _misfit(blocks: _Blocks, q_body_lever: FloatArray, bias: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The body's rates as the lever should read them, and what the lever reads beyond that and its bias, (m, 3)."""
    # v @ as_matrix(q_a_b) turns rows v_a into v_b: as rotate(conjugate(q), v), many at once.
    turned: FloatArray = blocks.gyr_body @ as_matrix(q_body_lever)
    return turned, blocks.gyr_lever - turned - bias


def _fitted(
    turned: FloatArray,
    misfit: FloatArray,
    q: FloatArray,
    bias: FloatArray,
    weight: FloatArray,
    settings: SensorSettings,
) -> tuple[FloatArray, FloatArray]:
    """One weighted step of mounting and bias to gyr_lever = rotate(q_lever_body, gyr_body) + bias.

    What the motion does not show stays where it was.
    """
    # A small turn s of the lever's frame changes the turned rate t by t x s: the normal equations are moments of t.
    weighted = turned.T * weight
    moment = weighted @ turned
    sum_x, sum_y, sum_z = (turned.T @ weight).tolist()
    across = np.array([[0.0, -sum_z, sum_y], [sum_z, 0.0, -sum_x], [-sum_y, sum_x, 0.0]])
    normal = np.empty((6, 6))
    normal[:3, :3] = (moment.trace() + settings.sd_mounting_rad**-2) * _EYE - moment
    normal[:3, 3:], normal[3:, :3] = -across, across
    normal[3:, 3:] = (weight.sum() + settings.sd_gyr_bias_rad_s**-2) * _EYE
    product = weighted @ misfit
    turn = [product[2, 1] - product[1, 2], product[0, 2] - product[2, 0], product[1, 0] - product[0, 1]]
    step = np.linalg.solve(normal, np.concatenate([turn, weight @ misfit]))
    return multiply(q, from_rotation_vector(step[:3])), bias + step[3:]


def _acc_biases(
    blocks: _Blocks, quiet: _Quiet, q_body_lever: FloatArray, is_shut: BoolArray, settings: SensorSettings
) -> tuple[FloatArray, FloatArray]:
    """Accelerometer biases of body and lever (3,), from quiet stretches, with zero as what was known before."""
    k = quiet.n_blocks
    shut = is_shut[: quiet.body.size * k].reshape(-1, k).all(axis=1) & quiet.body & quiet.lever
    mean_body, mean_lever = (_stretches(acc, k).mean(axis=1) for acc in (blocks.acc_body, blocks.acc_lever))
    normal = np.eye(6) / settings.sd_acc_bias_m_s2**2
    pull = np.zeros(6)
    for part, mean, chosen in ((slice(0, 3), mean_body, quiet.body), (slice(3, 6), mean_lever, quiet.lever)):
        # |acc| - g is the bias along gravity.
        length = np.linalg.norm(mean[chosen], axis=1, keepdims=True)
        up = mean[chosen] / np.maximum(length, STANDARD_GRAVITY_M_S2 / 2)
        normal[part, part] += up.T @ up / settings.sd_acc_m_s2**2
        pull[part] += up.T @ (length[:, 0] - STANDARD_GRAVITY_M_S2) / settings.sd_acc_m_s2**2
    to_lever = as_matrix(conjugate(q_body_lever))
    both = np.concatenate([-to_lever, _EYE], axis=1)
    normal += both.T @ both * (shut.sum() / settings.sd_acc_m_s2**2)
    difference = (mean_lever[shut] - mean_body[shut] @ to_lever.T).sum(axis=0)
    pull += both.T @ difference / settings.sd_acc_m_s2**2
    biases = np.asarray(np.linalg.solve(normal, pull), dtype=np.float64)
    return biases[:3], biases[3:]
