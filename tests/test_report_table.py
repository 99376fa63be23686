"""Reports in the terminal."""

from __future__ import annotations

import dataclasses
import io

from reports import made_dose, made_report
from rich.console import Console

from inhalemon.exceptions import RecordingError
from inhalemon.report.table import session_table, sessions_table
from inhalemon.values import Measure


def printed(renderable, width=120):
    console = Console(file=io.StringIO(), width=width)
    console.print(renderable)
    return console.file.getvalue()


def test_table_of_many_tells_each_mistake_with_value_and_limit():
    error = RecordingError("too_short", file="b.csv", found="1 s", wanted="2 s or more")
    correct = made_report("fine", (made_dose(coordination_s=Measure(0.3), breath_hold_s=Measure(8.0)),))
    text = printed(sessions_table([("a.csv", made_report()), ("c.csv", correct), ("b.csv", error)]))
    assert "press_late" in text
    assert "1.40 s, limit 0.90 s" in text
    assert "major mistakes" in text
    assert "correct" in text
    assert "not usable" in text
    assert "expected 2 s or more" in text


def test_table_of_one_session_tells_findings_measures_phases_flags_and_what_was_not_assessed():
    text = " ".join(printed(session_table(made_report()), width=160).split())
    for words in (
        "85 of 100 points",
        "The press came late",
        "Not assessed: inhalation end not seen",
        "Never seen by these sensors: flow, lip seal",
        "shake_duration_s",
        "breath hold 15.3–20.0 s",
        "doubtful: gap",
        "not a medical device",
    ):
        assert words in text


def test_table_of_many_tells_why_a_session_has_no_grade():
    """The critical rules that could not be assessed, with the reason; implied and never decided ones are left out."""
    unseen = made_dose(**dict.fromkeys(("inhalation_start_s", "inhalation_s"), Measure(None, None, "no_tilt_seen")))
    text = printed(sessions_table([("a", made_report(doses=(unseen,)))]))
    assert "not assessable" in text
    assert "no_inhalation  no tilt seen" in text
    assert "lip_seal" not in text


def test_several_doses_are_told_apart_from_one():
    text = printed(session_table(made_report(doses=(made_dose(), made_dose(24.0)))))
    assert "2 doses; shown is the worst verdict of each rule" in text


def test_session_name_can_neither_colour_nor_command_the_terminal():
    odd = dataclasses.replace(made_report(), session_id="[red]x[/red]\x1b[31mred\r\n")
    for table in (session_table(odd), sessions_table([("a", odd)])):
        text = printed(table)
        assert "\x1b" not in text
        assert "\r" not in text
        assert "[red]x[/red]" in text


def test_narrow_terminal_loses_no_mistake():
    assert "press_late" in printed(sessions_table([("a", made_report())]), width=60)
