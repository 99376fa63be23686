"""Reports as JSON and CSV: the published schemas hold, nothing is lost on the way and back."""

from __future__ import annotations

import csv
import dataclasses
import importlib.util
import io
import json
from pathlib import Path

import jsonschema
import pytest
from reports import made_dose, made_report

from inhalemon.exceptions import RecordingError
from inhalemon.measures import INTERNAL_MEASURES
from inhalemon.pipeline import score_recording
from inhalemon.report.documents import error_to_dict, from_dict, to_dict, to_json
from inhalemon.report.flat import csv_columns, to_csv
from inhalemon.simulate import simulate_session
from inhalemon.values import DeviceKind, Measure, Quality, Report, Score

SCHEMAS = Path(__file__).parents[1] / "docs" / "schema"


def validator(name):
    schema = json.loads((SCHEMAS / name).read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def hinge_report():
    return Report(
        "h",
        DeviceKind.HINGE,
        "1",
        "0" * 64,
        "1" * 64,
        9.0,
        Quality(False),
        (),
        (),
        {},
        (),
        (),
        Score(0, "not_assessable"),
    )


def test_published_schemas_are_those_that_the_script_writes():
    spec = importlib.util.spec_from_file_location("make_schema", SCHEMAS / "make_schema.py")
    make_schema = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_schema)
    for name, schema in make_schema.schemas().items():
        assert (SCHEMAS / name).read_text(encoding="utf-8") == make_schema.as_text(schema), f"run {spec.origin}"


@pytest.mark.parametrize(
    "report",
    [made_report(), made_report(doses=(made_dose(), made_dose(24.0, press_count=Measure(3)))), hinge_report()],
    ids=["one dose", "two doses", "hinge"],
)
def test_report_is_valid_and_survives_the_way_through_json(report):
    document = json.loads(to_json(report))
    validator("report-1.json").validate(document)
    assert to_dict(from_dict(document)) == document


def test_report_has_the_fields_of_the_contract_in_order():
    document = to_dict(made_report())
    assert list(document) == [
        *("format", "session_id", "device", "pipeline_version", "settings_digest", "rules_digest", "duration_s"),
        *("quality", "phases", "events", "measures", "findings", "doses", "score"),
    ]
    late = next(finding for finding in document["findings"] if finding["rule"] == "press_late")
    assert late == {
        "rule": "press_late",
        "verdict": "fail",
        "severity": "major",
        "value": 1.4,
        "limit": 0.9,
        "unit": "s",
        "start_s": 11.4,
        "end_s": 12.8,
        "reason": None,
        "message": "The press came late: 1.4 s, where 0.9 s is the latest wanted.",
    }
    assert document["measures"]["breath_hold_s"] == {"value": None, "sd": None, "reason": "inhalation_end_not_seen"}
    assert not set(INTERNAL_MEASURES) & set(document["measures"])


@pytest.mark.parametrize("odd", [float("nan"), float("inf")])
def test_number_that_is_not_finite_is_null_with_a_reason(odd):
    report = dataclasses.replace(made_report(), measures={"inhalation_s": Measure(odd, odd)})
    document = json.loads(to_json(report))
    validator("report-1.json").validate(document)
    assert document["measures"]["inhalation_s"] == {"value": None, "sd": None, "reason": "not_finite"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.pop("score"), "'score' is a required property"),
        (lambda d: d["measures"].update(lag_s={"value": 1, "sd": None}), "lag_s"),
        (lambda d: d["phases"][0].update(kind="wait"), "'wait' is not one of"),
        (lambda d: d["findings"][0].update(verdict="fail", reason="why"), "'why' is not of type 'null'"),
    ],
)
def test_schema_refuses_what_is_not_a_report(change, words):
    document = to_dict(made_report())
    change(document)
    with pytest.raises(jsonschema.ValidationError, match=words):
        validator("report-1.json").validate(document)


@pytest.mark.parametrize("document", [{}, {"format": "inhalemon-report/1"}, {"format": "inhalemon-error/1"}])
def test_document_that_is_not_a_whole_report_is_refused(document):
    with pytest.raises(ValueError, match="inhalemon-report/1"):
        from_dict(document)


@pytest.mark.parametrize("device", ["pmdi", "ellipta"])
def test_scored_recording_and_its_labels_are_valid(device):
    recording, truth = simulate_session(device, mistakes=("no_exhale_pause",), seed=2, n_doses=2)
    validator("labels-1.json").validate(truth.to_labels())
    document = json.loads(to_json(score_recording(recording)))
    validator("report-1.json").validate(document)
    assert to_dict(from_dict(document)) == document


def test_error_document_is_valid_and_tells_where():
    error = RecordingError("not_finite", file="a.csv", line=812, column="gyr_x_rad_s", found="'nan'", wanted="rad/s")
    document = error_to_dict(error)
    validator("error-1.json").validate(document)
    assert document["file"] == "a.csv"
    assert document["error"]["line"] == 812
    assert document["error"]["detail"] is None


def test_csv_has_the_same_columns_for_reports_and_errors():
    error = RecordingError("too_short", file="b.csv", found="1 s", wanted="2 s or more")
    text = "".join(to_csv([("a.csv", made_report()), ("b.csv", error)]))
    report, failed = csv.DictReader(io.StringIO(text))
    assert tuple(report) == csv_columns()
    assert report["press_late"] == "fail"
    assert report["coordination_s"] == "1.4"
    assert report["breath_hold_s"] == ""
    assert report["cover_not_closed"] == ""
    assert report["mistakes"] == "press_late:major"
    assert failed["error_code"] == "too_short"
    assert failed["session_id"] == "b.csv"


@pytest.mark.parametrize("odd", ["=HYPERLINK(1)", "+1", "-1", "@x", 'a"b,c\nd'])
def test_csv_cell_is_neither_a_formula_nor_breaks_the_row(odd):
    text = "".join(to_csv([("a", dataclasses.replace(made_report(), session_id=odd))]))
    (row,) = csv.DictReader(io.StringIO(text))
    assert row["session_id"].removeprefix("'") == odd
    assert row["session_id"][0] not in "=+-@"
    assert row["device"] == "pmdi"


def test_rule_of_ones_own_stands_in_the_last_columns():
    report = made_report()
    own = dataclasses.replace(report.findings[0], rule="own_rule")
    text = "".join(to_csv([("a", dataclasses.replace(report, findings=(own,)))]))
    (row,) = csv.DictReader(io.StringIO(text))
    assert row["other_rules"] == "own_rule=pass"
