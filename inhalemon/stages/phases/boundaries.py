"""From the windows' labels to phases."""

from __future__ import annotations

import itertools

import numpy as np

from inhalemon.stages.phases.evidence import Evidence, Masks
from inhalemon.stages.phases.order import LABELS
from inhalemon.stages.phases.windows import Windows
from inhalemon.values import FloatArray, IntArray, Motion, Phase


def phases_of(motion: Motion, evidence: Evidence, labels: IntArray, *, refine_s: float) -> tuple[Phase, ...]:
    """Windows' labels (m,) as phases; their boundaries are those of the candidates within `refine_s`, at full rate."""
    per_sample = np.repeat(labels, np.diff(evidence.windows.edges))
    per_sample = _refined(per_sample, evidence.masks, round(refine_s * motion.rate_hz))
    return _as_phases(motion, per_sample, evidence.costs, evidence.windows)


def _refined(labels: IntArray, masks: Masks, reach: int) -> IntArray:
    """Each boundary between two labels moved to the nearby sample where their own evidence changes."""
    refined = labels.copy()
    changes = np.flatnonzero(np.diff(labels)) + 1
    for at in changes.tolist():
        low, high = max(at - reach, 0), min(at + reach, labels.size)
        gain = masks[labels[at], low:high] - masks[labels[at - 1], low:high]
        # The boundary b maximises the evidence for `after` from b on, and for `before` up to b.
        from_here = np.zeros(gain.size + 1)
        from_here[:-1] = gain[::-1].cumsum()[::-1]
        best = low + int(np.argmax(from_here - 1e-6 * np.abs(np.arange(low, high + 1) - at)))
        if best < at:
            refined[best:at] = labels[at]
        else:
            refined[at:best] = labels[at - 1]
    return refined


def _as_phases(motion: Motion, labels: IntArray, costs: FloatArray, windows: Windows) -> tuple[Phase, ...]:
    edges = np.array([0, *(np.flatnonzero(np.diff(labels)) + 1), labels.size])
    first_windows = windows.edges.searchsorted(edges[:-1], side="right") - 1
    last_windows = np.maximum(windows.edges.searchsorted(edges[1:]), first_windows + 1)
    stretches = zip(itertools.pairwise(edges.tolist()), first_windows.tolist(), last_windows.tolist(), strict=True)
    lowest, next_lowest = np.partition(costs, 1, axis=1)[:, :2].T
    other = np.where(costs <= lowest[:, None], next_lowest[:, None], lowest[:, None])
    surety = 1.0 / (1.0 + np.exp(costs - other))
    phases = []
    for (start, end), first, last in stretches:
        kind = LABELS[labels[start]]
        confidence = float(surety[first:last, labels[start]].sum()) / (last - first)
        phases.append(Phase(kind, motion.edge_s(start), motion.edge_s(end), round(confidence, 3)))
    return tuple(phases)
