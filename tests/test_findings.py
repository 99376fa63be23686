"""The rules of both profiles around their limits, and what the scores are made of."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from inhalemon.devices import load_device
from inhalemon.rules import load_rules
from inhalemon.rules.scoring import POINTS, after_review, score
from inhalemon.simulate import simulate_session
from inhalemon.simulate.mistakes import MISTAKES
from inhalemon.stages.findings import apply_rules
from inhalemon.stages.worst import worst_of
from inhalemon.values import Dose, Finding, Grade, Measure, Severity, Verdict

FAIL, PASS, OPEN, NONE = Verdict.FAIL, Verdict.PASS, Verdict.INDETERMINATE, Verdict.NOT_ASSESSABLE
CRITICAL, MAJOR, MINOR = Severity

PMDI = {
    "shake_duration_s": 6.0,
    "shake_cycles": 12,
    "shake_to_press_s": 6.0,
    "exhale_pause_s": 2.0,
    "inhalation_start_s": 12.0,
    "inhalation_s": 4.0,
    "coordination_s": 0.2,
    "press_count": 1,
    "partial_press_count": 0,
    "press_angle_deg": 14.0,
    "tilt_at_press_deg": 15.0,
    "breath_hold_s": 7.0,
    "order_violations": 0,
    "mouth_stays": 1,
    "press_after_mouth_s": -3.8,
}
ELLIPTA = {
    "exhale_pause_s": 2.0,
    "inhalation_start_s": 12.0,
    "inhalation_s": 2.5,
    "breath_hold_s": 7.0,
    "tilt_at_inhalation_deg": 20.0,
    "cover_angle_max_deg": 94.0,
    "cover_final_deg": 0.5,
    "cover_openings": 1,
    "shake_after_open_cycles": 0,
    "inverted_after_open_s": 0.0,
    "order_violations": 0,
    "mouth_stays": 1,
}
CORRECT = {"pmdi": PMDI, "ellipta": ELLIPTA}
NEVER = {
    "pmdi": {"flow", "lip_seal", "exhaled_into_device", "nose_breathing", "cap_left_on"},
    "ellipta": {"flow", "lip_seal", "exhaled_into_device", "nose_breathing", "vents_blocked"},
}


def findings_of(device, profile="default", sd=0.0, **changes):
    """Findings on a correct session with some measures changed: a number, a (number, sd) pair, or None."""
    measures = {}
    for name, value in (CORRECT[device] | changes).items():
        number, deviation = value if isinstance(value, tuple) else (value, sd)
        measures[name] = Measure(number, deviation) if number is not None else Measure(None, reason="not_seen")
    found = apply_rules(measures, load_device(device), load_rules(profile))
    return {finding.rule: finding for finding in found}


@pytest.mark.parametrize("profile", ["default", "strict"])
@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
def test_correct_session_passes_every_rule_but_those_that_sensors_cannot_decide(device, profile):
    found = findings_of(device, profile, sd=0.1 if device == "ellipta" else 0.05)
    verdicts = {rule: finding.verdict for rule, finding in found.items()}
    assert {rule for rule, verdict in verdicts.items() if verdict is NONE} == NEVER[device]
    assert {verdict for rule, verdict in verdicts.items() if rule not in NEVER[device]} == {PASS}
    assert score(found.values()).grade is Grade.CORRECT
    assert score(found.values()).points == 100


AROUND_THE_LIMITS = [
    # rule, device, profile, measures changed, verdict, severity
    ("not_shaken", "pmdi", "default", {"shake_cycles": 1, "shake_duration_s": 0.3}, FAIL, CRITICAL),
    ("not_shaken", "pmdi", "default", {"shake_cycles": 0, "shake_duration_s": None}, FAIL, CRITICAL),
    ("not_shaken", "pmdi", "default", {"shake_cycles": 2}, PASS, None),
    ("not_shaken", "pmdi", "default", {"shake_cycles": (2, 0.3)}, OPEN, CRITICAL),
    ("not_shaken", "pmdi", "default", {"shake_cycles": None}, NONE, CRITICAL),
    ("shake_too_short", "pmdi", "default", {"shake_duration_s": 1.85}, FAIL, MAJOR),
    ("shake_too_short", "pmdi", "default", {"shake_cycles": 2}, FAIL, MAJOR),
    ("shake_too_short", "pmdi", "default", {"shake_cycles": 2, "shake_duration_s": None}, FAIL, MAJOR),
    ("shake_too_short", "pmdi", "default", {"shake_duration_s": 1.95}, OPEN, MAJOR),
    ("shake_too_short", "pmdi", "default", {"shake_duration_s": (2.3, 0.2)}, OPEN, MAJOR),
    ("shake_too_short", "pmdi", "default", {"shake_duration_s": 2.15}, PASS, None),
    ("shake_too_short", "pmdi", "default", {"shake_duration_s": None}, NONE, MAJOR),
    ("shake_too_short", "pmdi", "strict", {"shake_duration_s": 1.5}, FAIL, MAJOR),
    ("shake_too_short", "pmdi", "strict", {"shake_duration_s": 3.0}, FAIL, MINOR),
    ("shake_too_short", "pmdi", "strict", {"shake_duration_s": 4.95}, OPEN, MINOR),
    ("shake_too_short", "pmdi", "strict", {"shake_duration_s": 5.2}, PASS, None),
    ("shake_to_press_delay", "pmdi", "default", {"shake_to_press_s": 9.5}, PASS, None),
    ("shake_to_press_delay", "pmdi", "default", {"shake_to_press_s": 10.1}, OPEN, MAJOR),
    ("shake_to_press_delay", "pmdi", "default", {"shake_to_press_s": 11.0}, FAIL, MAJOR),
    ("shake_to_press_delay", "pmdi", "default", {"shake_to_press_s": 29.9}, FAIL, MAJOR),
    ("shake_to_press_delay", "pmdi", "default", {"shake_to_press_s": 31.0}, FAIL, CRITICAL),
    ("shake_to_press_delay", "pmdi", "default", {"shake_to_press_s": None}, NONE, CRITICAL),
    ("no_press", "pmdi", "default", {"press_count": 0, "partial_press_count": 0}, FAIL, CRITICAL),
    ("no_press", "pmdi", "default", {"press_count": 0, "partial_press_count": 1}, PASS, None),
    ("no_press", "pmdi", "default", {"press_count": (0, 0.4), "partial_press_count": 0}, OPEN, CRITICAL),
    ("no_press", "pmdi", "default", {"press_count": None, "partial_press_count": 0}, NONE, CRITICAL),
    ("press_incomplete", "pmdi", "default", {"press_count": 0, "partial_press_count": 1}, FAIL, MAJOR),
    ("press_incomplete", "pmdi", "default", {"press_angle_deg": 9.0}, OPEN, MAJOR),
    ("press_incomplete", "pmdi", "default", {"press_angle_deg": 12.5}, PASS, None),
    ("press_incomplete", "pmdi", "default", {"press_count": None, "partial_press_count": None}, NONE, MAJOR),
    ("multiple_presses", "pmdi", "default", {"press_count": 2}, FAIL, MAJOR),
    ("multiple_presses", "pmdi", "default", {"press_count": (2, 0.4)}, OPEN, MAJOR),
    ("multiple_presses", "pmdi", "default", {"press_count": None}, NONE, MAJOR),
    ("inverted_at_press", "pmdi", "default", {"tilt_at_press_deg": 93.0}, FAIL, CRITICAL),
    ("inverted_at_press", "pmdi", "default", {"tilt_at_press_deg": 91.0}, OPEN, CRITICAL),
    ("inverted_at_press", "pmdi", "default", {"tilt_at_press_deg": 87.0}, PASS, None),
    ("inverted_at_press", "pmdi", "default", {"tilt_at_press_deg": None}, NONE, CRITICAL),
    ("not_upright_at_press", "pmdi", "default", {"tilt_at_press_deg": 48.0}, FAIL, MAJOR),
    ("not_upright_at_press", "pmdi", "default", {"tilt_at_press_deg": 44.0}, OPEN, MAJOR),
    ("not_upright_at_press", "pmdi", "default", {"tilt_at_press_deg": 42.0}, PASS, None),
    ("not_upright_at_press", "pmdi", "default", {"tilt_at_press_deg": None}, NONE, MAJOR),
    ("press_early", "pmdi", "default", {"coordination_s": -0.6}, FAIL, CRITICAL),
    ("press_early", "pmdi", "default", {"coordination_s": -0.53}, OPEN, CRITICAL),
    ("press_early", "pmdi", "default", {"coordination_s": -0.4}, PASS, None),
    ("press_early", "pmdi", "default", {"coordination_s": None}, NONE, CRITICAL),
    ("press_late", "pmdi", "default", {"coordination_s": 1.0}, FAIL, MAJOR),
    ("press_late", "pmdi", "default", {"coordination_s": (1.0, 0.06)}, OPEN, MAJOR),
    ("press_late", "pmdi", "default", {"coordination_s": 0.8}, PASS, None),
    ("press_late", "pmdi", "default", {"coordination_s": 5.0, "press_after_mouth_s": 1.0}, FAIL, CRITICAL),
    ("press_late", "pmdi", "default", {"coordination_s": None, "press_after_mouth_s": 1.0}, FAIL, CRITICAL),
    ("press_late", "pmdi", "default", {"coordination_s": 1.5, "press_after_mouth_s": None}, FAIL, MAJOR),
    ("press_late", "pmdi", "default", {"coordination_s": None}, NONE, MAJOR),
    ("press_late", "pmdi", "default", {"coordination_s": 0.5, "press_after_mouth_s": (0.05, 0.03)}, OPEN, CRITICAL),
    ("press_late", "pmdi", "default", {"coordination_s": 0.5, "press_after_mouth_s": None}, NONE, CRITICAL),
    ("press_late", "pmdi", "default", {"coordination_s": None, "press_after_mouth_s": None}, NONE, CRITICAL),
    ("no_inhalation", "pmdi", "default", {"mouth_stays": 0, "inhalation_start_s": None}, FAIL, CRITICAL),
    ("no_inhalation", "pmdi", "default", {"inhalation_start_s": None}, NONE, CRITICAL),
    ("no_inhalation", "pmdi", "default", {"mouth_stays": (1, 0.3)}, OPEN, CRITICAL),
    ("no_inhalation", "pmdi", "default", {"mouth_stays": 0, "shake_cycles": 0, "press_count": 0}, NONE, CRITICAL),
    ("no_inhalation", "ellipta", "default", {"mouth_stays": 0, "inhalation_start_s": None}, FAIL, CRITICAL),
    ("no_inhalation", "ellipta", "default", {"mouth_stays": 0, "cover_openings": 0}, FAIL, CRITICAL),
    (
        "no_inhalation",
        "ellipta",
        "default",
        {"mouth_stays": 0, "cover_openings": 0, "cover_angle_max_deg": 3.0},
        NONE,
        CRITICAL,
    ),
    ("no_exhale_pause", "pmdi", "default", {"exhale_pause_s": 0.0}, FAIL, MAJOR),
    ("no_exhale_pause", "ellipta", "default", {"exhale_pause_s": 0.9}, FAIL, MAJOR),
    ("no_exhale_pause", "ellipta", "default", {"exhale_pause_s": 1.03}, OPEN, MAJOR),
    ("no_exhale_pause", "ellipta", "default", {"exhale_pause_s": 1.1}, PASS, None),
    ("no_exhale_pause", "ellipta", "default", {"exhale_pause_s": None}, NONE, MAJOR),
    ("inhalation_too_short", "pmdi", "default", {"inhalation_s": 1.2}, FAIL, CRITICAL),
    ("inhalation_too_short", "pmdi", "default", {"inhalation_s": 1.55}, OPEN, CRITICAL),
    ("inhalation_too_short", "pmdi", "default", {"inhalation_s": 1.7}, PASS, None),
    ("inhalation_too_short", "ellipta", "default", {"inhalation_s": None}, NONE, CRITICAL),
    ("inhalation_too_short", "pmdi", "strict", {"inhalation_s": 2.5}, FAIL, MINOR),
    ("inhalation_too_short", "pmdi", "strict", {"inhalation_s": 1.2}, FAIL, CRITICAL),
    ("inhalation_too_short", "ellipta", "strict", {"inhalation_s": 2.5}, PASS, None),
    ("inhalation_too_short", "ellipta", "strict", {"inhalation_s": 1.8}, FAIL, MINOR),
    ("breath_hold_too_short", "pmdi", "default", {"breath_hold_s": 2.4}, FAIL, MAJOR),
    ("breath_hold_too_short", "ellipta", "default", {"breath_hold_s": 2.6}, OPEN, MAJOR),
    ("breath_hold_too_short", "ellipta", "default", {"breath_hold_s": 3.6}, PASS, None),
    ("breath_hold_too_short", "ellipta", "default", {"breath_hold_s": None}, NONE, MAJOR),
    ("breath_hold_too_short", "ellipta", "strict", {"breath_hold_s": 4.4}, FAIL, MAJOR),
    ("cover_not_fully_open", "ellipta", "default", {"cover_angle_max_deg": 79.0}, FAIL, CRITICAL),
    ("cover_not_fully_open", "ellipta", "default", {"cover_angle_max_deg": 80.5}, OPEN, CRITICAL),
    ("cover_not_fully_open", "ellipta", "default", {"cover_angle_max_deg": 82.0}, PASS, None),
    ("cover_not_fully_open", "ellipta", "default", {"cover_angle_max_deg": None}, NONE, CRITICAL),
    ("opened_repeatedly", "ellipta", "default", {"cover_openings": 2}, FAIL, MAJOR),
    ("opened_repeatedly", "ellipta", "default", {"cover_openings": (2, 0.3)}, OPEN, MAJOR),
    ("opened_repeatedly", "ellipta", "default", {"cover_openings": None}, NONE, MAJOR),
    ("shaken_after_open", "ellipta", "default", {"shake_after_open_cycles": 2}, FAIL, CRITICAL),
    ("shaken_after_open", "ellipta", "default", {"shake_after_open_cycles": 1}, PASS, None),
    ("shaken_after_open", "ellipta", "default", {"shake_after_open_cycles": (2, 0.3)}, OPEN, CRITICAL),
    ("shaken_after_open", "ellipta", "default", {"shake_after_open_cycles": None}, NONE, CRITICAL),
    ("inverted_after_open", "ellipta", "default", {"inverted_after_open_s": 0.5}, FAIL, CRITICAL),
    ("inverted_after_open", "ellipta", "default", {"inverted_after_open_s": 0.28}, OPEN, CRITICAL),
    ("inverted_after_open", "ellipta", "default", {"inverted_after_open_s": 0.2}, PASS, None),
    ("inverted_after_open", "ellipta", "default", {"inverted_after_open_s": None}, NONE, CRITICAL),
    ("tilted_at_inhalation", "ellipta", "default", {"tilt_at_inhalation_deg": 50.0}, FAIL, MINOR),
    ("tilted_at_inhalation", "ellipta", "default", {"tilt_at_inhalation_deg": 46.0}, OPEN, MINOR),
    ("tilted_at_inhalation", "ellipta", "default", {"tilt_at_inhalation_deg": 42.0}, PASS, None),
    ("tilted_at_inhalation", "ellipta", "default", {"tilt_at_inhalation_deg": None}, NONE, MINOR),
    ("cover_not_closed", "ellipta", "default", {"cover_final_deg": 16.0}, FAIL, MINOR),
    ("cover_not_closed", "ellipta", "default", {"cover_final_deg": 14.0}, OPEN, MINOR),
    ("cover_not_closed", "ellipta", "default", {"cover_final_deg": 13.0}, PASS, None),
    ("cover_not_closed", "ellipta", "default", {"cover_final_deg": None}, NONE, MINOR),
    ("order_wrong", "pmdi", "default", {"order_violations": 1}, FAIL, MINOR),
    ("order_wrong", "pmdi", "default", {"order_violations": (1, 0.3)}, OPEN, MINOR),
    ("order_wrong", "ellipta", "default", {"order_violations": None}, NONE, MINOR),
]


@pytest.mark.parametrize(("rule", "device", "profile", "changes", "verdict", "severity"), AROUND_THE_LIMITS)
def test_rule_decides_around_its_limit(rule, device, profile, changes, verdict, severity):
    finding = findings_of(device, profile, **changes)[rule]
    assert (finding.verdict, finding.severity) == (verdict, severity)
    assert (finding.reason is None) == (verdict in (PASS, FAIL))
    assert finding.message


def test_every_rule_is_tried_for_each_verdict_it_can_have():
    """A pass of every rule is in the correct sessions above."""
    for rule in load_rules().rules:
        tried = {case[4] for case in AROUND_THE_LIMITS if case[0] == rule.id}
        assert rule.never_decided is not None or {FAIL, OPEN, NONE} <= tried, rule.id


@pytest.mark.parametrize(
    ("device", "changes", "rule", "cause"),
    [
        ("pmdi", {"shake_cycles": 0, "shake_duration_s": 0.0}, "shake_too_short", "not_shaken"),
        ("pmdi", {"shake_cycles": 0}, "shake_to_press_delay", "not_shaken"),
        ("pmdi", {"press_count": 0}, "shake_to_press_delay", "no_press"),
        ("pmdi", {"press_count": 0}, "press_incomplete", "no_press"),
        ("pmdi", {"press_count": 0}, "press_early", "no_press"),
        ("pmdi", {"press_count": 0}, "press_late", "no_press"),
        ("pmdi", {"press_count": 0}, "multiple_presses", "no_press"),
        ("pmdi", {"press_count": 0}, "inverted_at_press", "no_press"),
        ("pmdi", {"tilt_at_press_deg": 150.0}, "not_upright_at_press", "inverted_at_press"),
        ("pmdi", {"mouth_stays": 0}, "press_late", "no_inhalation"),
        ("ellipta", {"mouth_stays": 0}, "inhalation_too_short", "no_inhalation"),
        ("ellipta", {"mouth_stays": 0}, "breath_hold_too_short", "no_inhalation"),
    ],
)
def test_rule_implied_by_a_failed_one_is_not_assessable_and_carries_no_severity(device, changes, rule, cause):
    finding = findings_of(device, **changes)[rule]
    assert (finding.verdict, finding.severity, finding.reason) == (NONE, None, f"implied_by:{cause}")


def test_missing_measure_is_never_passed_in_silence():
    """Without any measure every rule says that it could not be assessed, and why."""
    for device in ("pmdi", "ellipta"):
        found = apply_rules({}, load_device(device), load_rules())
        assert {finding.verdict for finding in found} == {NONE}
        assert all(finding.reason for finding in found)
        assert score(found).grade is Grade.NOT_ASSESSABLE


@pytest.mark.parametrize(
    ("value", "verdict", "severity"), [(4.0, FAIL, CRITICAL), (9.9, OPEN, CRITICAL), (12, PASS, None)]
)
def test_graver_level_that_is_wider_than_a_lighter_one_is_not_passed_in_silence(tmp_path, value, verdict, severity):
    """Nothing makes a rule file's levels parts of one another."""
    file = tmp_path / "own.toml"
    file.write_text(
        "[rules.breath_hold_too_short.when]\n"
        'critical = { measure = "breath_hold_s", is = "<", limit = 10.0, dead_band = 0.5 }\n'
        'minor = { measure = "breath_hold_s", is = "<", limit = 5.0, dead_band = 0.5 }\n'
    )
    measures = {name: Measure(number, 0.0) for name, number in (PMDI | {"breath_hold_s": value}).items()}
    found = {f.rule: f for f in apply_rules(measures, load_device("pmdi"), load_rules(file))}["breath_hold_too_short"]
    assert (found.verdict, found.severity) == (verdict, severity)


def test_unusable_session_is_assessed_in_nothing():
    found = apply_rules(
        {name: Measure(value) for name, value in PMDI.items()},
        load_device("pmdi"),
        load_rules(),
        unusable="attitude_not_trusted",
    )
    assert {finding.verdict for finding in found} == {NONE}
    assert "attitude_not_trusted" in {finding.reason for finding in found}
    assert score(found).grade is Grade.NOT_ASSESSABLE


def test_hinge_has_no_rules_and_no_grade():
    found = apply_rules({}, load_device("hinge"), load_rules())
    assert found == ()
    assert score(found).grade is Grade.NOT_ASSESSABLE


def test_calibrated_travel_moves_the_limit_and_ends_the_doubt():
    device = dataclasses.replace(load_device("pmdi"), full_travel_rad=math.radians(10.0))
    measures = {name: Measure(value, 0.0) for name, value in (PMDI | {"press_angle_deg": 9.0}).items()}
    found = {finding.rule: finding for finding in apply_rules(measures, device, load_rules())}
    assert found["press_incomplete"].verdict is PASS
    assert found["press_incomplete"].limit == pytest.approx(6.0)


def test_finding_shows_value_limit_unit_and_place():
    measures = {name: Measure(value) for name, value in PMDI.items()}
    measures["coordination_s"] = Measure(1.4, 0.05, None, 13.0, 13.6)
    found = {f.rule: f for f in apply_rules(measures, load_device("pmdi"), load_rules())}
    late = found["press_late"]
    assert (late.value, late.limit, late.unit, late.start_s, late.end_s) == (1.4, 0.9, "s", 13.0, 13.6)
    assert "1.4 s" in late.message
    assert "0.9 s" in late.message


def test_press_incomplete_shows_the_angle_rather_than_the_count():
    finding = findings_of("pmdi", press_count=0, partial_press_count=1, press_angle_deg=3.2)["press_incomplete"]
    assert (finding.value, finding.limit, finding.unit) == (3.2, 5.0, "deg")


# ---------------------------------------------------------------------------------------------------------- scores

MADE_UP = st.builds(
    Finding,
    rule=st.sampled_from([rule.id for rule in load_rules().rules]),
    verdict=st.sampled_from(Verdict),
    severity=st.sampled_from([*Severity, None]),
    value=st.none(),
    limit=st.none(),
    unit=st.none(),
    start_s=st.none(),
    end_s=st.none(),
    reason=st.none(),
    message=st.just(""),
)


@given(st.lists(MADE_UP, max_size=12))
def test_points_stay_between_0_and_100_and_a_further_mistake_never_raises_them(findings):
    points = score(findings).points
    assert 0 <= points <= 100
    for severity in Severity:
        more = Finding("more", FAIL, severity, None, None, None, None, None, None, "")
        assert score([*findings, more]).points <= points


@given(st.lists(MADE_UP, max_size=12).flatmap(lambda f: st.tuples(st.just(f), st.permutations(f))))
def test_score_does_not_depend_on_the_order_of_the_findings(pair):
    assert score(pair[0]) == score(pair[1])


@given(st.lists(MADE_UP, min_size=1, max_size=12))
def test_grade_is_the_worst_failed_severity_unless_a_critical_rule_is_open(findings):
    failed = {finding.severity for finding in findings if finding.verdict is FAIL}
    is_open = any(f.verdict in (OPEN, NONE) and f.severity is CRITICAL for f in findings)
    grade = score(findings).grade
    assert (grade is Grade.CRITICAL_MISTAKES) == (CRITICAL in failed)
    assert (grade is Grade.NOT_ASSESSABLE) == (is_open and CRITICAL not in failed)
    if grade is Grade.CORRECT:
        assert failed <= {None}


def test_points_count_each_severity_by_its_weight():
    found = findings_of("pmdi", tilt_at_press_deg=150.0, press_count=2, order_violations=2)
    assert score(found.values()).points == 100 - 40 - 15 - 5
    assert score(found.values()).grade is Grade.CRITICAL_MISTAKES


def dose(**changes):
    found = tuple(findings_of("pmdi", **changes).values())
    measures = {name: Measure(value) for name, value in (PMDI | changes).items()}
    return Dose(0.0, 1.0, (), measures, found, score(found))


def test_worst_of_several_doses_wins_rule_by_rule():
    doses = (dose(press_count=2), dose(coordination_s=1.5), dose(coordination_s=-2.0))
    worst = {finding.rule: finding for finding in worst_of(doses)[1]}
    assert worst["multiple_presses"].verdict is FAIL
    assert worst["press_late"].verdict is FAIL
    assert worst["press_early"].severity is CRITICAL
    assert worst["not_shaken"].verdict is PASS
    assert [finding.rule for finding in worst_of(doses)[1]] == [finding.rule for finding in doses[0].findings]
    assert worst_of(doses)[0] is doses[2].measures


def test_of_equal_doses_the_first_is_the_worst():
    doses = (dose(press_count=2), dose(coordination_s=1.5))
    assert worst_of(doses)[0] is doses[0].measures


def test_graver_failure_beats_a_lighter_one_and_what_is_open_beats_a_pass():
    light, grave = dose(coordination_s=1.5), dose(press_after_mouth_s=2.0)
    assert {f.rule: f for f in worst_of((light, grave))[1]}["press_late"].severity is CRITICAL
    passed, unseen = dose(), dose(coordination_s=None)
    assert {f.rule: f for f in worst_of((passed, unseen))[1]}["press_late"].verdict is NONE


# ------------------------------------------------------------------------------------------------- simulated truth


@pytest.mark.parametrize(("device", "mistake"), [(d, m) for d in MISTAKES for m in (None, *MISTAKES[d])])
def test_rules_on_the_true_measures_of_a_session_find_exactly_what_was_acted(device, mistake):
    """The simulator knows what was done and measures it exactly; rules and labels must then agree."""
    _, truth = simulate_session(device, mistakes=(mistake,) if mistake else (), seed=5, rate_hz=50.0)
    measures = {name: Measure(value, 0.0, None if value is not None else "x") for name, value in truth.measures.items()}
    measures["mouth_stays"] = Measure(0 if mistake == "no_inhalation" else 1)
    found = apply_rules(measures, load_device(device), load_rules())
    assert {finding.rule for finding in found if finding.verdict is FAIL} == set(truth.mistakes)
    undecided = {(finding.rule, finding.reason) for finding in found if finding.verdict is OPEN}
    assert undecided <= {("press_incomplete", "travel_not_calibrated")}


# ------------------------------------------------------------------------------------------ after review


def test_a_mistake_that_a_person_sees_counts_by_the_gravest_severity_still_open():
    found = findings_of("pmdi", shake_duration_s=1.5)
    assert found["shake_too_short"].severity is MAJOR
    said = {"shake_too_short": PASS, "not_shaken": FAIL, "lip_seal": FAIL}
    held = {each.rule: each for each in after_review(found.values(), said, load_rules())}
    assert [(held[rule].verdict, held[rule].severity) for rule in said] == [
        (PASS, None),
        (FAIL, CRITICAL),  # the gravest of the rule
        (FAIL, MAJOR),  # sensors never see it, and the rules do not weigh it
    ]
    assert score(held.values()).points == 100 - POINTS[CRITICAL] - POINTS[MAJOR]
    assert score(held.values()).grade is Grade.CRITICAL_MISTAKES
    assert after_review(found.values(), {}, load_rules()) == tuple(found.values())


def test_a_verdict_that_a_person_shares_changes_nothing():
    found = findings_of("pmdi", shake_duration_s=1.5, shake_to_press_s=11.0)
    said = {rule: finding.verdict for rule, finding in found.items()}
    assert after_review(found.values(), said, load_rules()) == tuple(found.values())


def test_a_critical_rule_that_a_person_could_not_judge_leaves_the_session_not_assessable():
    found = findings_of("pmdi", shake_cycles=1, shake_duration_s=0.3)
    assert found["not_shaken"].severity is CRITICAL
    held = after_review(found.values(), {"not_shaken": NONE}, load_rules())
    assert score(held).grade is Grade.NOT_ASSESSABLE
