"""Reports for the terminal: one session in full, or many, a row each with its mistakes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from inhalemon.exceptions import InhalemonError
from inhalemon.measures import INTERNAL_MEASURES, unit_of
from inhalemon.report.words import DISCLAIMER, GRADES
from inhalemon.values import Finding, Grade, Report, Severity, Verdict
from inhalemon.words import in_words, number

_SEVERITY_STYLE: Final = {Severity.CRITICAL: "bold red", Severity.MAJOR: "yellow", Severity.MINOR: "cyan"}
_GRADE_STYLE: Final = {
    Grade.CORRECT: "green",
    Grade.MINOR_MISTAKES: "cyan",
    Grade.MAJOR_MISTAKES: "yellow",
    Grade.CRITICAL_MISTAKES: "bold red",
    Grade.NOT_ASSESSABLE: "dim",
}
_ORDER: Final = (Verdict.FAIL, Verdict.INDETERMINATE, Verdict.PASS, Verdict.NOT_ASSESSABLE)


def sessions_table(sessions: Iterable[tuple[str, Report | InhalemonError]]) -> Table:
    """A row a session: device, points, grade, and each mistake with its value and limit on a line of its own.

    Behind the mistakes comes what could not be decided, and which critical rule could not be assessed, and why.
    """
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("session", no_wrap=True)
    table.add_column("device")
    table.add_column("points", justify="right")
    table.add_column("grade")
    table.add_column("mistakes; ? is undecided, – not assessed")
    for file, outcome in sessions:
        if isinstance(outcome, Report):
            table.add_row(*_row(outcome))
        else:
            table.add_row(_plain(file), "", "", Text("not usable", "red"), _plain(str(outcome)))
    return table


def session_table(report: Report) -> RenderableType:
    """Everything that the report says of one session: score, findings, measures, phases, what is doubtful."""
    head = Text.assemble(
        (_clean(report.session_id), "bold"),
        f"  {report.device}  {report.duration_s:.1f} s  ",
        _grade(report),
        f"  {report.score.points} of 100 points",
    )
    doses = f"{len(report.doses)} doses; shown is the worst verdict of each rule" if len(report.doses) > 1 else ""
    parts: list[RenderableType] = [head, *([Text(doses)] if doses else []), _findings(report)]
    unseen = [finding for finding in report.findings if finding.reason == "not_observable"]
    if unseen:
        parts.append(Text("Never seen by these sensors: " + ", ".join(in_words(f.rule) for f in unseen), "dim"))
    parts += [_measures(report), _phases(report)]
    parts += [Text(f"doubtful: {flag.code}: {_clean(flag.detail)}", "yellow") for flag in report.quality.flags]
    if not report.quality.usable:
        parts.append(Text("Attitude or angle cannot be trusted in this session.", "bold red"))
    return Group(*parts, Text(DISCLAIMER, "dim"))


def _row(report: Report) -> tuple[RenderableType, ...]:
    told = [f for f in report.findings if f.verdict is Verdict.FAIL]
    told += [f for f in report.findings if f.verdict is Verdict.INDETERMINATE]
    told += [f for f in report.findings if f.verdict is Verdict.NOT_ASSESSABLE and f.severity is Severity.CRITICAL]
    lines = [Text.assemble(_mark(finding), finding.rule, "  ", (_against(finding), "dim")) for finding in told]
    return (
        _plain(report.session_id),
        str(report.device),
        str(report.score.points),
        _grade(report),
        Text("\n").join(lines) if lines else Text("none" if report.findings else "", "green"),
    )


def _mark(finding: Finding) -> tuple[str, str]:
    if finding.verdict is Verdict.FAIL and finding.severity is not None:
        return f"{finding.severity:<9}", _SEVERITY_STYLE[finding.severity]
    return f"{'?' if finding.verdict is Verdict.INDETERMINATE else '–':<9}", "dim"


def _against(finding: Finding) -> str:
    if finding.verdict is Verdict.NOT_ASSESSABLE:
        return _clean(in_words(finding.reason or ""))
    if finding.value is None or finding.limit is None:
        return ""
    return f"{number(finding.value, finding.unit)}, limit {number(finding.limit, finding.unit)}"


def _findings(report: Report) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for column in ("verdict", "rule", "value", "limit", "what was found"):
        table.add_column(column, justify="right" if column in ("value", "limit") else "left")
    for verdict in _ORDER:
        for finding in report.findings:
            if finding.verdict is verdict and finding.reason != "not_observable":
                style = (
                    _SEVERITY_STYLE.get(finding.severity, "") if verdict is Verdict.FAIL and finding.severity else ""
                )
                style = style or {Verdict.PASS: "green", Verdict.FAIL: "red"}.get(verdict, "dim")
                word = str(finding.severity) if verdict is Verdict.FAIL else verdict.replace("_", " ")
                value, limit = (number(each, finding.unit) for each in (finding.value, finding.limit))
                table.add_row(Text(word, style), finding.rule, value, limit, _plain(finding.message))
    return table


def _measures(report: Report) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for column in ("measure", "value", "± sd", ""):
        table.add_column(column, justify="right" if column in ("value", "± sd") else "left")
    for name, measure in report.measures.items():
        if name in INTERNAL_MEASURES:
            continue
        unit = unit_of(name)
        why = in_words(measure.reason) if measure.value is None and measure.reason else ""
        table.add_row(name, number(measure.value, unit), number(measure.sd, unit), Text(why, "dim"))
    return table


def _phases(report: Report) -> Text:
    spans = (f"{in_words(phase.kind)} {phase.start_s:.1f}–{phase.end_s:.1f} s" for phase in report.phases)
    return Text("Phases: " + ", ".join(spans) if report.phases else "No phases.")


def _grade(report: Report) -> Text:
    return Text(GRADES[report.score.grade], _GRADE_STYLE[report.score.grade])


def _plain(text: str) -> Text:
    return Text(_clean(text))


def _clean(text: str) -> str:
    """Without control characters, which a terminal would obey."""
    return "".join(letter if letter.isprintable() else "�" for letter in text)
