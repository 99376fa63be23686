"""Loops over samples and windows that no array operation makes: plain Python that Cython compiles when it can.

`_loops_kernel.pxd` gives the C types. Who calls them tells what they are for.
"""

from __future__ import annotations


def interpolate(
    time_s: memoryview[float],
    values: memoryview[float],
    at_s: memoryview[float],
    found: memoryview[float],
    slope: memoryview[float],
    place: memoryview[int],
) -> None:
    """Cubics between samples (Catmull-Rom, uneven times): `values` (k, n) at other times, (k, m), with their slopes.

    `place` (m,) is the sample before each time, from 1 to n - 3: the first and the last step have no neighbours, and
    what lies there or beyond is drawn out from the next. At least four samples; quick when the times are in order.
    """
    last = len(time_s) - 3
    j = 1
    for i in range(len(at_s)):
        at = at_s[i]
        while j < last and time_s[j + 1] <= at:
            j += 1
        while j > 1 and time_s[j] > at:
            j -= 1
        h = time_s[j + 1] - time_s[j]
        share_0 = h / (time_s[j + 1] - time_s[j - 1])
        share_1 = h / (time_s[j + 2] - time_s[j])
        u = (at - time_s[j]) / h
        for k in range(len(values)):
            rise = values[k, j + 1] - values[k, j]
            tangent_0 = (values[k, j + 1] - values[k, j - 1]) * share_0
            tangent_1 = (values[k, j + 2] - values[k, j]) * share_1
            c_2 = 3.0 * rise - 2.0 * tangent_0 - tangent_1
            c_3 = tangent_0 + tangent_1 - 2.0 * rise
            found[k, i] = values[k, j] + u * (tangent_0 + u * (c_2 + u * c_3))
            slope[k, i] = (tangent_0 + u * (2.0 * c_2 + 3.0 * u * c_3)) / h
        place[i] = j


def cheapest_path(totals: memoryview[float], transitions: memoryview[float], path: memoryview[int]) -> None:
    """The labels (m,) on the path of least cost through `totals` (m, k), which become the costs of the paths so far.

    `transitions` (k, k) is what it costs to go from one label (row) to the next (column). Viterbi (1967).
    """
    n = len(totals)
    n_labels = len(transitions)
    for i in range(1, n):
        for label in range(n_labels):
            least = totals[i - 1, 0] + transitions[0, label]
            for before in range(1, n_labels):
                cost = totals[i - 1, before] + transitions[before, label]
                least = min(least, cost)
            totals[i, label] += least
    best = 0
    for label in range(1, n_labels):
        if totals[n - 1, label] < totals[n - 1, best]:
            best = label
    path[n - 1] = best
    for i in range(n - 2, -1, -1):
        after = best
        best = 0
        for before in range(1, n_labels):
            if totals[i, before] + transitions[before, after] < totals[i, best] + transitions[best, after]:
                best = before
        path[i] = best
