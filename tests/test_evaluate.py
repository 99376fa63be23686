"""Reports against labels: hand-counted sessions, and scikit-learn as the independent program."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from sklearn.metrics import cohen_kappa_score, f1_score, precision_score, recall_score

from inhalemon.evaluate import agreement, evaluate, session_from_labels, session_from_report
from inhalemon.evaluate.agreement import wilson_interval
from inhalemon.exceptions import LabelsError

counts = st.integers(0, 60)


def report(session_id, verdicts=None, *, phases=(), events=(), measures=None, reasons=None):
    return {
        "format": "inhalemon-report/1",
        "session_id": session_id,
        "findings": [
            {"rule": rule, "verdict": verdict, "reason": (reasons or {}).get(rule)}
            for rule, verdict in (verdicts or {}).items()
        ],
        "phases": [{"kind": kind, "start_s": start, "end_s": end, "confidence": 1.0} for kind, start, end in phases],
        "events": [
            {"kind": kind, "start_s": start, "peak_s": peak, "end_s": end, "angle_deg": 12.0}
            for kind, start, peak, end in events
        ],
        "measures": measures or {},
    }


def labels(session_id, mistakes=(), **parts):
    rest = report(session_id, **parts)
    return {**rest, "format": "inhalemon-labels/1", "mistakes": list(mistakes)}


def compared(reports, truth):
    return evaluate(map(session_from_report, reports), map(session_from_labels, truth))


@given(counts, counts, counts, counts)
def test_f1_and_kappa_agree_with_scikit_learn(tp, fp, fn, tn):
    truth = np.repeat([1, 0, 1, 0], [tp, fp, fn, tn])
    judged = np.repeat([1, 1, 0, 0], [tp, fp, fn, tn])
    assume(tp + fp > 0 and tp + fn > 0 and 0 < truth.sum() + judged.sum() < 2 * truth.size)
    found = agreement(tp, fp, fn, tn)
    assert found.precision == pytest.approx(precision_score(truth, judged))
    assert found.recall == pytest.approx(recall_score(truth, judged))
    assert found.f1 == pytest.approx(f1_score(truth, judged))
    assert found.kappa == pytest.approx(cohen_kappa_score(truth, judged), abs=1e-12)


@given(counts, counts, counts)
def test_f1_interval_holds_the_estimate_and_stays_within_its_bounds(tp, fp, fn):
    assume(tp + fp + fn > 0)
    found = agreement(tp, fp, fn, 10)
    low, high = found.f1_interval
    assert 0.0 <= low <= found.f1 + 1e-12
    assert found.f1 - 1e-12 <= high <= 1.0
    assert high - low > 0.0, "a perfect score from few sessions is not a certainty"


def test_f1_interval_is_the_wilson_interval_worked_by_hand():
    """30 found, 2 false, 3 missed: j = 30/35; Wilson (centre 0.8218, half 0.1156) gives 0.7062-0.9374 within 5e-4."""
    low, high = wilson_interval(30, 35)
    assert (low, high) == (pytest.approx(0.7062, abs=5e-4), pytest.approx(0.9374, abs=5e-4))
    f1_low, f1_high = agreement(30, 2, 3, 65).f1_interval
    assert f1_low == pytest.approx(2 * low / (1 + low))
    assert f1_high == pytest.approx(2 * high / (1 + high))


def test_kappa_interval_covers_the_true_kappa_as_often_as_it_says():
    """2000 draws of 150 judgements of a known table: 95 % coverage within four deviations of a binomial count."""
    p = np.array([0.30, 0.06, 0.08, 0.56])
    expected = 0.36 * 0.38 + 0.64 * 0.62
    true = (0.86 - expected) / (1 - expected)
    draws = np.random.default_rng(4).multinomial(150, p, size=2000)
    covered = 0
    for tp, fp, fn, tn in draws.tolist():
        low, high = agreement(tp, fp, fn, tn).kappa_interval
        covered += low <= true <= high
    assert abs(covered / 2000 - 0.95) < 4 * math.sqrt(0.95 * 0.05 / 2000) + 0.005  # and half a percent for n = 150


def test_kappa_of_two_judges_who_say_only_one_thing_is_undefined():
    assert agreement(0, 0, 0, 25).kappa is None
    assert agreement(0, 0, 0, 25).f1 is None


def test_each_verdict_lands_where_it_should_be_counted():
    rule = "press_late"
    verdicts = ["fail", "fail", "pass", "indeterminate", "not_assessable", "pass", "indeterminate", "not_assessable"]
    labelled = [True, False, True, True, True, False, False, False]
    result = compared(
        [report(f"s{k}", {rule: verdict}) for k, verdict in enumerate(verdicts)],
        [labels(f"s{k}", [rule] if is_labelled else []) for k, is_labelled in enumerate(labelled)],
    ).rules[rule]
    counted = result.agreement
    assert (counted.tp, counted.fp, counted.fn, counted.tn) == (1, 1, 3, 3)
    assert (result.missed_as_indeterminate, result.missed_as_not_assessable) == (1, 1)
    assert (result.doubted, result.not_assessed) == (1, 1)


def test_macro_f1_is_the_mean_over_rules_that_occurred():
    result = compared(
        [
            report("a", {"no_press": "fail", "press_late": "pass", "order_wrong": "pass"}),
            report("b", {"press_late": "pass"}),
        ],
        [labels("a", ["no_press"]), labels("b", ["press_late"])],
    )
    assert result.rules["order_wrong"].agreement.f1 is None
    assert result.macro_f1 == pytest.approx((1.0 + 0.0) / 2)


def test_what_sensors_cannot_see_is_shown_apart_and_not_counted():
    result = compared(
        [report("a", {"lip_seal": "not_assessable"}, reasons={"lip_seal": "not_observable"})],
        [labels("a", ["lip_seal"])],
    )
    assert result.rules == {}
    assert result.not_observable == {"lip_seal": 1}


def test_mistakes_of_an_unusable_recording_count_as_missed():
    unusable = {"format": "inhalemon-error/1", "file": "folder/a.csv.gz", "error": {"code": "not_a_number"}}
    result = compared([unusable], [labels("a", ["no_press"])])
    assert result.n_unusable == 1
    assert result.rules["no_press"].agreement.fn == 1


@pytest.mark.parametrize("suffix", ["csv", "csv.gz", "csv.zst"])
def test_mistakes_of_an_unusable_recording_are_found_by_its_session_whatever_the_file_is_called(tmp_path, suffix):
    file = tmp_path / f"s.{suffix}"
    file.write_bytes(b"half a recording")
    (tmp_path / "s.json").write_text('{"format": "inhalemon-recording/1", "session_id": "visit-7"}')
    unusable = {"format": "inhalemon-error/1", "file": str(file), "error": {"code": "wrong_header"}}
    result = compared([unusable], [labels("visit-7", ["no_press"])])
    assert result.rules["no_press"].agreement.fn == 1
    assert result.without_labels == result.without_report == ()


def test_boundary_errors_are_report_less_label_of_the_best_overlap():
    result = compared(
        [report("a", phases=[("shake", 0.1, 2.0), ("handling", 2.0, 3.0), ("shake", 3.0, 3.2), ("inhale", 3.2, 6.0)])],
        [labels("a", phases=[("shake", 0.0, 2.2), ("inhale", 3.0, 6.0)])],
    )
    shake, inhale = result.phases["shake"], result.phases["inhale"]
    assert (shake.n_labelled, shake.n_reported, shake.n_matched) == (1, 2, 1)
    assert shake.f1 == pytest.approx(2 / 3)
    assert shake.start_s.bias == pytest.approx(0.1)
    assert shake.end_s.bias == pytest.approx(-0.2)
    assert inhale.start_s.bias == pytest.approx(0.2)
    assert result.frame_accuracy == pytest.approx((1.9 + 2.8) / 5.2)
    assert result.segmental_f1_50 == pytest.approx(2 * 2 / (2 + 4))


def test_an_event_matches_one_of_its_kind_within_half_a_second():
    result = compared(
        [report("a", events=[("press", 1.02, 1.1, 1.6), ("press", 5.0, 5.1, 5.4), ("open", 9.0, 9.2, 9.3)])],
        [labels("a", events=[("press", 1.0, 1.1, 1.5), ("press", 5.7, 5.8, 6.0)])],
    )
    press = result.events["press"]
    assert (press.n_labelled, press.n_reported, press.n_matched) == (2, 2, 1)
    assert press.start_s.bias == pytest.approx(0.02)
    assert result.events["open"].f1 == 0.0


def test_measure_errors_their_spread_and_their_honesty():
    values = [(1.0, 1.1, 0.1), (2.0, 1.8, 0.1), (3.0, 3.3, 0.2)]
    result = compared(
        [
            *(
                report(f"s{k}", measures={"inhalation_s": {"value": got, "sd": sd}})
                for k, (_, got, sd) in enumerate(values)
            ),
            report("s3", measures={"inhalation_s": {"value": None, "sd": None, "reason": "no_inhalation"}}),
        ],
        [labels(f"s{k}", measures={"inhalation_s": true}) for k, true in enumerate([1.0, 2.0, 3.0, 4.0])],
    ).measures["inhalation_s"]
    assert result.n_missing == 1
    assert result.error.n == 3
    assert result.error.bias == pytest.approx(0.2 / 3)
    assert result.error.median_abs == pytest.approx(0.2)
    assert result.error.p95_abs == pytest.approx(0.29)
    assert result.normalised_error == pytest.approx(math.sqrt((1.0**2 + 2.0**2 + 1.5**2) / 3))


def test_sessions_without_a_partner_are_named():
    result = compared([report("a"), report("b")], [labels("a"), labels("c")])
    assert result.without_report == ("c",)
    assert result.without_labels == ("b",)


@pytest.mark.parametrize(
    ("reports", "truth", "said"),
    [
        ([report("a")], [labels("b")], "equal session_id"),
        ([report("a"), report("a")], [labels("a")], "more than one report"),
        ([{"format": "else"}], [labels("a")], "inhalemon-report/1"),
        ([report("a")], [{"format": "inhalemon-labels/1", "session_id": "a"}], "mistakes is missing"),
        ([report("a", {"no_press": "perhaps"})], [labels("a")], "'perhaps' is not a valid Verdict"),
        ([report("a")], [labels("a", phases=[("inhale", "soon", 2.0)])], "'soon' is not a number"),
    ],
)
def test_documents_that_cannot_be_compared_are_refused_with_the_reason(reports, truth, said):
    with pytest.raises(LabelsError, match=said):
        compared(reports, truth)
