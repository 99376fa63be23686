"""The simulator's own truth: exact derivatives, honest sensors, unambiguous labels."""

from __future__ import annotations

import json

import numpy as np
import pytest

import inhalemon as im
from inhalemon.exceptions import SimulationError
from inhalemon.rotation import (
    angle_between,
    as_matrix,
    conjugate,
    from_rotation_vector,
    multiply,
    rotate,
    split_twist,
    to_rotation_vector,
)
from inhalemon.simulate import MISTAKES, draw_mistakes
from inhalemon.values import STANDARD_GRAVITY_M_S2, DeviceKind, EventKind, PhaseKind

DEVICES = ("pmdi", "ellipta")
EVERY_MISTAKE = [(device.value, mistake) for device, mistakes in MISTAKES.items() for mistake in mistakes]


def integrated(gyr_rad_s, time_s, q_start):
    """Attitude by exact rotation over each step, the rate taken as linear in it (second-order coning left out)."""
    steps = np.diff(time_s)[:, None]
    turns = from_rotation_vector(0.5 * (gyr_rad_s[1:] + gyr_rad_s[:-1]) * steps)
    q = [q_start]
    for turn in turns:
        q.append(multiply(q[-1], turn))
    return np.array(q)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("part", ["body", "lever"])
def test_noise_free_gyro_integrates_to_the_true_attitude(device, part):
    """Within 0.1 deg over a whole session of shaking, impacts and turns, at 250 Hz."""
    recording, truth = im.simulate_session(device, seed=5, rate_hz=250, profile="perfect")
    track = getattr(recording, part)
    q_true = truth.q_ref_body if part == "body" else truth.q_ref_lever
    q = integrated(track.gyr_rad_s, track.time_s, q_true[0])
    assert np.rad2deg(angle_between(q, q_true).max()) < 0.1


@pytest.mark.parametrize("device", DEVICES)
def test_specific_force_at_rest_is_gravity_seen_from_the_part(device):
    recording, truth = im.simulate_session(device, seed=8, profile="perfect")
    rest = truth.phases[0]
    assert rest.kind is PhaseKind.REST
    still = (recording.body.time_s > rest.start_s) & (recording.body.time_s < rest.end_s)
    up_body = rotate(conjugate(truth.q_ref_body[still]), np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2]))
    np.testing.assert_allclose(recording.body.acc_m_s2[still], up_body, atol=1e-9)
    still = (recording.lever.time_s > rest.start_s) & (recording.lever.time_s < rest.end_s)
    norm = np.linalg.norm(recording.lever.acc_m_s2[still], axis=1)
    np.testing.assert_allclose(norm, STANDARD_GRAVITY_M_S2, atol=1e-9)


@pytest.mark.parametrize("device", DEVICES)
def test_specific_force_is_the_second_derivative_of_the_chips_position(device):
    """Against numeric derivatives of the exact pose, arms included, for both chips, away from the impacts' kinks."""
    from inhalemon.simulate import subject  # noqa: PLC0415
    from inhalemon.simulate.session import _act  # noqa: PLC0415

    kind = DeviceKind(device)
    _, _, motion = _act(kind, frozenset(), subject(3, kind), np.random.default_rng(3), is_harsh=False, n_doses=1)
    h = 1e-4
    middle = np.linspace(0.5, 20.0, 1500)

    def position(time_s, part):
        c = motion.coordinates(time_s)[0]
        q, angle = motion.attitude(time_s)
        if part == "body":
            arm = np.broadcast_to(motion.geometry.body_chip_m, (time_s.size, 3))
        else:
            q_hinge = from_rotation_vector(angle[:, None] * np.array([1.0, 0.0, 0.0]))
            arm = motion.geometry.hinge_m + rotate(q_hinge, motion.geometry.lever_chip_m)
        return c[:3].T + rotate(q, arm)

    for part, signals in (("body", motion.body_signals), ("lever", motion.lever_signals)):
        acc = (position(middle + h, part) - 2 * position(middle, part) + position(middle - h, part)) / h**2
        q, angle = motion.attitude(middle)
        if part == "lever":
            q = multiply(q, from_rotation_vector(angle[:, None] * np.array([1.0, 0.0, 0.0])))
        expected = rotate(conjugate(q), acc + np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2]))
        error = np.abs(signals(middle)[0] - expected).max(axis=1)
        # Third derivatives jump where a glide or a ring begins: a step of h across one is allowed to be off.
        assert np.quantile(error, 0.99) < 2e-3
        rate = to_rotation_vector(multiply(conjugate(q), _moved(motion, middle + h, part))) / h
        rate_before = to_rotation_vector(multiply(conjugate(_moved(motion, middle - h, part)), q)) / h
        assert np.abs(0.5 * (rate + rate_before) - signals(middle)[1]).max() < 5e-3


def _moved(motion, time_s, part):
    q, angle = motion.attitude(time_s)
    if part == "body":
        return q
    return multiply(q, from_rotation_vector(angle[:, None] * np.array([1.0, 0.0, 0.0])))


@pytest.mark.parametrize("device", DEVICES)
def test_relative_rotation_is_the_levers_angle_about_x(device):
    _, truth = im.simulate_session(device, seed=2, profile="perfect")
    # Without clock or timing errors, nearby rows of the two sensors are compared where the device is slow.
    nearest = np.clip(np.searchsorted(truth.lever_time_s, truth.time_s), 0, truth.lever_time_s.size - 1)
    q_body_lever = multiply(conjugate(truth.q_ref_body), truth.q_ref_lever[nearest])
    twist, _ = split_twist(q_body_lever, np.array([1.0, 0.0, 0.0]))
    step = np.abs(truth.lever_time_s[nearest] - truth.time_s)
    speed = np.abs(np.gradient(truth.angle_rad, truth.time_s))
    is_calm = np.linalg.norm(np.gradient(truth.q_ref_body, truth.time_s, axis=0), axis=1) < 0.05
    error = np.abs(twist - truth.angle_rad)[is_calm]
    assert is_calm.mean() > 0.2
    assert (error < 1e-3 + (speed * step)[is_calm] * 2).mean() > 0.99


@pytest.mark.parametrize("device", DEVICES)
def test_same_seed_same_bytes_and_another_seed_another_session(device):
    one, truth_one = im.simulate_session(device, seed=11)
    two, truth_two = im.simulate_session(device, seed=11)
    other, _ = im.simulate_session(device, seed=12)
    assert one.body.acc_m_s2.tobytes() == two.body.acc_m_s2.tobytes()
    assert one.lever.gyr_rad_s.tobytes() == two.lever.gyr_rad_s.tobytes()
    assert json.dumps(truth_one.to_labels()) == json.dumps(truth_two.to_labels())
    assert other.body.n_samples != one.body.n_samples or not np.array_equal(other.body.acc_m_s2, one.body.acc_m_s2)


def test_the_act_is_the_same_at_every_rate_and_with_every_sensor():
    _, slow = im.simulate_session("pmdi", seed=4, rate_hz=50)
    _, fast = im.simulate_session("pmdi", seed=4, rate_hz=(200, 119), profile="perfect")
    assert slow.measures == fast.measures
    assert slow.phases == fast.phases


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("seed", range(4))
def test_phases_cover_the_session_in_order_and_do_not_overlap(device, seed):
    recording, truth = im.simulate_session(device, seed=seed, n_doses=1 + seed % 2)
    assert truth.phases[0].start_s == 0.0
    for before, after in zip(truth.phases[:-1], truth.phases[1:], strict=True):
        assert before.end_s == after.start_s
        assert before.kind is not after.kind
    assert truth.phases[-1].end_s == pytest.approx(recording.body.time_s[-1], abs=0.2)


def test_an_end_stop_is_reached_at_the_events_peak():
    """The lever stands at its travel when the label says so, within the ringing of a degree."""
    _, truth = im.simulate_session("pmdi", seed=9, rate_hz=1000, profile="perfect")
    (press,) = [e for e in truth.events if e.kind is EventKind.PRESS]
    angle_deg = np.rad2deg(np.interp(press.peak_s, truth.time_s, truth.angle_rad))
    assert angle_deg == pytest.approx(press.angle_deg, abs=0.2)
    before_deg = np.rad2deg(np.interp(press.start_s, truth.time_s, truth.angle_rad))
    assert abs(before_deg) < 0.05


def holds_with_margin(measures, mistake, device, limits):
    """Whether a rule's measure lies clearly on the failing (True) or passing (False) side; None when in between."""
    fails, passes = limits[mistake](measures)
    assert not (fails and passes), (device, mistake)
    return True if fails else False if passes else None


def above(value, low, high):
    """(clearly above, clearly below); a measure that cannot be had is neither."""
    return (value is not None and value >= high, value is None or value <= low)


def below(value, low, high):
    return (value is not None and value <= low, value is None or value >= high)


# Each rule's limit of RULES.md with a margin on both sides of it.
PMDI = {
    "not_shaken": lambda m: below(m["shake_cycles"], 0.0, 2.0),
    "shake_too_short": lambda m: (
        0 < m["shake_duration_s"] <= 1.6,
        m["shake_cycles"] == 0 or (m["shake_duration_s"] >= 2.4 and m["shake_cycles"] >= 5),
    ),
    "shake_to_press_delay": lambda m: above(m["shake_to_press_s"], 9.0, 11.5),
    "not_upright_at_press": lambda m: (
        m["tilt_at_press_deg"] is not None and 53 <= m["tilt_at_press_deg"] <= 82,
        m["tilt_at_press_deg"] is None or m["tilt_at_press_deg"] <= 40 or m["tilt_at_press_deg"] >= 90,
    ),
    "inverted_at_press": lambda m: above(m["tilt_at_press_deg"], 82, 115),
    "press_early": lambda m: below(m["coordination_s"], -0.8, -0.2),
    "press_late": lambda m: above(m["coordination_s"], 0.6, 1.2),
    "no_press": lambda m: (
        m["press_count"] + m["partial_press_count"] == 0,
        m["press_count"] + m["partial_press_count"] > 0,
    ),
    "multiple_presses": lambda m: above(m["press_count"], 1, 2),
    "press_incomplete": lambda m: (
        m["press_count"] == 0 and m["partial_press_count"] > 0 and 2.0 <= m["press_angle_deg"] <= 4.6,
        m["press_angle_deg"] is None or m["press_angle_deg"] >= 7.5,
    ),
    "no_exhale_pause": lambda m: below(m["exhale_pause_s"], 0.5, 1.5),
    "inhalation_too_short": lambda m: below(m["inhalation_s"], 1.15, 2.2),
    "breath_hold_too_short": lambda m: below(m["breath_hold_s"], 2.2, 4.0),
    "no_inhalation": lambda m: (m["inhalation_s"] is None, m["inhalation_s"] is not None),
    "order_wrong": lambda m: above(m["order_violations"], 0, 1),
}
ELLIPTA = {
    "cover_not_fully_open": lambda m: below(m["cover_angle_max_deg"], 95 * 0.78, 95 * 0.92),
    "shaken_after_open": lambda m: above(m["shake_after_open_cycles"], 0.5, 3),
    "inverted_after_open": lambda m: above(m["inverted_after_open_s"], 0.0, 0.7),
    "tilted_at_inhalation": lambda m: above(m["tilt_at_inhalation_deg"], 40, 53),
    "no_exhale_pause": PMDI["no_exhale_pause"],
    "inhalation_too_short": PMDI["inhalation_too_short"],
    "breath_hold_too_short": PMDI["breath_hold_too_short"],
    "cover_not_closed": lambda m: above(m["cover_final_deg"], 3, 30),
    "opened_repeatedly": lambda m: above(m["cover_openings"], 1, 2),
    "no_inhalation": PMDI["no_inhalation"],
    "order_wrong": PMDI["order_wrong"],
}
LIMITS = {"pmdi": PMDI, "ellipta": ELLIPTA}


def check_labels(device, truth):
    for rule in MISTAKES[DeviceKind(device)]:
        verdict = holds_with_margin(truth.measures, rule, device, LIMITS[device])
        assert verdict is (rule in truth.mistakes), (truth.session_id, rule, truth.mistakes, dict(truth.measures))


@pytest.mark.parametrize(("device", "mistake"), EVERY_MISTAKE)
def test_every_mistake_is_acted_with_a_margin_and_no_other_with_it(device, mistake):
    for number in (6, 17):
        _, truth = im.simulate_session(device, (mistake,), seed=100 + number, subject=number, rate_hz=25)
        check_labels(device, truth)


@pytest.mark.slow
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("profile", ["typical", "harsh"])
def test_labels_keep_their_margin_over_many_draws(device, profile):
    rng = np.random.default_rng(2)
    for seed in range(400):
        mistakes = draw_mistakes(device, rng)
        _, truth = im.simulate_session(device, mistakes, seed=seed, rate_hz=25, profile=profile)
        check_labels(device, truth)


def test_sensors_err_as_much_as_their_datasheets_say():
    """The bias read at rest spreads over sessions as the models say: some deg/s for the gyro, some 10 mg for force."""
    offsets = {"body": [], "lever": []}
    for seed in range(30):
        recording, _ = im.simulate_session("ellipta", ("no_inhalation",), seed=seed, rate_hz=25, subject=0)
        for part, found in offsets.items():
            track = getattr(recording, part)
            found.append(np.median(track.gyr_rad_s, axis=0))
    spread = {part: np.rad2deg(np.std(found)) for part, found in offsets.items()}
    assert 6 < spread["body"] < 14  # LSM9DS1: +-30 deg/s is three deviations
    assert 1 < spread["lever"] < 2.5  # MPU-9250: +-5 deg/s


def test_the_levers_clock_is_off_by_what_the_truth_says():
    recording, truth = im.simulate_session("pmdi", seed=6, profile="harsh")
    assert abs(truth.lever_clock.offset_s) > 1e-3
    _, clean = im.simulate_session("pmdi", seed=6, profile="harsh")
    assert truth.lever_clock == clean.lever_clock
    assert recording.lever.time_s[0] == pytest.approx(truth.lever_clock.offset_s, abs=0.03)


def test_harsh_sensors_saturate_and_leave_gaps():
    recording, _ = im.simulate_session("pmdi", seed=3, profile="harsh", subject=1)
    assert np.diff(recording.body.time_s).max() > 2.5 / 100
    assert np.abs(recording.body.acc_m_s2).max() <= recording.body.acc_range_m_s2


def test_two_doses_have_two_inhalations_and_an_interval():
    _, truth = im.simulate_session("ellipta", seed=3, n_doses=2)
    assert sum(p.kind is PhaseKind.INHALE for p in truth.phases) == 2
    assert truth.measures["puff_interval_s"] > 8


@pytest.mark.parametrize(
    ("device", "keywords", "says"),
    [
        ("diskus", {}, "diskus"),
        ("hinge", {}, "hinge"),
        ("pmdi", {"mistakes": ("flow",)}, "flow"),
        ("pmdi", {"mistakes": ("no_press", "press_late")}, "press_late"),
        ("pmdi", {"mistakes": "press_late"}, "sequence"),
        ("pmdi", {"rate_hz": 5}, "25 to 1000"),
        ("pmdi", {"profile": "gentle"}, "typical"),
        ("pmdi", {"n_doses": 0}, "n_doses"),
        ("ellipta", {"mistakes": ("no_inhalation",), "n_doses": 2}, "n_doses=1"),
    ],
)
def test_what_cannot_be_simulated_is_refused_with_the_reason(device, keywords, says):
    with pytest.raises(SimulationError, match=says):
        im.simulate_session(device, **keywords)


def test_labels_are_written_beside_the_recording(tmp_path):
    _, truth = im.simulate_session("pmdi", ("press_late",), seed=1)
    path = truth.write_labels(tmp_path / "one.csv.gz")
    assert path.name == "one.truth.json"
    labels = json.loads(path.read_text(encoding="utf-8"))
    assert labels["format"] == "inhalemon-labels/1"
    assert labels["mistakes"] == ["press_late"]
    assert labels["measures"]["coordination_s"] > 0.9


def test_attitude_of_the_truth_is_a_rotation():
    _, truth = im.simulate_session("pmdi", seed=1)
    np.testing.assert_allclose(np.linalg.det(as_matrix(truth.q_ref_body[::100])), 1.0, atol=1e-12)
