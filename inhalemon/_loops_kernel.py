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


def first_far(
    points: memoryview[float], n_columns: int, here: int, first: int, stop: int, step: int, square: float
) -> int:
    """The first of `points` (columns, n), from `first` by `step`, at least so far (squared) from the one `here`.

    `stop`, which is not looked at, when there is none.
    """
    for i in range(abs(stop - first)):
        row = first + i * step
        apart = 0.0
        for k in range(n_columns):
            apart += (points[k, row] - points[k, here]) * (points[k, row] - points[k, here])
        if apart >= square:
            return row
    return stop


def first_near(
    points: memoryview[float], n_columns: int, here: int, first: int, stop: int, step: int, square: float
) -> int:
    """The same, at most so far."""
    for i in range(abs(stop - first)):
        row = first + i * step
        apart = 0.0
        for k in range(n_columns):
            apart += (points[k, row] - points[k, here]) * (points[k, row] - points[k, here])
        if apart <= square:
            return row
    return stop


def turning_points(values: memoryview[float], least: float, turns: memoryview[int]) -> int:
    """Writes the samples at which `values` (n,) turns for good, and returns how many; `turns` has room for n.

    Lows and highs take turns, each at least `least` from the one before; the first sample and the last turn are there.
    """
    turns[0] = 0
    n_turns = 1
    low = 0
    high = 0
    direction = 0
    for i in range(len(values)):
        if direction >= 0 and values[i] > values[high]:
            high = i
        if direction <= 0 and values[i] < values[low]:
            low = i
        if direction >= 0 and values[high] - values[i] >= least:
            if high > turns[n_turns - 1]:
                turns[n_turns] = high
                n_turns += 1
            direction = -1
            low = i
        elif direction <= 0 and values[i] - values[low] >= least:
            if low > turns[n_turns - 1]:
                turns[n_turns] = low
                n_turns += 1
            direction = 1
            high = i
    last = 0
    if direction > 0:
        last = high
    if direction < 0:
        last = low
    if last > turns[n_turns - 1]:
        turns[n_turns] = last
        n_turns += 1
    return n_turns


def integrate(
    time_s: memoryview[float],
    values: memoryview[float],
    n_columns: int,
    at_s: memoryview[float],
    total: memoryview[float],
    found: memoryview[float],
) -> None:
    """The integrals of `values` (n, columns), straight between samples, up to increasing times: `found` (columns, m).

    Between two samples the integral itself is straight, beyond the ends it stays. `total` (columns,) begins with zeros.
    """
    last = len(time_s) - 1
    j = 0
    for i in range(len(at_s)):
        while j < last and time_s[j + 1] <= at_s[i]:
            for k in range(n_columns):
                total[k] += (values[j + 1, k] + values[j, k]) / 2.0 * (time_s[j + 1] - time_s[j])
            j += 1
        since = 0.0
        if j < last and at_s[i] > time_s[j]:
            since = at_s[i] - time_s[j]
        for k in range(n_columns):
            found[k, i] = total[k]
            if since > 0.0:
                found[k, i] += (values[j + 1, k] + values[j, k]) / 2.0 * since


def moving_means(
    values: memoryview[float], before: int, after: int, sums: memoryview[float], means: memoryview[float]
) -> None:
    """Means of each row of `values` (k, n) over `before` samples and `after` from each on, or what is there of them.

    `sums` (n + 1,) is used on the way.
    """
    n = len(sums) - 1
    sums[0] = 0.0
    for k in range(len(values)):
        for i in range(n):
            sums[i + 1] = sums[i] + values[k, i]
        for i in range(min(before, n)):
            means[k, i] = sums[min(i + after, n)] / min(i + after, n)
        for i in range(before, n - after):
            means[k, i] = (sums[i + after] - sums[i - before]) / (before + after)
        for i in range(max(n - after, before), n):
            means[k, i] = (sums[n] - sums[i - before]) / (n - i + before)


def straight(
    time_s: memoryview[float], values: memoryview[float], at_s: memoryview[float], found: memoryview[float]
) -> None:
    """`values` (k, n) at other times, (k, m), straight between samples, as `numpy.interp` gives them.

    Quick when the times are in order.
    """
    last = len(time_s) - 1
    j = 0
    for i in range(len(at_s)):
        at = at_s[i]
        while j < last and time_s[j + 1] <= at:
            j += 1
        while j > 0 and time_s[j] > at:
            j -= 1
        if j == last or at <= time_s[j]:
            for k in range(len(values)):
                found[k, i] = values[k, j]
        else:
            for k in range(len(values)):
                slope = (values[k, j + 1] - values[k, j]) / (time_s[j + 1] - time_s[j])
                found[k, i] = slope * (at - time_s[j]) + values[k, j]
