"""Shaking, stroke by stroke, against accelerations in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import G_M_S2, scored, still

from inhalemon.stages.shakes import find_shakes
from inhalemon.values import Motion

UP = (0.0, 0.0, 1.0)


def shaken(*bouts: tuple[float, float], peak_g: float = 2.0, along=UP, stroke_hz: float = 4.0) -> Motion:
    """Ten seconds with sines of acceleration: (start_s, cycles) each."""
    motion = still(10.0)
    acc = np.zeros(motion.time_s.size)
    for start_s, cycles in bouts:
        since = motion.time_s - start_s
        is_on = (since >= 0.0) & (since < cycles / stroke_hz)
        acc += np.where(is_on, peak_g * G_M_S2 * np.sin(2 * np.pi * stroke_hz * since), 0.0)
    return replace(motion, acc_ref_m_s2=acc[:, None] * np.array(along))


def test_every_stroke_of_a_shake_is_counted_where_it_is():
    """Twelve cycles at 4 Hz: 24 half waves in 3 s; to two samples, because a half wave begins between two."""
    (shake,) = find_shakes(shaken((2.0, 12)))
    assert shake.stroke_end_s.size == 24
    assert shake.start_s == pytest.approx(2.0, abs=0.02)
    assert shake.end_s == pytest.approx(5.0, abs=0.02)


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1))
@settings(max_examples=20, deadline=None)
def test_the_direction_of_shaking_does_not_matter(direction):
    along = np.array(direction) / np.linalg.norm(direction)
    (shake,) = find_shakes(shaken((2.0, 8), along=along))
    assert shake.stroke_end_s.size == 16


@given(st.floats(2.5, 7.0), st.floats(0.02, 0.1))
@settings(max_examples=20, deadline=None)
def test_the_pace_and_reach_of_a_hand_do_not_matter(stroke_hz, reach_m):
    """Strokes of 1 to 4 g; the last half wave may end between two samples."""
    peak_g = min(max((2 * np.pi * stroke_hz) ** 2 * reach_m / G_M_S2, 1.0), 4.0)
    (shake,) = find_shakes(shaken((2.0, 8), peak_g=peak_g, stroke_hz=stroke_hz))
    assert abs(shake.stroke_end_s.size - 16) <= 1


@pytest.mark.parametrize(
    ("motion", "why"),
    [
        (shaken(), "nothing moves"),
        (shaken((2.0, 12), peak_g=0.5), "strokes below 0.6 g"),
        (shaken((2.0, 1.5)), "three strokes are bumps"),
        (shaken((2.0, 6), stroke_hz=25.0), "a bump that rings"),
        (shaken((2.0, 0.5), (4.0, 0.5), (6.0, 0.5), (8.0, 0.5)), "single bumps"),
    ],
)
def test_what_is_no_shake_is_none(motion, why):
    assert find_shakes(motion) == (), why


def test_a_short_pause_belongs_to_a_shake_and_a_long_one_ends_it():
    assert len(find_shakes(shaken((1.0, 6), (2.9, 6)))) == 1  # 0.4 s between them
    assert len(find_shakes(shaken((1.0, 6), (4.0, 6)))) == 2  # 1.5 s


@pytest.mark.parametrize("profile", ["typical", "harsh"])
@pytest.mark.parametrize("seed", [31, 32])
def test_simulated_shaking_lasts_as_long_as_it_was_acted(seed, profile):
    """To a stroke: the first and last of a bout swell and fade."""
    report, truth = scored("pmdi", seed=seed, profile=profile)
    assert report.measures["shake_duration_s"].value == pytest.approx(truth.measures["shake_duration_s"], abs=0.3)
    assert report.measures["shake_cycles"].value == pytest.approx(truth.measures["shake_cycles"], abs=1.0)


def test_the_count_of_clear_strokes_is_surer_than_of_those_that_hardly_reach_the_limit():
    """Strokes of 2 g are counted to a tenth; of 16 at 0.6 g, each is one or not: sqrt(16 / 4)."""
    (clear,) = find_shakes(shaken((2.0, 8)))
    (marginal,) = find_shakes(shaken((2.0, 8), peak_g=0.63))
    assert clear.sd_strokes == pytest.approx(0.1, abs=0.02)
    assert marginal.sd_strokes == pytest.approx(2.0, abs=0.3)
