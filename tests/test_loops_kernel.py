"""The compiled loops: against what they mean, and against their own Python form."""

from __future__ import annotations

import importlib.util
import itertools
from pathlib import Path

import numpy as np
import pytest

from inhalemon import _loops_kernel as compiled


def as_python():
    """The same source, run by Python whatever was compiled beside it."""
    path = Path(compiled.__file__).with_name("_loops_kernel.py")
    spec = importlib.util.spec_from_file_location("loops_kernel_as_python", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FORMS = pytest.mark.parametrize("kernel", [compiled, as_python()], ids=["as installed", "python"])


def interpolated(kernel, time_s, values, at):
    found, slope = np.empty((2, values.shape[0], at.size))
    place = np.empty(at.size, dtype=np.intp)
    kernel.interpolate(time_s.data, values.data, at.data, found.data, slope.data, place.data)
    return found, slope, place


@FORMS
def test_cubics_pass_through_the_samples_and_follow_a_line_exactly(kernel):
    rng = np.random.default_rng(1)
    time_s = np.cumsum(rng.uniform(0.005, 0.02, 50))
    line = np.stack([3.0 * time_s - 1.0, rng.standard_normal(50)])
    found, _, place = interpolated(kernel, time_s, line, time_s[1:-2])
    np.testing.assert_allclose(found, line[:, 1:-2], atol=1e-12)
    np.testing.assert_array_equal(place, np.arange(1, 48))
    at = rng.uniform(time_s[1], time_s[-2], 30)  # in no order
    found, slope, _ = interpolated(kernel, time_s, line, at)
    np.testing.assert_allclose(found[0], 3.0 * at - 1.0, atol=1e-12)
    np.testing.assert_allclose(slope[0], 3.0, atol=1e-9)


@FORMS
def test_the_slope_is_that_of_the_cubic(kernel):
    rng = np.random.default_rng(2)
    time_s = np.cumsum(rng.uniform(0.005, 0.02, 50))
    values = rng.standard_normal((3, 50))
    at = rng.uniform(time_s[1] + 1e-4, time_s[-2] - 1e-4, 40)
    _, slope, _ = interpolated(kernel, time_s, values, at)
    (before, _, _), (after, _, _) = (interpolated(kernel, time_s, values, at + step) for step in (-1e-7, 1e-7))
    np.testing.assert_allclose(slope, (after - before) / 2e-7, atol=2e-2)


@FORMS
def test_beyond_the_ends_the_place_stays_within(kernel):
    time_s = np.arange(4.0)
    _, _, place = interpolated(kernel, time_s, np.zeros((1, 4)), np.array([-5.0, 0.5, 1.5, 2.5, 9.0]))
    np.testing.assert_array_equal(place, 1)


@FORMS
def test_the_path_is_the_cheapest_of_all(kernel):
    rng = np.random.default_rng(3)
    for n in (1, 2, 5):
        costs, transitions = rng.uniform(0.0, 2.0, (n, 3)), rng.uniform(0.0, 1.0, (3, 3))
        path = np.empty(n, dtype=np.intp)
        kernel.cheapest_path(costs.copy().data, transitions.data, path.data)

        def price(labels, costs=costs, transitions=transitions):
            steps = sum(transitions[pair] for pair in itertools.pairwise(labels))
            return sum(costs[k, label] for k, label in enumerate(labels)) + steps

        assert tuple(path.tolist()) == min(itertools.product(range(3), repeat=n), key=price)


def test_compiled_loops_equal_their_python_form_to_the_bit():
    rng = np.random.default_rng(4)
    time_s = np.cumsum(rng.uniform(0.005, 0.02, 300))
    values, at = rng.standard_normal((3, 300)), np.sort(rng.uniform(-0.1, 3.5, 200))
    for one, other in zip(
        interpolated(compiled, time_s, values, at), interpolated(as_python(), time_s, values, at), strict=True
    ):
        np.testing.assert_array_equal(one, other)
    costs, transitions = rng.uniform(0.0, 2.0, (100, 11)), rng.uniform(0.0, 1.0, (11, 11))
    known = []
    for kernel in (compiled, as_python()):
        totals, path = costs.copy(), np.empty(100, dtype=np.intp)
        kernel.cheapest_path(totals.data, transitions.data, path.data)
        known.append((totals, path))
    np.testing.assert_array_equal(known[0][0], known[1][0])
    np.testing.assert_array_equal(known[0][1], known[1][1])
