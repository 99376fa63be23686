"""Phases and events against labelled ones: which belong together, and how far their boundaries are off."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from inhalemon.values import Event, Phase

MATCH_WITHIN_S = 0.5  # an event further from the labelled end stop than this is another event


@dataclass(frozen=True, slots=True)
class Spread:
    """How a set of errors (report less label) is spread."""

    n: int
    bias: float
    median_abs: float
    p95_abs: float
    max_abs: float


@dataclass(frozen=True, slots=True)
class Boundaries:
    """One kind of phase or event over all sessions; errors in seconds, over the matched ones."""

    n_labelled: int
    n_reported: int
    n_matched: int
    f1: float | None
    start_s: Spread | None
    end_s: Spread | None


def spread(errors: Iterable[float]) -> Spread | None:
    """Bias, median, 95th percentile and maximum of the errors' size; `None` without errors."""
    found = np.fromiter(errors, dtype=np.float64)
    if not found.size:
        return None
    size = np.abs(found)
    return Spread(
        n=int(found.size),
        bias=float(found.mean()),
        median_abs=float(np.median(size)),
        p95_abs=float(np.percentile(size, 95)),
        max_abs=float(size.max()),
    )


def boundaries(pairs: Sequence[tuple[Phase | Event, Phase | Event]], n_labelled: int, n_reported: int) -> Boundaries:
    """Boundary errors of matched (labelled, reported) pairs, and the F1 of finding them at all."""
    total = n_labelled + n_reported
    return Boundaries(
        n_labelled=n_labelled,
        n_reported=n_reported,
        n_matched=len(pairs),
        f1=2 * len(pairs) / total if total else None,
        start_s=spread(reported.start_s - labelled.start_s for labelled, reported in pairs),
        end_s=spread(reported.end_s - labelled.end_s for labelled, reported in pairs),
    )


def match_phases(
    labelled: Sequence[Phase], reported: Sequence[Phase], *, min_overlap: float = 0.0
) -> list[tuple[Phase, Phase]]:
    """Pairs of one kind that share more than `min_overlap` of their union, the best overlap first, each used once."""
    candidates = []
    for i, a in enumerate(labelled):
        for j, b in enumerate(reported):
            shared = _shared_s(a, b)
            if a.kind == b.kind and shared > 0.0:
                overlap = shared / (max(a.end_s, b.end_s) - min(a.start_s, b.start_s))
                if overlap > min_overlap:
                    candidates.append((-overlap, i, j))
    return [(labelled[i], reported[j]) for i, j in _best_first(candidates)]


def match_events(labelled: Sequence[Event], reported: Sequence[Event]) -> list[tuple[Event, Event]]:
    """Pairs of one kind whose end stops lie within `MATCH_WITHIN_S`, the nearest first, each used once."""
    candidates = [
        (abs(b.peak_s - a.peak_s), i, j)
        for i, a in enumerate(labelled)
        for j, b in enumerate(reported)
        if a.kind == b.kind and abs(b.peak_s - a.peak_s) <= MATCH_WITHIN_S
    ]
    return [(labelled[i], reported[j]) for i, j in _best_first(candidates)]


def agreed_s(labelled: Sequence[Phase], reported: Sequence[Phase]) -> float:
    """Seconds over which both name the same phase: frame accuracy times the labelled time, without a frame."""
    return sum(_shared_s(a, b) for a in labelled for b in reported if a.kind == b.kind)


def _shared_s(a: Phase, b: Phase) -> float:
    return max(0.0, min(a.end_s, b.end_s) - max(a.start_s, b.start_s))


def _best_first(candidates: list[tuple[float, int, int]]) -> list[tuple[int, int]]:
    chosen: list[tuple[int, int]] = []
    for _, i, j in sorted(candidates):
        if all(i != taken_i and j != taken_j for taken_i, taken_j in chosen):
            chosen.append((i, j))
    return sorted(chosen)
