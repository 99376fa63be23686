"""Which samples met the end of the sensor's range; looked for on the chip's own axes, before any rotation."""

from __future__ import annotations

import numpy as np

from inhalemon.values import BoolArray, FloatArray

# A value within 1 % of the range is at its end: offsets and scale were often taken out after clipping.
_NEAR_RANGE = 0.99
# Flat tops: at least so many equal samples in a row at the very largest value, away from where a still sensor sits.
_FLAT_RUN = 3
MIN_FLAT_ACC_M_S2 = 14.0
MIN_FLAT_GYR_RAD_S = 1.5


def saturated(values: FloatArray, full_range: float | None, *, min_flat: float) -> BoolArray:
    """True where any axis is saturated; `values` (n, 3), `full_range` in the same unit or `None` when unknown.

    A flat top at the largest value (three equal samples or more, beyond `min_flat`) counts with a known range too:
    some chips clip elsewhere than at the range they are sold by.
    """
    is_saturated = np.zeros(len(values), dtype=np.bool_)
    for column in np.ascontiguousarray(values.T):
        for extreme, sign in ((column.max(), 1.0), (column.min(), -1.0)):
            if full_range is not None and sign * extreme >= _NEAR_RANGE * full_range:
                is_saturated |= sign * column >= _NEAR_RANGE * full_range
            if sign * extreme > min_flat:
                at_extreme = column == extreme
                if _has_run(at_extreme, _FLAT_RUN):
                    is_saturated |= at_extreme
    return is_saturated


def _has_run(is_true: BoolArray, length: int) -> bool:
    positions = np.flatnonzero(is_true)
    return bool((positions[length - 1 :] - positions[: 1 - length] == length - 1).any())
