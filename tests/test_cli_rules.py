"""rules and explain: every shipped rule is listed and explained."""

from __future__ import annotations

import pytest

from inhalemon.cli import run
from inhalemon.rules import load_rules


def test_every_rule_is_listed_with_its_severities(capsys):
    assert run(["rules"]) == 0
    said = capsys.readouterr().out
    for rule in load_rules().rules:
        assert f" {rule.id} " in said


def test_only_the_rules_of_the_device_are_listed(capsys):
    assert run(["rules", "--device", "ellipta", "--rules", "strict"]) == 0
    said = capsys.readouterr().out
    assert "cover_not_closed" in said
    assert "press_late" not in said
    assert said.startswith("Profile strict")


@pytest.mark.parametrize("rule", [rule.id for rule in load_rules().rules])
def test_each_rule_is_explained_with_its_source(rule, capsys):
    assert run(["explain", rule]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{rule}: ")
    assert "\nSource: " in said


def test_an_unknown_rule_or_device_is_wrong_usage_and_a_bad_rule_file_is_not(tmp_path, capsys):
    assert run(["explain", "nonsense"]) == 2
    assert run(["rules", "--device", "nonsense"]) == 2
    (tmp_path / "bad.toml").write_text("[rules.press_late]\nseverity = 3\n")
    assert run(["rules", "--rules", str(tmp_path / "bad.toml")]) == 4
    assert "press_late" in capsys.readouterr().err


def test_a_rule_file_of_ones_own_changes_what_is_explained(tmp_path, capsys):
    (tmp_path / "mine.toml").write_text('[rules.press_late]\ntitle = "Pressed far too late"\n')
    assert run(["explain", "press_late", "--rules", str(tmp_path / "mine.toml")]) == 0
    assert "Pressed far too late" in capsys.readouterr().out
