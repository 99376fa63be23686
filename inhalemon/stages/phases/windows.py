"""Features of short windows, and what clusters of them look like."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inhalemon.settings import PhaseSettings
from inhalemon.signals import lengths, squares
from inhalemon.stages.phases.path import Path
from inhalemon.values import FloatArray, IntArray, Motion, Shake

FEATURES = (
    "log angular rate energy",
    "log inertial acceleration energy",
    "tilt",
    "change of tilt",
    "moving part's angle",
    "moving part's rate",
    "distance from where it rested",
    "shake-band power",
)


@dataclass(frozen=True, slots=True)
class Windows:
    """The session in windows of equal length, with the cluster each belongs to."""

    edges: IntArray  # (m + 1,) sample numbers
    features: FloatArray  # (m, 8) standardised
    cluster: IntArray  # (m,) numbers without meaning
    stillness: FloatArray  # (m,) 0 to 1, of the window's cluster
    shaking: FloatArray  # (m,) 0 to 1, of the window's cluster


def window_mean(values: NDArray[np.floating], edges: IntArray) -> FloatArray:
    """Means (..., m) of `values` (..., n) over the windows."""
    means: FloatArray = np.add.reduceat(values, edges[:-1], axis=-1) / (edges[1:] - edges[:-1])
    return means


def cut_windows(motion: Motion, path: Path, shakes: Sequence[Shake], settings: PhaseSettings) -> Windows:
    """Windows with their features, clustered by k-means.

    Deterministic: the first centres are spread over the features by farthest points, so no random numbers are used.
    """
    size = max(round(settings.window_s * motion.rate_hz), 2)
    n = motion.time_s.size
    edges = np.append(np.arange(0, max(n - size // 2, 1), size), n)
    is_shaken = window_mean(_shaken(motion, shakes), edges)
    features = _features(motion, path, is_shaken, edges)
    sd = features.std(axis=0)
    standard = (features - features.mean(axis=0)) / np.where(sd > 1e-9, sd, 1.0)
    first = _farthest(standard, min(settings.n_clusters, standard.shape[0]))
    cluster = _clusters(standard, standard[first])
    is_slow = window_mean(path.speed, edges) < path.still_speed
    n_members = np.bincount(cluster, minlength=first.size)
    stillness, shaking = (
        (np.bincount(cluster, weights, minlength=first.size) / np.maximum(n_members, 1))[cluster]
        for weights in (is_slow, is_shaken)
    )
    return Windows(edges, standard, cluster, stillness, shaking)


def _clusters(points: FloatArray, centres: FloatArray) -> IntArray:
    """The cluster (m,) of each point, by Lloyd's k-means from the given centres."""
    from scipy.cluster.vq import kmeans, vq  # noqa: PLC0415  slow to import: only when a session is scored

    centres, _ = kmeans(points, centres, check_finite=False)
    clusters: IntArray = vq(points, centres, check_finite=False)[0].astype(np.int64)
    return clusters


def _features(motion: Motion, path: Path, is_shaken: FloatArray, edges: IntArray) -> FloatArray:
    rate_energy = window_mean(squares(motion.gyr_rad_s), edges)
    acc_energy = window_mean(squares(motion.acc_ref_m_s2), edges)
    tilt = window_mean(motion.tilt_rad, edges)
    start, end = edges[:-1], edges[1:] - 1
    lever = window_mean(motion.lever_rad, edges)
    return np.stack(
        [
            np.log10(rate_energy + 1e-4),
            np.log10(acc_energy + 1e-3),
            tilt,
            motion.tilt_rad[end] - motion.tilt_rad[start],
            lever,
            window_mean(motion.lever_rate_rad_s, edges),
            lengths(path.pose[(start + end) // 2] - path.pose[0]),
            is_shaken,
        ],
        axis=1,
    )


def _shaken(motion: Motion, shakes: Sequence[Shake]) -> FloatArray:
    is_shaken = np.zeros(motion.time_s.size)
    for shake in shakes:
        is_shaken[motion.index(shake.start_s) : motion.index(shake.end_s) + 1] = 1.0
    return is_shaken


def _farthest(points: FloatArray, k: int) -> IntArray:
    """At most `k` points, each next the one farthest from those taken: spread out, and the same every time.

    Fewer where fewer differ.
    """
    taken = [int(np.argmin(np.einsum("ij,ij->i", points, points)))]
    nearest = np.full(points.shape[0], np.inf)
    for _ in range(k - 1):
        apart = points - points[taken[-1]]
        nearest = np.minimum(nearest, np.einsum("ij,ij->i", apart, apart))
        farthest = int(np.argmax(nearest))
        if nearest[farthest] == 0.0:
            break
        taken.append(farthest)
    return np.array(taken)
