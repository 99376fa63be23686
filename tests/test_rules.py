"""Rule files: what ships, how a user's file changes it, and how a file that cannot be used says so."""

from __future__ import annotations

import re
from importlib import resources

import pytest

from inhalemon.exceptions import RulesError
from inhalemon.measures import INTERNAL_MEASURES, MEASURES
from inhalemon.rules import explain, load_rules, profile_names
from inhalemon.rules.model import AnyOf
from inhalemon.values import DeviceKind, Severity

BOTH = {"no_exhale_pause", "inhalation_too_short", "breath_hold_too_short", "no_inhalation", "order_wrong"}
BOTH |= {"flow", "lip_seal", "exhaled_into_device", "nose_breathing"}
PMDI = BOTH | {
    *("not_shaken", "shake_too_short", "shake_to_press_delay", "not_upright_at_press", "inverted_at_press"),
    *("press_early", "press_late", "no_press", "multiple_presses", "press_incomplete", "cap_left_on"),
}
ELLIPTA = BOTH | {
    *("cover_not_fully_open", "shaken_after_open", "inverted_after_open", "tilted_at_inhalation"),
    *("cover_not_closed", "opened_repeatedly", "vents_blocked"),
}

OWN_RULE = """
[rules.own_rule]
title = "Own rule"
devices = ["pmdi"]
message = "Found {value}, limit {limit}."
evidence = "E"
source = "This clinic."
when.minor = { measure = "breath_hold_s", is = "<", limit = 4.0, dead_band = 0.1 }
"""


def written(tmp_path, text):
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("profile", ["default", "strict"])
def test_profiles_hold_every_rule_of_both_devices(profile):
    rules = load_rules(profile)
    assert rules.profile == profile
    assert {rule.id for rule in rules.of(DeviceKind.PMDI)} == PMDI
    assert {rule.id for rule in rules.of(DeviceKind.ELLIPTA)} == ELLIPTA
    assert rules.of(DeviceKind.HINGE) == ()


def test_every_rule_names_its_source_and_every_decided_one_its_evidence():
    for profile in profile_names():
        for rule in load_rules(profile).rules:
            assert rule.source.endswith("."), rule.id
            assert (rule.evidence is None) == (rule.never_decided is not None), rule.id


def test_digest_is_that_of_the_content(tmp_path):
    same = load_rules(written(tmp_path, 'profile = "another name"\n'))
    assert same.digest == load_rules("default").digest
    assert load_rules("strict").digest != load_rules("default").digest
    assert re.fullmatch(r"[0-9a-f]{64}", same.digest)


def test_users_file_changes_only_the_fields_it_gives(tmp_path):
    text = '[rules.press_late.when]\nmajor = { measure = "coordination_s", is = ">", limit = 1.2 }\n'
    mine = {rule.id: rule for rule in load_rules(written(tmp_path, text)).rules}
    theirs = {rule.id: rule for rule in load_rules().rules}
    assert mine["press_late"].levels[0].when.limit.number == 1.2
    assert mine["press_late"].source == theirs["press_late"].source
    assert {id_: rule for id_, rule in mine.items() if id_ != "press_late"} == {
        id_: rule for id_, rule in theirs.items() if id_ != "press_late"
    }


def test_users_file_adds_a_rule_after_the_others(tmp_path):
    rules = load_rules(written(tmp_path, OWN_RULE))
    assert rules.profile == "own"
    assert rules.rules[-1].id == "own_rule"
    assert rules.rules[-1].levels[0].severity is Severity.MINOR
    assert len(rules.rules) == len(load_rules().rules) + 1


def test_users_file_may_build_on_strict_or_stand_alone(tmp_path):
    strict = load_rules(written(tmp_path, 'base = "strict"\n'))
    assert strict.digest == load_rules("strict").digest
    alone = load_rules(written(tmp_path, 'base = "none"\n' + OWN_RULE))
    assert [rule.id for rule in alone.rules] == ["own_rule"]


def test_rule_can_be_given_up_as_never_decided_with_a_reason(tmp_path):
    mine = load_rules(written(tmp_path, '[rules.order_wrong]\nnever_decided = "this clinic teaches another order"\n'))
    rule = next(rule for rule in mine.rules if rule.id == "order_wrong")
    assert rule.levels == ()
    assert rule.never_decided == "this clinic teaches another order"


def test_strict_is_never_milder_than_default():
    strict = {rule.id: rule for rule in load_rules("strict").rules}
    for rule in load_rules("default").rules:
        assert {level.severity for level in rule.levels} <= {level.severity for level in strict[rule.id].levels}
    assert isinstance(strict["inhalation_too_short"].levels[-1].when, AnyOf)


ODD = [
    ("colour = 1", ("field colour is unknown", "profile")),
    ('format = "inhalemon-rules/9"', ("format", "inhalemon-rules/9", "inhalemon-rules/1")),
    ('base = "lenient"', ("base", "'lenient'", "default, strict, none")),
    ("rules = 3", ("rules is 3", "[rules.ID]")),
    ("[rules]\npress_late = 3", ("rule press_late", "3")),
    ('[rules."Own Rule"]', ("Own Rule", "lower-case")),
    ("[rules.press_late]\ndevices = []", ("rule press_late", "devices", "[]", "pmdi, ellipta")),
    ('[rules.press_late]\ndevices = ["spacer"]', ("rule press_late", "devices", "spacer")),
    ('[rules.press_late]\nunits = "s"', ("rule press_late", "units", "unknown")),
    ('[rules.press_late]\nunit = "deg"', ("rule press_late", "unit", "'deg'", "the unit of its measures, s")),
    ('[rules.press_late]\nevidence = "A"', ("rule press_late", "evidence", "'A'", "S, Q, E")),
    ('[rules.press_late]\nmessage = ""', ("rule press_late", "message", "a text")),
    ('[rules.press_late]\nmessage = "{value.real}"', ("rule press_late", "message", "{value} and {limit} only")),
    ('[rules.press_late]\nmessage = "{"', ("rule press_late", "message", "{value} and {limit} only")),
    ('[rules.press_late]\nimplied_by = ["no_such"]', ("rule press_late", "implied_by", "'no_such'", "another rule")),
    ('[rules.press_late]\nimplied_by = "no_press"', ("rule press_late", "implied_by", "a list of rule ids")),
    ('[rules.no_press]\nimplied_by = ["press_late"]', ("circle", "no_press", "press_late")),
    ("[rules.press_late.when]", ("rule press_late", "when", "critical, major, minor")),
    ("[rules.press_late.when]\nfatal = {}", ("rule press_late", "when.fatal is unknown", "critical, major, minor")),
    ("[rules.press_late.when]\nmajor = 3", ("when.major", "3", "a comparison")),
    ("[rules.press_late.when]\nmajor = {any = []}", ("when.major.any", "a list of conditions")),
    ("[rules.press_late.when]\nmajor = {any = [3]}", ("when.major.any[0]", "3", "a comparison")),
    ('[rules.press_late.when]\nmajor = {any = [{needs = "x"}], all = []}', ("when.major.all is unknown",)),
    ('[rules.press_late.when]\nmajor = {needs = "lag_s"}', ("when.major.needs", "'lag_s'", "coordination_s")),
    ('[rules.press_late.when]\nmajor = {measure = "lag_s", is = ">", limit = 1}', ("when.major.measure", "'lag_s'")),
    ('[rules.press_late.when]\nmajor = {measure = "coordination_s", is = "=", limit = 1}', ("when.major.is", "'='")),
    ('[rules.press_late.when]\nmajor = {measure = "coordination_s", is = ">"}', ("when.major.limit", "None")),
    ('[rules.press_late.when]\nmajor = {measure = "coordination_s", is = ">", limit = nan}', ("limit", "nan")),
    ('[rules.press_late.when]\nmajor = {measure = "coordination_s", is = ">", limit = true}', ("limit", "True")),
    (
        '[rules.press_late.when]\nmajor = {measure = "coordination_s", is = ">", limit = 1, dead_band = -1}',
        ("when.major.dead_band", "-1", "0 or more"),
    ),
    (
        '[rules.press_late.when]\nmajor = {measure = "coordination_s", is = ">", limit = {travel = 0.5}}',
        ("when.major.limit", "a fraction of the travel is in deg"),
    ),
    (
        '[rules.press_late]\nwhen.major = {measure = "coordination_s", is = ">", limit = {measure = "press_count"}}',
        ("when.major.limit", "'press_count'", "a measure in s"),
    ),
    (
        '[rules.press_incomplete.when]\nmajor = {measure = "press_angle_deg", is = "<", limit = {travel = -1}}',
        ("when.major.limit.travel", "-1", "fraction"),
    ),
    ('[rules.new]\ntitle = "New"', ("rule new", "devices", "missing")),
    ("[rules.flow.when]\nminor = {}\n[rules.flow]\nnever_decided = 3", ("own.toml",)),
    ("[rules.press_incomplete.doubt]\nreason = 'x'", ("press_incomplete", "doubt.when", "missing")),
    ("[rules", ("own.toml", "readable TOML")),
    ("x = " + "[" * 5000, ("own.toml", "readable TOML")),
    (
        '[rules.press_late]\nwhen.major = {measure = "coordination_s", is = ">", limit = 1' + "0" * 400 + "}",
        ("when.major.limit", "a number"),
    ),
    ("[rules.press_late.when]\nmajor = " + "{any = [" * 9 + "1" + "]}" * 9, ("when.major", "a comparison")),
]


@pytest.mark.parametrize(("text", "words"), ODD)
def test_odd_rule_file_is_refused_with_file_rule_field_found_and_wanted(tmp_path, text, words):
    with pytest.raises(RulesError) as caught:
        load_rules(written(tmp_path, text))
    for word in ("own.toml", *words):
        assert word in str(caught.value)


def test_unknown_profile_names_those_that_exist():
    with pytest.raises(RulesError, match="'lenient'; expected one of default, strict, or the path"):
        load_rules("lenient")


@pytest.mark.parametrize("odd", ["nowhere.toml", "\0.toml", "."])
def test_rule_file_that_is_not_there_is_refused(odd):
    with pytest.raises(RulesError):
        load_rules(odd)


def test_rule_may_compare_two_measures(tmp_path):
    text = OWN_RULE.replace("limit = 4.0", 'limit = { measure = "inhalation_s" }')
    rule = load_rules(written(tmp_path, text)).rules[-1]
    assert rule.levels[0].when.limit.measure == "inhalation_s"


def test_explanation_tells_limits_severities_measures_evidence_and_source():
    text = explain("press_late", load_rules())
    for words in ("major: coordination_s > 0.9 s", "critical:", "negative is early", "Evidence Q", "IPCRG", "no_press"):
        assert words in text
    assert "Never decided: attitude and motion" in explain("flow", load_rules())
    with pytest.raises(RulesError, match="'late'; expected one of not_shaken"):
        explain("late", load_rules())


@pytest.mark.parametrize("profile", ["default", "strict"])
def test_every_rule_can_be_explained(profile):
    rules = load_rules(profile)
    for rule in rules.rules:
        assert rule.source in explain(rule.id, rules)


def test_shipped_files_use_no_measure_that_the_report_does_not_explain():
    text = resources.files("inhalemon").joinpath("data/rules/default.toml").read_text(encoding="utf-8")
    used = set(re.findall(r'measure = "([a-z_]+)"', text))
    assert used <= set(MEASURES) | set(INTERNAL_MEASURES)
    assert set(INTERNAL_MEASURES) <= used
