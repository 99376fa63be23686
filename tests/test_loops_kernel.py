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


@FORMS
def test_the_first_far_and_the_first_near_sample_are_found_either_way(kernel):
    points = np.array([[0.0, 0.5, 3.0, 0.0, 6.0], [0.0, 0.0, 4.0, 1.0, 8.0]])
    given = (points.data, 2)
    assert kernel.first_far(*given, 0, 0, 5, 1, 25.0) == 2
    assert kernel.first_far(*given, 0, 3, 5, 1, 25.0) == 4
    assert kernel.first_far(*given, 0, 3, -1, -1, 25.0) == 2
    assert kernel.first_far(*given, 0, 0, 2, 1, 25.0) == 2  # none: the stop
    assert kernel.first_near(*given, 0, 2, 5, 1, 1.0) == 3
    assert kernel.first_near(*given, 4, 3, -1, -1, 25.0) == 2
    assert kernel.first_near(*given, 4, 1, -1, -1, 1.0) == -1


def turns_of(kernel, values, least):
    turns = np.empty(values.size, dtype=np.intp)
    return turns[: kernel.turning_points(values.data, least, turns.data)].tolist()


@FORMS
def test_turns_are_the_highs_and_lows_that_are_far_enough_apart(kernel):
    assert turns_of(kernel, np.array([0.0, 2.0, 1.9, 3.0, 3.0, 0.0, 0.1, 1.0]), 0.5) == [0, 3, 5, 7]
    assert turns_of(kernel, np.array([1.0, 1.0, 1.1, 1.0]), 0.5) == [0]
    assert turns_of(kernel, np.array([0.0, -1.0, -3.0, -3.0]), 0.5) == [0, 2]


@FORMS
def test_turns_take_turns_and_each_is_the_extreme_between_its_neighbours(kernel):
    values = np.cumsum(np.random.default_rng(5).standard_normal(400))
    turns = turns_of(kernel, values, 2.0)
    assert len(turns) > 10
    rises = np.diff(values[turns])
    assert (np.abs(rises[1:]) >= 2.0).all()
    assert (np.sign(rises[1:]) != np.sign(rises[:-1])).all()
    for before, turn, after in zip(turns, turns[1:], turns[2:], strict=False):
        around = values[before : after + 1]
        assert values[turn] in (around.max(), around.min())


def integrals(kernel, time_s, values, at):
    found = np.empty((values.shape[1], at.size))
    total = np.zeros(values.shape[1])
    kernel.integrate(time_s.data, values.data, values.shape[1], at.data, total.data, found.data)
    return found


@FORMS
def test_integrals_are_those_of_the_straight_lines_at_the_samples_and_stay_beyond(kernel):
    rng = np.random.default_rng(6)
    time_s = np.cumsum(rng.uniform(0.005, 0.02, 60))
    values = rng.standard_normal((60, 2))
    wanted = np.array([[np.trapezoid(values[: k + 1, c], time_s[: k + 1]) for k in range(60)] for c in range(2)])
    np.testing.assert_allclose(integrals(kernel, time_s, values, time_s), wanted, atol=1e-14)
    at = np.array([time_s[0] - 1.0, *(0.25 * time_s[:-1] + 0.75 * time_s[1:]), time_s[-1] + 1.0])
    between = 0.25 * wanted[:, :-1] + 0.75 * wanted[:, 1:]
    found = integrals(kernel, time_s, values, at)
    np.testing.assert_allclose(found, np.column_stack([[0.0, 0.0], between, wanted[:, -1]]), atol=1e-14)


def straight(kernel, time_s, values, at):
    found = np.empty((values.shape[0], at.size))
    kernel.straight(time_s.data, values.data, at.data, found.data)
    return found


@FORMS
def test_straight_lines_are_numpys_to_the_bit(kernel):
    rng = np.random.default_rng(7)
    time_s = np.cumsum(rng.uniform(0.005, 0.02, 60))
    values = rng.standard_normal((2, 60))
    at = rng.permutation(np.concatenate([rng.uniform(-0.1, 1.5, 100), time_s]))
    found = straight(kernel, time_s, values, at)
    np.testing.assert_array_equal(found, [np.interp(at, time_s, row) for row in values])
    one = np.array([0.5])
    np.testing.assert_array_equal(straight(kernel, one, values[:, :1].copy(), at)[0], values[0, 0])


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
    walk = np.cumsum(rng.standard_normal(500))
    assert turns_of(compiled, walk, 1.5) == turns_of(as_python(), walk, 1.5)
    points = np.cumsum(rng.standard_normal((6, 200)), axis=1)
    for name in ("first_far", "first_near"):
        for first, stop, step in ((10, 200, 1), (180, -1, -1)):
            one, other = (getattr(k, name)(points.data, 6, 90, first, stop, step, 9.0) for k in (compiled, as_python()))
            assert one == other
    at = np.sort(rng.uniform(-0.1, 3.5, 200))
    samples = rng.standard_normal((300, 3))
    np.testing.assert_array_equal(*(integrals(k, time_s, samples, at) for k in (compiled, as_python())))
    rows, sums = np.ascontiguousarray(samples.T), np.empty(301)
    both = [np.empty((3, 300)) for _ in range(2)]
    for means, kernel in zip(both, (compiled, as_python()), strict=True):
        kernel.moving_means(rows.data, 20, 25, sums.data, means.data)
    np.testing.assert_array_equal(*both)
