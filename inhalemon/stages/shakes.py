"""Bouts of shaking, stroke by stroke."""

from __future__ import annotations

import itertools
import math

import numpy as np

from inhalemon.settings import ShakeSettings
from inhalemon.signals import close_gaps, moving_mean, runs, squares
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
    is_strong = squares(swing) >= settings.stroke_m_s2**2
    together = close_gaps(is_strong, round(settings.max_pause_s * rate))
    found: list[Shake] = []
    for start, end in runs(together):
        first, last = max(start - round(0.2 * rate), 0), min(end + round(0.2 * rate), swing.shape[0])
        found += _bouts(motion.time_s[first:last], swing[first:last], settings)
    return tuple(found)


def _bouts(time_s: FloatArray, swing: FloatArray, settings: ShakeSettings) -> list[Shake]:
    _, directions = np.linalg.eigh(swing.T @ swing)
    along = swing @ directions[:, -1]  # the main direction
    begin = np.concatenate([[0], np.flatnonzero(np.diff(np.signbit(along))) + 1])
    height = np.maximum.reduceat(np.abs(along), begin)
    start_s, end_s = time_s[begin], time_s[np.append(begin[1:], time_s.size - 1)]
    is_stroke = (height >= settings.stroke_m_s2) & (end_s - start_s >= settings.min_stroke_s)
    half_waves = zip(start_s.tolist(), end_s.tolist(), (along[begin] > 0).tolist(), strict=True)
    strokes: list[tuple[float, float, bool]] = []
    bouts: list[list[tuple[float, float, bool]]] = [strokes]
    for stroke in itertools.compress(half_waves, is_stroke.tolist()):
        if strokes and stroke[0] - strokes[-1][1] > settings.max_pause_s:
            strokes = []
            bouts.append(strokes)
        if not strokes or strokes[-1][2] != stroke[2]:  # strokes alternate
            strokes.append(stroke)
    found = []
    for bout in bouts:
        if len(bout) >= settings.min_strokes:
            # What is no further off than a pause would belong to the bout if it were a stroke.
            first_s, last_s = bout[0][0] - settings.max_pause_s, bout[-1][1] + settings.max_pause_s
            sd_strokes = _sd_strokes(height[(end_s > first_s) & (start_s < last_s)], settings)
            found.append(Shake(np.array([s[0] for s in bout]), np.array([s[1] for s in bout]), sd_strokes))
    return found


def _sd_strokes(height: FloatArray, settings: ShakeSettings) -> float:
    """Deviation of the number of half waves that truly reach the limit, from heights known to `sd_stroke_m_s2`.

    Each is a stroke with the probability p of a logistic distribution of that deviation, and adds p (1 - p).
    """
    scale = settings.sd_stroke_m_s2 * math.sqrt(3.0) / math.pi
    odds = np.exp(-np.abs(height - settings.stroke_m_s2) / scale)
    return math.hypot(math.sqrt(float((odds / (1.0 + odds) ** 2).sum())), settings.min_sd_strokes)
