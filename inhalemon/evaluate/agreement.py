"""Agreement of two yes/no judgements, from the four counts."""

from __future__ import annotations

import math
from dataclasses import dataclass

from inhalemon.values import TWO_SIDED_95

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Agreement:
    """Counts of one judgement against another taken as truth, and what follows from them; `None` is undefined."""

    tp: int
    fp: int
    fn: int
    tn: int
    precision: float | None
    recall: float | None  # sensitivity
    specificity: float | None
    f1: float | None
    f1_interval: Interval | None  # 95 %
    kappa: float | None
    kappa_interval: Interval | None  # 95 %


def agreement(tp: int, fp: int, fn: int, tn: int) -> Agreement:
    """Precision, recall, specificity, F1 and Cohen's kappa with 95 % intervals.

    F1: Wilson's interval for tp / (tp + fp + fn), carried over by F1 = 2 j / (1 + j), so that it neither leaves [0, 1]
    nor shrinks to nothing when all agree (Lam, Gopal and Qian 2023, arXiv:2309.14621, "Wilson indirect").
    Kappa: Cohen (1960), doi 10.1177/001316446002000104, with the large-sample deviation of Fleiss, Cohen and
    Everitt (1969), doi 10.1037/h0028106; its interval does shrink to nothing when all agree.
    """
    f1, f1_interval = _f1(tp, fp, fn)
    kappa, kappa_interval = _kappa(tp, fp, fn, tn)
    return Agreement(
        tp=tp,
        fp=fp,
        fn=fn,
        tn=tn,
        precision=_ratio(tp, tp + fp),
        recall=_ratio(tp, tp + fn),
        specificity=_ratio(tn, tn + fp),
        f1=f1,
        f1_interval=f1_interval,
        kappa=kappa,
        kappa_interval=kappa_interval,
    )


def wilson_interval(hits: int, n: int) -> Interval:
    """Wilson's (1927) 95 % interval of a proportion, doi 10.1080/01621459.1927.10502953; `n` is at least 1."""
    p = hits / n
    z2_n = TWO_SIDED_95 * TWO_SIDED_95 / n
    centre = (p + z2_n / 2) / (1 + z2_n)
    half = TWO_SIDED_95 / (1 + z2_n) * math.sqrt(p * (1 - p) / n + z2_n / (4 * n))
    low = 0.0 if hits == 0 else max(0.0, centre - half)
    high = 1.0 if hits == n else min(1.0, centre + half)
    return low, high


def _f1(tp: int, fp: int, fn: int) -> tuple[float | None, Interval | None]:
    n = tp + fp + fn
    if n == 0:
        return None, None
    low, high = wilson_interval(tp, n)
    return 2 * tp / (2 * tp + fp + fn), (2 * low / (1 + low), 2 * high / (1 + high))


def _kappa(tp: int, fp: int, fn: int, tn: int) -> tuple[float | None, Interval | None]:
    n = tp + fp + fn + tn
    if n == 0:
        return None, None
    p = ((tp / n, fn / n), (fp / n, tn / n))  # truth by row, judgement by column, "yes" first
    row = [sum(p[i]) for i in (0, 1)]
    column = [p[0][i] + p[1][i] for i in (0, 1)]
    observed = p[0][0] + p[1][1]
    expected = row[0] * column[0] + row[1] * column[1]
    if math.isclose(expected, 1.0):  # both say always the same one thing: chance explains everything
        return None, None
    kappa = (observed - expected) / (1 - expected)
    spread = sum(p[i][i] * ((1 - expected) - (row[i] + column[i]) * (1 - observed)) ** 2 for i in (0, 1))
    spread += (1 - observed) ** 2 * sum(p[i][1 - i] * (column[i] + row[1 - i]) ** 2 for i in (0, 1))
    spread -= (observed * expected - 2 * expected + observed) ** 2
    half = TWO_SIDED_95 * math.sqrt(max(0.0, spread) / n) / (1 - expected) ** 2
    return kappa, (max(-1.0, kappa - half), min(1.0, kappa + half))


def _ratio(part: int, whole: int) -> float | None:
    return part / whole if whole else None
