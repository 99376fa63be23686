"""The source's filter: its convention proved against scipy's rotations, its equations against numpy, word for word."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from inhalemon.rotation import from_source, to_source
from inhalemon.settings import AttitudeSettings
from inhalemon.stages.attitude import estimate_attitude
from inhalemon.values import ImuTrack

G = 9.80665
SETTINGS = AttitudeSettings(method="akf_source", source_window_n=20)


def source_a(q):
    """(13)."""
    q1, q2, q3, q4 = q
    return np.array(
        [
            [q1**2 - q2**2 - q3**2 + q4**2, 2 * (q1 * q2 + q3 * q4), 2 * (q1 * q3 - q2 * q4)],
            [2 * (q1 * q2 - q3 * q4), -(q1**2) + q2**2 - q3**2 + q4**2, 2 * (q2 * q3 + q1 * q4)],
            [2 * (q1 * q3 + q2 * q4), 2 * (q2 * q3 - q1 * q4), -(q1**2) - q2**2 + q3**2 + q4**2],
        ]
    )


def source_h(q):
    """(9)."""
    q1, q2, q3, q4 = q
    return G * np.array([2 * (q1 * q3 - q2 * q4), 2 * (q2 * q3 + q1 * q4), -(q1**2) - q2**2 + q3**2 + q4**2])


def source_angles(q):
    """(14), with atan2 for arctan: the one departure, without which the angles fold at 90 degrees."""
    q1, q2, q3, q4 = q
    return np.array(
        [
            np.arctan2(2 * (q2 * q3 + q1 * q4), -(q1**2) - q2**2 + q3**2 + q4**2),
            np.arcsin(2 * (q2 * q4 - q1 * q3)),
            np.arctan2(2 * (q1 * q2 + q3 * q4), q1**2 - q2**2 - q3**2 + q4**2),
        ]
    )


@pytest.fixture
def rotations():
    return Rotation.random(50, random_state=np.random.default_rng(0))


def test_a_takes_the_room_to_the_sensor(rotations):
    """Our q_ref_body takes the body to the room: A of the same attitude is its transpose."""
    for rotation in rotations:
        q_ref_body = rotation.as_quat(scalar_first=True)
        assert np.allclose(source_a(to_source(q_ref_body)), rotation.as_matrix().T)


def test_h_is_gravity_seen_by_the_sensor(rotations):
    for rotation in rotations:
        q = to_source(rotation.as_quat(scalar_first=True))
        assert np.allclose(source_h(q), rotation.inv().apply([0.0, 0.0, G]))


def test_angles_are_roll_pitch_and_yaw(rotations):
    """(14) are the angles of turning about the sensor's own z, then y, then x."""
    for rotation in rotations:
        yaw, pitch, roll = rotation.as_euler("ZYX")
        assert np.allclose(source_angles(to_source(rotation.as_quat(scalar_first=True))), [roll, pitch, yaw])


def test_f_turns_as_the_gyro_says():
    """(2) and (4) are the first order of q (x) exp(w dt / 2): the difference shrinks with dt squared."""
    rate = np.array([0.8, -1.1, 0.6])
    start = Rotation.from_rotvec([0.3, -0.2, 0.9])
    errors = []
    for dt in (0.01, 0.005):
        wx, wy, wz = rate
        f = np.eye(4) + dt / 2 * np.array([[0, wz, -wy, wx], [-wz, 0, wx, wy], [wy, -wx, 0, wz], [-wx, -wy, -wz, 0]])
        stepped = from_source(f @ to_source(start.as_quat(scalar_first=True)))
        exact = start * Rotation.from_rotvec(rate * dt)
        errors.append(np.abs(np.abs(stepped) - np.abs(exact.as_quat(scalar_first=True))).max())
    assert errors[0] < 1e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def by_the_book(track, settings):
    """(1)-(12), (16) and (17), in numpy, one line an equation; the repairs are marked."""
    n_window = settings.source_window_n if settings.method == "akf_source" else None
    q_var = settings.source_gyr_noise_rad_s**2
    r = np.eye(3) * settings.source_acc_noise_m_s2**2
    up = track.acc_m_s2[0] / np.linalg.norm(track.acc_m_s2[0])
    x = to_source(Rotation.align_vectors([[0, 0, 1]], [up])[0].as_quat(scalar_first=True))
    half_way = np.array([1 + up[2], up[1], -up[0], 0.0])  # the smallest turn; align_vectors leaves the heading open
    x = to_source(half_way / np.linalg.norm(half_way))
    p = np.eye(4) * settings.sd_start_tilt_rad**2 / 4
    found, innovations, spreads = [x], [], []
    for k in range(1, track.n_samples):
        dt = track.time_s[k] - track.time_s[k - 1]
        wx, wy, wz = track.gyr_rad_s[k]
        f = np.eye(4) + dt / 2 * np.array([[0, wz, -wy, wx], [-wz, 0, wx, wy], [wy, -wx, 0, wz], [-wx, -wy, -wz, 0]])
        q1, q2, q3, q4 = x
        g = dt / 2 * np.array([[q4, -q3, q2], [q3, q4, -q1], [-q2, q1, q4], [-q1, -q2, -q3]])
        x = f @ x
        p = f @ p @ f.T + q_var * g @ g.T
        q1, q2, q3, q4 = x
        y = track.acc_m_s2[k] - source_h(x)
        h = 2 * G * np.array([[q3, -q4, q1, -q2], [q4, q3, q2, q1], [-q1, -q2, q3, q4]])
        innovations.append(y)
        spreads.append(h @ p @ h.T)
        if n_window and len(innovations) >= n_window:  # repair: R as given until there are N
            ys = np.array(innovations[-n_window:])
            mean = ys.mean(axis=0)
            deviations = ys - mean
            r = (deviations.T @ deviations - (n_window - 1) / n_window * np.sum(spreads[-n_window:], axis=0)) / (
                n_window - 1
            )
            values, vectors = np.linalg.eigh(r)
            r = vectors @ np.diag(np.maximum(values, settings.source_acc_noise_m_s2**2)) @ vectors.T  # repair: floor
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + r)
        x = x + gain @ y
        x = x / np.linalg.norm(x)  # repair
        p = (np.eye(4) - gain @ h) @ p
        found.append(x)
    return from_source(np.array(found))


@pytest.mark.parametrize("method", ["akf_source", "ekf"])
def test_kernel_is_the_equations_word_for_word(method):
    rng = np.random.default_rng(3)
    n = 150
    time_s = np.cumsum(rng.uniform(0.008, 0.012, n))
    acc = np.array([0.5, -0.3, G]) + rng.normal(0.0, 1.0, (n, 3))
    track = ImuTrack(time_s, acc, rng.normal(0.0, 0.7, (n, 3)))
    settings = dataclasses.replace(SETTINGS, method=method)
    q, q_book = estimate_attitude(track, settings).q, by_the_book(track, settings)
    assert np.abs(np.abs(np.sum(q * q_book, axis=1)) - 1.0).max() < 1e-9


def test_r_of_the_source_is_shown_and_moves():
    rng = np.random.default_rng(4)
    n = 400
    acc = np.array([0.0, 0.0, G]) + rng.normal(0.0, 0.05, (n, 3))
    acc[200:300] += rng.normal(0.0, 4.0, (100, 3))
    track = ImuTrack(np.arange(n) / 100, acc, np.zeros((n, 3)))
    adaptive = estimate_attitude(track, SETTINGS)
    constant = estimate_attitude(track, dataclasses.replace(SETTINGS, method="ekf"))
    assert adaptive.r_unit == "m2/s4"
    assert np.ptp(constant.r) == 0.0
    assert adaptive.r[290] > 100 * adaptive.r[190]
