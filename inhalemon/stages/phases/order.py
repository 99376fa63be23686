"""The cheapest path over the labels of neighbouring windows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from inhalemon import _loops_kernel as kernel
from inhalemon.settings import PhaseSettings
from inhalemon.signals import memory
from inhalemon.values import FloatArray, IntArray, PhaseKind

LABELS = tuple(PhaseKind)

# Steps that make sense only right after another one: never entered from anywhere else.
_ONLY_AFTER = {
    PhaseKind.BREATH_HOLD: (PhaseKind.INHALE,),
    PhaseKind.EXHALE_AFTER: (PhaseKind.BREATH_HOLD,),
}
_NEVER = 1e6


def transition_costs(steps: Sequence[PhaseKind], settings: PhaseSettings) -> FloatArray:
    """What it costs to go from one label (row) to another: nothing to stay, more to leave the device's order."""
    rank = {step: k for k, step in enumerate(steps)}
    costs = np.full((len(LABELS), len(LABELS)), settings.cost_change)
    for i, before in enumerate(LABELS):
        for j, after in enumerate(LABELS):
            if i == j:
                costs[i, j] = 0.0
            elif after in _ONLY_AFTER and before not in _ONLY_AFTER[after]:
                costs[i, j] = _NEVER
            elif before in rank and after in rank:
                ahead = rank[after] - rank[before]
                costs[i, j] += settings.cost_skip * (ahead - 1) if ahead > 0 else settings.cost_back
    return costs


def cheapest_path(costs: FloatArray, transitions: FloatArray) -> IntArray:
    """The label (m,) of each window on the path of least cost; `costs` is (m, labels). Viterbi (1967)."""
    totals = np.array(costs)  # a copy: of the cheapest path to each label, window by window
    path = np.empty(costs.shape[0], dtype=np.intp)
    kernel.cheapest_path(memory(totals), memory(transitions), path.data)
    return path.astype(np.int64)
