"""The heading filter, block by block: plain Python that Cython compiles when there is a C compiler.

`_heading_kernel.pxd` gives the C types. What the filter does and why is told in `hinge.py` and docs/method.md.
"""

from __future__ import annotations

import math
from math import remainder, sqrt

_WHOLE_TURN = 2.0 * math.pi


def filter_heading(
    step_s: memoryview[float],
    measured_rad: memoryview[float],
    shown: memoryview[float],
    scatter_rad2: memoryview[float],
    start_rad: float,
    start_var: float,
    rate_var: float,
    walk_var: float,
    min_shown: float,
    max_surprise: float,
    told: memoryview[float],
    known: memoryview[float],
) -> None:
    """Writes offset, rate and the variances 00, 01, 11 of every block, (m, 5): `told` before, `known` after its say."""
    x = start_rad
    rate = 0.0
    p00 = start_var
    p01 = 0.0
    p11 = rate_var
    for i in range(len(step_s)):
        dt = step_s[i]
        x += dt * rate
        p00 += dt * (2.0 * p01 + dt * p11) + walk_var * dt * dt * dt / 3.0
        p01 += dt * p11 + walk_var * dt * dt / 2.0
        p11 += walk_var * dt
        told[i, 0] = x
        told[i, 1] = rate
        told[i, 2] = p00
        told[i, 3] = p01
        told[i, 4] = p11
        if shown[i] > min_shown:
            surprise = remainder(measured_rad[i] - x, _WHOLE_TURN)
            variance = scatter_rad2[i] / shown[i]
            # Huber's weight: a block far off its forecast pulls no harder than one at the limit.
            excess = abs(surprise) / (max_surprise * sqrt(p00 + variance))
            if excess > 1.0:
                variance *= excess
            gain = p00 / (p00 + variance)
            gain_rate = p01 / (p00 + variance)
            x += gain * surprise
            rate += gain_rate * surprise
            p11 -= gain_rate * p01
            p01 -= gain * p01
            p00 -= gain * p00
        known[i, 0] = x
        known[i, 1] = rate
        known[i, 2] = p00
        known[i, 3] = p01
        known[i, 4] = p11


def smooth_heading(step_s: memoryview[float], told: memoryview[float], known: memoryview[float]) -> None:
    """Rauch, Tung and Striebel's backward pass, in place on `known`."""
    for i in range(len(step_s) - 2, -1, -1):
        dt = step_s[i + 1]
        p00 = known[i, 2]
        p01 = known[i, 3]
        p11 = known[i, 4]
        t00 = told[i + 1, 2]
        t01 = told[i + 1, 3]
        t11 = told[i + 1, 4]
        determinant = t00 * t11 - t01 * t01
        a = p00 + dt * p01
        c = p01 + dt * p11
        g00 = (a * t11 - p01 * t01) / determinant
        g01 = (p01 * t00 - a * t01) / determinant
        g10 = (c * t11 - p11 * t01) / determinant
        g11 = (p11 * t00 - c * t01) / determinant
        dx = known[i + 1, 0] - told[i + 1, 0]
        drate = known[i + 1, 1] - told[i + 1, 1]
        e00 = known[i + 1, 2] - t00
        e01 = known[i + 1, 3] - t01
        e11 = known[i + 1, 4] - t11
        known[i, 0] += g00 * dx + g01 * drate
        known[i, 1] += g10 * dx + g11 * drate
        known[i, 2] = p00 + g00 * g00 * e00 + 2.0 * g00 * g01 * e01 + g01 * g01 * e11
        known[i, 3] = p01 + g00 * g10 * e00 + (g00 * g11 + g01 * g10) * e01 + g01 * g11 * e11
        known[i, 4] = p11 + g10 * g10 * e00 + 2.0 * g10 * g11 * e01 + g11 * g11 * e11
