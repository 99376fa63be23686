"""Bouts of shaking, stroke by stroke."""

from __future__ import annotations

import itertools

import numpy as np

from inhalemon.settings import ShakeSettings
from inhalemon.signals import close_gaps, moving_mean, runs
from inhalemon.values import FloatArray, Motion, Shake


def find_shakes(motion: Motion, settings: ShakeSettings | None = None) -> tuple[Shake, ...]:
    """The bouts of alternating strokes, in order of time.

    A stroke is a half wave of the inertial acceleration that reaches 0.6 g along the bout's own main direction; a bout
    is at least four of them without a longer pause. Half waves too quick for a hand (a bump rings at 20 Hz and more)
    are none.
    """
    settings = settings or ShakeSettings()
    rate = motion.rate_hz
    # The slow part is carrying the device about; a shake has none.
    swing = motion.acc_ref_m_s2 - moving_mean(motion.acc_ref_m_s2, round(settings.slow_s * rate))
    is_strong = np.einsum("ij,ij->i", swing, swing) >= settings.stroke_m_s2**2
    together = close_gaps(is_strong, round(settings.max_pause_s * rate))
    found: list[Shake] = []
    for start, end in runs(together):
        first, last = max(start - round(0.2 * rate), 0), min(end + round(0.2 * rate), swing.shape[0])
        found += _bouts(motion.time_s[first:last], swing[first:last], settings)
    return tuple(found)


def _bouts(time_s: FloatArray, swing: FloatArray, settings: ShakeSettings) -> list[Shake]:
    _, _, directions = np.linalg.svd(swing, full_matrices=False)
    along = swing @ directions[0]
    edges = np.concatenate([[0], np.flatnonzero(np.diff(np.signbit(along))) + 1, [along.size]])
    strokes: list[tuple[float, float, bool]] = []
    bouts: list[list[tuple[float, float, bool]]] = [strokes]
    for i, j in itertools.pairwise(edges):
        end_s = float(time_s[min(j, time_s.size - 1)])
        start_s = float(time_s[i])
        if np.abs(along[i:j]).max() < settings.stroke_m_s2 or end_s - start_s < settings.min_stroke_s:
            continue
        if strokes and start_s - strokes[-1][1] > settings.max_pause_s:
            strokes = []
            bouts.append(strokes)
        if not strokes or strokes[-1][2] != bool(along[i] > 0):  # strokes alternate
            strokes.append((start_s, end_s, bool(along[i] > 0)))
    return [
        Shake(np.array([s[0] for s in bout]), np.array([s[1] for s in bout]))
        for bout in bouts
        if len(bout) >= settings.min_strokes
    ]
