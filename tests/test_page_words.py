"""What the pages say has a translation, and every translation is said somewhere."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from api import problems, rendering
from api.pages import upload
from api.principal import Role, Scope
from api.store.listing import Order
from api.store.reviews import ReviewKind
from api.store.sessions import State
from api.words import Words, catalogue, preferred
from inhalemon.measures import MEASURES
from inhalemon.pipeline import score_recording
from inhalemon.report.panels import panel_kinds
from inhalemon.report.words import DISCLAIMER, INFERRED
from inhalemon.rules import load_rules
from inhalemon.simulate import simulate_session
from inhalemon.values import (
    DeviceKind,
    EventKind,
    Grade,
    ImuTrack,
    PhaseKind,
    Recording,
    SensorName,
    Severity,
    Verdict,
)

API = Path(__file__).parents[1] / "api"
RULES = load_rules("default").rules


def _said() -> set[str]:
    """English texts in templates and pages."""
    texts = {DISCLAIMER, INFERRED, *(place.title for place in rendering._PLACES), *upload._SAID_BY_THE_SCRIPT.values()}
    for part in ("lever", "cover", "second part"):
        for panel in panel_kinds(part):
            texts |= set() if panel.is_log else {panel.title, *(curve.name for curve in panel.curves)} - {"y", "z"}
    for path in (API / "templates").glob("*.html"):
        text = path.read_text(encoding="utf-8")
        texts |= set(re.findall(r"\bt\(\s*'([^']*)'", text))
        for columns in re.findall(r"for column in \(([^)]*)\)", text):
            texts |= set(re.findall(r"'([^']*)'", columns))
    for path in [*(API / "pages").glob("*.py"), API / "words.py"]:
        texts |= set(re.findall(r'\b(?:words|self)\(\s*"([^"]*)"', path.read_text(encoding="utf-8")))
    return texts


def test_every_text_of_the_pages_is_translated() -> None:
    assert sorted(_said() - catalogue("ja")["texts"].keys()) == []


def test_translations_keep_the_places_of_their_texts() -> None:
    for text, translated in catalogue("ja")["texts"].items():
        assert sorted(re.findall(r"\{\w+\}", text)) == sorted(re.findall(r"\{\w+\}", translated)), text


def test_every_translation_is_said_somewhere() -> None:
    sources = [path for folder in ("templates", "pages", "routes") for path in (API / folder).glob("*.*")]
    everything = "\n".join(path.read_text(encoding="utf-8") for path in [*sources, *API.glob("*.py")])
    known = _said() | {text for text in catalogue("ja")["texts"] if text in everything}
    assert sorted(catalogue("ja")["texts"].keys() - known) == []


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("device", DeviceKind),
        ("grade", Grade),
        ("severity", Severity),
        ("verdict", Verdict),
        ("phase", PhaseKind),
        ("event", EventKind),
        ("sensor", SensorName),
        ("role", Role),
        ("scope", Scope),
        ("kind", ReviewKind),
        ("order", Order),
        ("state", State),
        ("measure", MEASURES),
        ("rule", [rule.id for rule in RULES]),
    ],
)
def test_every_name_has_a_japanese_one(kind: str, names: list[str]) -> None:
    assert [str(name) for name in names if str(name) not in Words("ja").names(kind)] == []


def test_every_problem_has_a_japanese_title() -> None:
    def kinds(error: type[problems.ProblemError]) -> set[str]:
        return {error.kind}.union(*(kinds(each) for each in error.__subclasses__()))

    assert sorted(kinds(problems.ProblemError) - Words("ja").names("problem").keys()) == []


def test_every_verdict_of_every_rule_can_be_told_in_japanese() -> None:
    for rule in RULES:
        verdicts = (Verdict.NOT_ASSESSABLE,) if rule.never_decided else tuple(Verdict)
        for verdict in verdicts:
            told = Words("ja").told(
                rule.id, verdict, value=1.25, limit=2.0, unit=rule.unit, reason="not_observable", message="English"
            )
            assert re.search(r"[ぁ-ん]", told), (rule.id, verdict)


@pytest.mark.parametrize(
    ("cookie", "accepted", "language"),
    [
        (None, "", "en"),
        (None, "ja", "ja"),
        (None, "ja-JP,en;q=0.9", "ja"),
        (None, "de,en;q=0.8,ja;q=0.7", "en"),
        (None, "fr, ja;q=0.1", "ja"),
        (None, "ja;q=0, *", "en"),
        (None, ";;q=x,ja;q=oops", "en"),
        ("ja", "en", "ja"),
        ("xx", "ja", "ja"),
    ],
)
def test_language_is_the_chosen_one_or_the_first_accepted(cookie: str | None, accepted: str, language: str) -> None:
    assert preferred(cookie, accepted) == language


def _kept(track: ImuTrack, is_kept: np.ndarray) -> ImuTrack:
    return ImuTrack(track.time_s[is_kept], track.acc_m_s2[is_kept], track.gyr_rad_s[is_kept])


def _spoilt(recording: Recording) -> Iterator[Recording]:
    """The recording with one or another thing doubtful about it."""
    body, lever = recording.body, recording.lever
    n, middle = np.arange(body.n_samples), body.n_samples // 2
    is_fast, is_pushed = (np.abs(body.gyr_rad_s) > 1.0).any(axis=1), (np.abs(body.acc_m_s2) > 12.0).any(axis=1)
    turned = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for other in (
        _kept(body, np.abs(n - middle) > 20),
        _kept(body, (n < middle) | (n % 2 == 0)),
        _kept(body, (body.time_s > 4.0) & (body.time_s < body.time_s[-1] - 8.0)),
        replace(body, is_gyr_saturated=is_fast, is_acc_saturated=is_pushed),
        replace(body, acc_m_s2=1.1 * body.acc_m_s2),
        replace(body, gyr_rad_s=np.radians(body.gyr_rad_s)),
    ):
        yield replace(recording, body=other)
    for other in (
        _kept(lever, lever.time_s < lever.time_s[-1] / 2),
        replace(lever, gyr_rad_s=np.full_like(lever.gyr_rad_s, 0.25)),
        replace(lever, time_s=1.0006 * lever.time_s + 0.4),
        replace(lever, acc_m_s2=lever.acc_m_s2 @ turned, gyr_rad_s=lever.gyr_rad_s @ turned),
    ):
        yield replace(recording, lever=other)
    yield replace(recording, body=lever, lever=body)


def test_what_is_doubtful_about_a_recording_is_told_with_its_numbers_in_japanese() -> None:
    recording, _ = simulate_session("pmdi", seed=2, rate_hz=50.0)
    seen = set()
    for spoilt in _spoilt(recording):
        for flag in score_recording(spoilt).quality.flags:
            seen.add(flag.code)
            told = Words("ja").flag(flag.code, flag.detail)
            assert told is not None, flag
            assert re.findall(r"\d[\d.]*", told.replace("²", "")) or flag.code == "clock_unknown", told
            assert Words("en").flag(flag.code, flag.detail) is None, "the report's own words are English"
    assert seen >= catalogue("ja")["names"]["flag"].keys() - {"angle_unsure", "hinge_axis_off"}
    assert catalogue("ja")["names"]["flag_detail"].keys() == catalogue("ja")["names"]["flag"].keys()
    assert Words("ja").flag("gap", "a wording with one number: 3") is None
