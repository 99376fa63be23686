"""The second generator of motions keeps the same promises as the first: true motion, unambiguous labels."""

from __future__ import annotations

import numpy as np
import pytest
from test_simulate import check_labels, integrated

from inhalemon.rotation import angle_between
from inhalemon.simulate import PERFECT, draw_mistakes
from validation.second_actor import ATTACKS
from validation.second_generator import second_session

DEVICES = ("pmdi", "ellipta")


@pytest.mark.parametrize("attack", ATTACKS)
@pytest.mark.parametrize("device", DEVICES)
def test_labels_of_every_attack_keep_their_margin(device, attack):
    rng = np.random.default_rng(len(attack))
    _, truth = second_session(device, draw_mistakes(device, rng), seed=1, attack=attack, rate_hz=25)
    check_labels(device, truth)
    assert truth.phases[0].start_s == 0.0
    for before, after in zip(truth.phases[:-1], truth.phases[1:], strict=True):
        assert before.end_s == after.start_s


@pytest.mark.slow
@pytest.mark.parametrize("device", DEVICES)
def test_labels_keep_their_margin_over_many_draws(device):
    rng = np.random.default_rng(8)
    for seed in range(300):
        mistakes = draw_mistakes(device, rng)
        n_doses = 1 if "no_inhalation" in mistakes else 1 + seed % 2
        _, truth = second_session(device, mistakes, seed=seed, rate_hz=25, n_doses=n_doses)
        check_labels(device, truth)


@pytest.mark.parametrize("device", DEVICES)
def test_its_gyro_integrates_to_its_attitude(device):
    """Within 0.1 deg over a session in a car."""
    recording, truth = second_session(device, seed=3, attack="car", rate_hz=400, conditions=PERFECT)
    q = integrated(recording.body.gyr_rad_s, recording.body.time_s, truth.q_ref_body[0])
    assert np.rad2deg(angle_between(q, truth.q_ref_body).max()) < 0.1


def test_the_same_seed_gives_the_same_session():
    one, _ = second_session("pmdi", seed=5)
    two, _ = second_session("pmdi", seed=5)
    assert one.lever.acc_m_s2.tobytes() == two.lever.acc_m_s2.tobytes()


def test_a_recording_cut_at_the_start_begins_in_motion():
    recording, truth = second_session("pmdi", seed=2, attack="cut_start")
    assert truth.phases[0].kind == "handling"
    assert abs(recording.body.time_s[0]) < 0.02
