"""Quaternion algebra against scipy's Rotation, an independent implementation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from inhalemon import rotation

vectors = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3).map(np.array)
quaternions = vectors.map(rotation.from_rotation_vector)


def scipy_of(q: np.ndarray) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


@given(quaternions, quaternions, vectors)
def test_product_and_rotation_agree_with_scipy(p, q, v):
    np.testing.assert_allclose(
        rotation.rotate(rotation.multiply(p, q), v), (scipy_of(p) * scipy_of(q)).apply(v), atol=1e-12
    )
    np.testing.assert_allclose(rotation.as_matrix(q), scipy_of(q).as_matrix(), atol=1e-12)


@given(vectors)
def test_rotation_vector_survives_the_round_trip(v):
    back = rotation.to_rotation_vector(rotation.from_rotation_vector(v))
    np.testing.assert_allclose(scipy_of(rotation.from_rotation_vector(v)).as_rotvec(), back, atol=1e-9)


@given(vectors, vectors)
def test_two_vectors_give_the_rotation_between_them(a, b):
    if min(np.linalg.norm(a), np.linalg.norm(b)) < 1e-3:
        return
    turned = rotation.rotate(rotation.from_two_vectors(a, b), b)
    np.testing.assert_allclose(turned / np.linalg.norm(turned), a / np.linalg.norm(a), atol=1e-6)


@pytest.mark.parametrize("v", [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
def test_opposite_vectors_are_half_a_turn_apart(v):
    v = np.array(v)
    np.testing.assert_allclose(rotation.rotate(rotation.from_two_vectors(-v, v), v), -v, atol=1e-12)


@given(st.floats(-3.1, 3.1), st.floats(-1.0, 1.0))
def test_twist_about_the_hinge_is_told_from_the_rest(twist, swing):
    hinge = np.array([1.0, 0.0, 0.0])
    q = rotation.multiply(
        rotation.from_rotation_vector(np.array([0.0, swing, 0.0])), rotation.from_rotation_vector(twist * hinge)
    )
    found_twist, found_swing = rotation.split_twist(q, hinge)
    np.testing.assert_allclose([found_twist, found_swing], [twist, abs(swing)], atol=1e-9)


@given(quaternions)
def test_tilt_is_the_angle_between_the_two_up_axes(q):
    up = rotation.rotate(q, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(np.cos(rotation.tilt_from_upright(q)), up[2], atol=1e-12)


@given(quaternions)
def test_the_sources_matrix_is_our_body_ref(q):
    """Equation (13) of the source, written out from its text, against our matrix: it takes ref to body."""
    q1, q2, q3, q4 = rotation.to_source(q)
    source_a = np.array(
        [
            [q1**2 - q2**2 - q3**2 + q4**2, 2 * (q1 * q2 + q3 * q4), 2 * (q1 * q3 - q2 * q4)],
            [2 * (q1 * q2 - q3 * q4), -(q1**2) + q2**2 - q3**2 + q4**2, 2 * (q2 * q3 + q1 * q4)],
            [2 * (q1 * q3 + q2 * q4), 2 * (q2 * q3 - q1 * q4), -(q1**2) - q2**2 + q3**2 + q4**2],
        ]
    )
    np.testing.assert_allclose(source_a, rotation.as_matrix(rotation.conjugate(q)), atol=1e-12)
    np.testing.assert_allclose(rotation.from_source(rotation.to_source(q)), q)


def test_many_at_once_are_the_same_as_one_by_one():
    rng = np.random.default_rng(3)
    p, q = rng.standard_normal((2, 5, 4)), rng.standard_normal((5, 4))
    v = rng.standard_normal((2, 5, 3))
    each = [(i, j) for i in range(2) for j in range(5)]
    for i, j in each:
        np.testing.assert_array_equal(rotation.multiply(p, q)[i, j], rotation.multiply(p[i, j], q[j]))
        np.testing.assert_array_equal(rotation.multiply(q, p[i, j])[j], rotation.multiply(q[j], p[i, j]))
        np.testing.assert_array_equal(rotation.rotate(p, v)[i, j], rotation.rotate(p[i, j], v[i, j]))
        np.testing.assert_array_equal(rotation.as_matrix(p)[i, j], rotation.as_matrix(p[i, j]))
        np.testing.assert_array_equal(rotation.up_in(p)[i, j], rotation.up_in(p[i, j]))
        np.testing.assert_allclose(rotation.normalise(p)[i, j], p[i, j] / np.linalg.norm(p[i, j]), rtol=1e-15)


@given(quaternions, vectors, st.floats(0.0, 1.0), st.sampled_from([1.0, -1.0]))
def test_interpolation_goes_a_share_of_the_shorter_way(p, turn, share, sign):
    turn = turn * min(1.0, 3.0 / max(np.linalg.norm(turn), 1e-9))  # less than half a turn: one way is shorter
    q = sign * rotation.multiply(p, rotation.from_rotation_vector(turn))
    there = rotation.slerp(p[None], q[None], np.array([share]))[0]
    wanted = rotation.multiply(p, rotation.from_rotation_vector(share * turn))
    assert rotation.angle_between(there, wanted) < 1e-7


@given(quaternions, st.floats(-7.0, 7.0))
def test_turning_about_the_vertical_is_a_product(q, angle_rad):
    turned = rotation.multiply(rotation.about_z(angle_rad), q)
    np.testing.assert_allclose(rotation.turned_about_z(angle_rad, q), turned, atol=1e-15)


@given(quaternions)
def test_heading_is_that_of_the_turned_y(q):
    x, y, _ = scipy_of(q).apply([0.0, 1.0, 0.0])
    along = np.hypot(x, y)
    found = rotation.heading_of_y(q[None])[0]
    np.testing.assert_allclose(along * np.array([np.cos(found), np.sin(found)]), [x, y], atol=1e-9)
