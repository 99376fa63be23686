"""The written rules, the examples of how to extend them, and the glossary agree with the code."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import pytest

from inhalemon.devices import load_device
from inhalemon.measures import MEASURES
from inhalemon.report.flat import csv_columns
from inhalemon.rules import load_rules

DOCS = Path(__file__).parents[1] / "docs"


def examples():
    text = (DOCS / "extending.md").read_text(encoding="utf-8")
    return re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)


def test_rules_page_is_the_one_that_the_script_writes():
    spec = importlib.util.spec_from_file_location("make_rules", DOCS / "make_rules.py")
    make_rules = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_rules)
    assert make_rules.TARGET.read_text(encoding="utf-8") == make_rules.rules_page(), f"run {spec.origin}"


def test_rules_page_tells_every_rule_and_source():
    text = (DOCS / "rules.md").read_text(encoding="utf-8")
    for rule in load_rules().rules:
        assert f"`{rule.id}`" in text
        assert rule.never_decided is not None or rule.source in text


@pytest.mark.parametrize("example", [text for text in examples() if "[rules." in text])
def test_rule_examples_of_the_docs_can_be_loaded(tmp_path, example):
    path = tmp_path / "clinic.toml"
    path.write_text(example, encoding="utf-8")
    assert load_rules(path).digest != load_rules().digest


def test_device_example_of_the_docs_can_be_loaded(tmp_path):
    (example,) = (text for text in examples() if "hinge_axis" in text)
    path = tmp_path / "my_inhaler.toml"
    path.write_text(example, encoding="utf-8")
    assert load_device(path).is_calibrated


def test_glossary_tells_every_measure_in_the_words_of_the_code():
    text = (DOCS / "glossary.md").read_text(encoding="utf-8")
    for name, meaning in MEASURES.items():
        assert f"- `{name}`: {meaning}." in text


def test_columns_of_the_csv_are_those_of_the_docs():
    text = (DOCS / "report.md").read_text(encoding="utf-8")
    told = re.findall(r"`([a-z_]+)`", text[text.index("## CSV") : text.index("## The page")])
    rules = {rule.id for rule in load_rules().rules}
    assert [column for column in csv_columns() if column not in MEASURES and column not in rules] == told


def test_fields_of_the_report_are_those_of_the_docs():
    text = (DOCS / "report.md").read_text(encoding="utf-8")
    table = text[text.index("| field |") : text.index("The phases `exhale`")]
    told = {name for row in table.splitlines()[2:] if row for name in re.findall(r"`([a-z_]+)`", row.split("|")[1])}
    schema = json.loads((DOCS / "schema" / "report-1.json").read_text(encoding="utf-8"))
    assert told == set(schema["required"]) - {"format"}
