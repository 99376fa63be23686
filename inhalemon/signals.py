"""Small helpers on sampled signals that several stages share."""

from __future__ import annotations

from typing import cast

import numpy as np

from inhalemon import _loops_kernel as kernel
from inhalemon.rotation import components, slerp
from inhalemon.values import AttitudeTrack, BoolArray, FloatArray, IntArray


def resample_attitude(track: AttitudeTrack, time_s: FloatArray) -> AttitudeTrack:
    """The attitude at other times, by the shortest turn between the two samples around each; held beyond the ends."""
    n = track.time_s.size
    place = at_times(track.time_s, np.arange(float(n)), time_s)  # a sample number and the share of the way to the next
    before = np.minimum(place.astype(np.int64), max(n - 2, 0))
    q = components(track.q)
    return AttitudeTrack(
        time_s=time_s,
        q=slerp(q.take(before, axis=1).T, q.take(np.minimum(before + 1, n - 1), axis=1).T, place - before),
        sd_tilt_rad=at_times(track.time_s, track.sd_tilt_rad, time_s),
        gyr_bias_rad_s=at_times(track.time_s, track.gyr_bias_rad_s, time_s),
        r=at_times(track.time_s, track.r, time_s),
        r_unit=track.r_unit,
    )


def memory(values: FloatArray) -> memoryview[float]:
    """The array's own memory: the compiled kernel and plain Python both index it, and Python gets plain floats."""
    return cast("memoryview[float]", np.ascontiguousarray(values).data)


def at_times(time_s: FloatArray, values: FloatArray, at_s: FloatArray) -> FloatArray:
    """`values` (n,) or (n, k) at other times, straight between samples and held beyond the ends.

    `numpy.interp`, but the place of a time is looked for once for all columns.
    """
    _check_sizes(time_s, values)
    rows = np.ascontiguousarray(np.atleast_2d(values.T))
    found = np.empty((rows.shape[0], at_s.size))
    kernel.straight(memory(time_s), memory(rows), memory(at_s), memory(found))
    return found.T if values.ndim > 1 else found[0]


def moving_mean(values: FloatArray, width: int) -> FloatArray:
    """Mean over a centred window of `width` samples, at least one; at the ends over what is there. Shape as given."""
    width = max(width, 1)
    rows = np.ascontiguousarray(np.atleast_2d(values.T))
    n = values.shape[0]
    before, after = min(width // 2, n), min(width - width // 2, n)
    means = np.empty(rows.shape)
    kernel.moving_means(memory(rows), before, after, memory(np.empty(n + 1)), memory(means))
    return means.T if values.ndim > 1 else means[0]


def means_between(time_s: FloatArray, values: FloatArray, edges_s: FloatArray) -> FloatArray:
    """Time means of `values` (n, k) between one edge and the next, (k, m - 1), for signals straight between samples."""
    _check_sizes(time_s, values)
    integrals = np.empty((values.shape[1], edges_s.size))
    total = np.zeros(values.shape[1])
    kernel.integrate(memory(time_s), memory(values), total.size, memory(edges_s), memory(total), memory(integrals))
    means: FloatArray = (integrals[:, 1:] - integrals[:, :-1]) / (edges_s[1:] - edges_s[:-1])
    return means


def _check_sizes(time_s: FloatArray, values: FloatArray) -> None:
    """The compiled kernels do not look whether they read beyond an array."""
    if not 0 < time_s.size == values.shape[0]:
        raise ValueError(f"{values.shape[0]} values at {time_s.size} times; expected one at each, and one at least")


def quantile(values: FloatArray, share: float) -> FloatArray:
    """The value below which a `share` of the samples (the first axis) lies, straight between two of them.

    numpy's own take five and ten times as long on the few hundred samples of one movement.
    """
    ordered = values.copy("K")
    ordered.sort(axis=0)
    at = share * (ordered.shape[0] - 1)
    low = int(at)
    high = min(low + 1, ordered.shape[0] - 1)
    between: FloatArray = ordered[low] + (at - low) * (ordered[high] - ordered[low])
    return between


def squares(vectors: FloatArray) -> FloatArray:
    """The square (n,) of the length of each of n vectors."""
    squared: FloatArray = (vectors * vectors) @ np.ones(vectors.shape[1])  # einsum takes thrice as long row by row
    return squared


def lengths(vectors: FloatArray) -> FloatArray:
    """The length (n,) of each of n vectors."""
    return np.sqrt(squares(vectors))


def runs(is_true: BoolArray) -> IntArray:
    """The stretches where a mask is true: rows of `start, end`, half open. Shape (n, 2)."""
    edged = np.zeros(is_true.size + 2, dtype=np.bool_)
    edged[1:-1] = is_true
    edges: IntArray = (edged[1:] != edged[:-1]).nonzero()[0].reshape(-1, 2)
    return edges


def close_gaps(is_true: BoolArray, longest: int) -> BoolArray:
    """The mask with false stretches of at most `longest` samples between true ones filled."""
    filled = is_true.copy()
    for start, end in runs(~is_true).tolist():
        if start > 0 and end < is_true.size and end - start <= longest:
            filled[start:end] = True
    return filled


def drop_short(is_true: BoolArray, shortest: int) -> BoolArray:
    """The mask without true stretches shorter than `shortest` samples."""
    kept = is_true.copy()
    for start, end in runs(is_true).tolist():
        if end - start < shortest:
            kept[start:end] = False
    return kept


def onset(values: FloatArray, low: int, high: int) -> int:
    """The sample at which the rise (or fall) from `low` to `high` begins, both sample numbers of `values`.

    The first moments of a movement drown in noise, so they are found backwards from where 5 % and 50 % are done: the
    movement set off before by 0.55 of the time between the two: 0.6 for least jerk, with or without end stop, and
    for lags in a row, 0.4 for a raised cosine.
    """
    part = values[low : high + 1]
    done = (part - part[0]) / (part[-1] - part[0]) if part[-1] != part[0] else np.zeros(part.size)
    half = int((done >= 0.5).argmax())
    begun = (done[: half + 1] <= 0.05).nonzero()[0]
    if begun.size == 0 or half == 0:
        return low
    first = _crossing(done, int(begun[-1]), 0.05)
    return max(low + round(first - 0.55 * (_crossing(done, half - 1, 0.5) - first)), low)


def _crossing(values: FloatArray, before: int, level: float) -> float:
    """Where between sample `before` and the next the values pass the level, in samples."""
    here, after = float(values[before]), float(values[before + 1])
    return before + (level - here) / (after - here)
