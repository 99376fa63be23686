"""One self-contained HTML page a session: curves, phases, presses, findings, and what could not be assessed.

The page opens offline and asks nothing of any network: its own policy forbids it. Without scripts it still shows
everything; the one script zooms, pans and reads values.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib import resources
from typing import Final

from inhalemon.measures import INTERNAL_MEASURES, MEASURES, unit_of
from inhalemon.report.counted import counted_from, origin_of
from inhalemon.report.curves import Panel
from inhalemon.report.plot import PLOT_HEIGHT, nice_step, panel_html
from inhalemon.report.words import DISCLAIMER, GRADES, INFERRED
from inhalemon.values import DeviceKind, Dose, Event, Finding, Phase, Report, Score, Verdict
from inhalemon.words import brief, in_words, number

_DEVICES: Final = {
    DeviceKind.PMDI: "pressurised inhaler (pMDI)",
    DeviceKind.ELLIPTA: "Ellipta dry-powder inhaler",
    DeviceKind.HINGE: "hinged pair",
}
_HEADINGS: Final = (
    (Verdict.FAIL, "Mistakes"),
    (Verdict.INDETERMINATE, "Undecided"),
    (Verdict.NOT_ASSESSABLE, "Could not be assessed"),
    (Verdict.PASS, "In order"),
)
_TAGS: Final = {
    Verdict.PASS: "in order",
    Verdict.FAIL: "mistake",
    Verdict.INDETERMINATE: "undecided",
    Verdict.NOT_ASSESSABLE: "not assessable",
}
_KEYS: Final = "Curves. Arrow keys move, plus and minus zoom, 0 shows all."
_N_TIME_TICKS: Final = 8
_PLACE: Final = re.compile(r"\{\{([a-z_]+)\}\}")


@dataclass(frozen=True, slots=True)
class ReviewEntry:
    """What one person said, of a rule or (a comment) of the session; without a `verdict`, in words only."""

    who: str
    when: str
    rule: str | None = None
    verdict: Verdict | None = None
    reason: str | None = None


@dataclass(frozen=True, slots=True)
class Review:
    """What people made of a report: the result that holds, who signed that off and when, and all that was said."""

    score: Score
    signed_off: Sequence[str] = ()
    entries: Sequence[ReviewEntry] = ()


@dataclass(frozen=True, slots=True)
class _Told:
    """What the findings are told with."""

    titles: Mapping[str, str] = field(default_factory=dict)
    review: Review | None = None

    def title(self, rule: str) -> str:
        return self.titles.get(rule) or in_words(rule)


def session_page(
    report: Report,
    panels: Sequence[Panel] = (),
    *,
    titles: Mapping[str, str] | None = None,
    review: Review | None = None,
) -> str:
    """The page of one session, whole, as HTML.

    `panels` are its curves (see `curves.session_panels`), `titles` what its rules are called, `review` what people made
    of it.
    """
    told = _Told(titles or {}, review)
    script = _template("page.js")
    origin_s = origin_of(_extent(report, panels)[0])
    report, panels = counted_from(origin_s, report, panels)
    start_s, end_s = _extent(report, panels)
    clock = f", times counted from {origin_s:.0f} s of the body sensor's clock" if origin_s else ""
    places = {
        "policy": escape(content_security_policy()),
        "style": _template("palette.css") + _template("page.css"),
        "script": script,
        "title": escape(report.session_id),
        "device": escape(_DEVICES[report.device]),
        "duration": escape(f"{report.duration_s:.1f} s{clock}"),
        "score": _result(report.score, review),
        "disclaimer": escape(DISCLAIMER),
        "warnings": _warnings(report),
        "curves": _curves(report, panels, start_s, end_s),
        "review": _review(report, told),
        "findings": _doses(report, told),
        "measures": _measures(report),
        "versions": escape(
            f"inhalemon pipeline {report.pipeline_version}, settings {report.settings_digest[:12]}, "
            f"rules {report.rules_digest[:12]}"
        ),
    }
    return _PLACE.sub(lambda place: places[place[1]], _template("page.html"))


def content_security_policy() -> str:
    """The policy under which the page works: its own script and style, and no request at all."""
    digest = hashlib.sha256(_template("page.js").encode()).digest()
    script = base64.b64encode(digest).decode()
    rules = ("default-src 'none'", "style-src 'unsafe-inline'", f"script-src 'sha256-{script}'")
    return "; ".join((*rules, "base-uri 'none'", "form-action 'none'"))


def _template(name: str) -> str:
    return resources.files("inhalemon.report").joinpath(f"templates/{name}").read_text(encoding="utf-8")


def _extent(report: Report, panels: Sequence[Panel]) -> tuple[float, float]:
    times = [float(time) for panel in panels for curve in panel.curves for time in curve.time_s[[0, -1]]]
    times += [time for phase in report.phases for time in (phase.start_s, phase.end_s)]
    return (min(times), max(times)) if times and max(times) > min(times) else (0.0, max(report.duration_s, 1.0))


def _score(score: Score) -> str:
    return (
        f'<p class="score {score.grade}"><strong>{escape(GRADES[score.grade])}</strong>'
        f" <span>{score.points} of 100 points</span></p>"
    )


def _result(machine: Score, review: Review | None) -> str:
    if review is None or review.score == machine:
        return _score(machine)
    return f"{_score(review.score)}<p><small>the machine: {GRADES[machine.grade]}, {machine.points}</small></p>"


def _review(report: Report, told: _Told) -> str:
    if told.review is None:
        return ""
    by_machine = {finding.rule: finding.verdict for finding in report.findings}
    signed = [f'<p class="signed">Signed off by {escape(line)}</p>' for line in told.review.signed_off]
    lines = "".join(
        f"<li>{_said(entry, by_machine, told)} <small>{escape(entry.who)}, {escape(entry.when)}</small></li>"
        for entry in told.review.entries
    )
    head = "".join(signed) or "<p>Not signed off.</p>"
    return f"<section><h2>Review</h2>{head}{f'<ul>{lines}</ul>' if lines else ''}</section>"


def _said(entry: ReviewEntry, by_machine: Mapping[str, Verdict], told: _Told) -> str:
    reason = f": “{escape(entry.reason)}”" if entry.reason else ""
    if entry.rule is None or entry.verdict is None:
        return f"Comment{reason}"
    title, machine = escape(told.title(entry.rule)), by_machine.get(entry.rule)
    if machine is entry.verdict:
        return f"{title}: {_TAGS[entry.verdict]}, confirmed{reason}"
    instead = f" (the machine: {_TAGS[machine]})" if machine is not None else ""
    return f"{title}: {_TAGS[entry.verdict]}{instead}{reason}"


def _warnings(report: Report) -> str:
    lines = [f"<li><b>{escape(in_words(flag.code))}</b> {escape(flag.detail)}</li>" for flag in report.quality.flags]
    if not report.quality.usable:
        lines.insert(0, "<li><b>Not usable:</b> attitude or angle cannot be trusted in this session.</li>")
    return f'<section class="warnings"><h2>Doubtful</h2><ul>{"".join(lines)}</ul></section>' if lines else ""


# ---------------------------------------------------------------------------------------------------------- curves


def _curves(report: Report, panels: Sequence[Panel], start_s: float, end_s: float) -> str:
    if not panels and not report.phases:
        return "<p>No curves.</p>"
    span_s = end_s - start_s
    kinds = dict.fromkeys(phase.kind for phase in report.phases)
    legend = "".join(f'<li><i class="{kind}"></i>{escape(in_words(kind))}</li>' for kind in kinds)
    plots = "".join(panel_html(panel, report.phases, report.events, start_s, end_s) for panel in panels)
    step_s = nice_step(span_s / _N_TIME_TICKS)
    first = -(-start_s // step_s)
    ticks = [step_s * (first + i) for i in range(int(span_s / step_s) + 1) if step_s * (first + i) <= end_s]
    axis = "".join(f'<span style="left:{_percent(t, start_s, span_s)}">{t:g} s</span>' for t in ticks)
    return (
        f'<div id="plots" tabindex="0" role="group" aria-label="{_KEYS}"'
        f' data-start="{start_s:.3f}" data-end="{end_s:.3f}" data-height="{PLOT_HEIGHT:g}">'
        f'<div class="row"><span class="label">phases</span><div class="strip phases">'
        f"{''.join(_band(phase, start_s, span_s) for phase in report.phases)}</div></div>"
        f'<div class="row"><span class="label">events</span><div class="strip events">'
        f"{''.join(_mark(event, start_s, span_s) for event in report.events)}</div></div>"
        f'{plots}<div class="row"><span class="label"></span><div class="strip axis">{axis}</div></div></div>'
        f'<p class="keys"><output id="cursor">Drag to zoom; arrow keys move, + and − zoom, 0 shows all.</output> '
        f'<button type="button" id="all" hidden>Show all</button></p>'
        f'<ul class="legend">{legend}</ul><p class="note">{escape(INFERRED)}</p>'
    )


def _percent(time_s: float, start_s: float, span_s: float) -> str:
    return f"{100 * (time_s - start_s) / span_s:.3f}%"


def _band(phase: Phase, start_s: float, span_s: float) -> str:
    words = f"{in_words(phase.kind)}, {phase.start_s:.2f} to {phase.end_s:.2f} s, confidence {phase.confidence:.2f}"
    left, width = _percent(phase.start_s, start_s, span_s), _percent(phase.end_s - phase.start_s, 0.0, span_s)
    return (
        f'<span class="{phase.kind}" style="left:{left};width:{width}" title="{escape(words)}"'
        f' data-start="{phase.start_s:.3f}" data-end="{phase.end_s:.3f}">{escape(in_words(phase.kind))}</span>'
    )


def _mark(event: Event, start_s: float, span_s: float) -> str:
    name = in_words(event.kind)
    words = (
        f"{name}, {event.start_s:.2f} to {event.end_s:.2f} s, end stop at {event.peak_s:.2f} s, {event.angle_deg:.1f}°"
    )
    return (
        f'<span class="{event.kind}" style="left:{_percent(event.start_s, start_s, span_s)}" title="{escape(words)}"'
        f' data-start="{event.start_s:.3f}">{escape(name)} {event.angle_deg:.0f}°</span>'
    )


# -------------------------------------------------------------------------------------------------------- findings


def _doses(report: Report, told: _Told) -> str:
    if len(report.doses) <= 1:
        return _findings(report.findings, told, "h2")
    note = f"<p>{len(report.doses)} doses were taken. The score above holds the worst verdict of each rule.</p>"
    return note + "".join(_dose(i, dose, told) for i, dose in enumerate(report.doses, start=1))


def _dose(i: int, dose: Dose, told: _Told) -> str:
    span = f"{dose.start_s:.1f} to {dose.end_s:.1f} s"
    return (
        f'<section class="dose"><h2>Dose {i} <small>{span}</small></h2>{_score(dose.score)}'
        f"{_findings(dose.findings, told, 'h3')}</section>"
    )


def _findings(findings: Sequence[Finding], told: _Told, heading: str) -> str:
    unseen = tuple(finding for finding in findings if finding.reason == "not_observable")
    found = tuple(finding for finding in findings if finding.reason != "not_observable")
    if not found and not unseen:
        return "<p>This device has no rules.</p>"
    parts = []
    for verdict, title in _HEADINGS:
        if verdict is Verdict.PASS:
            parts.append(_unseen(unseen, told, heading))
        items = [_finding(finding, told) for finding in found if finding.verdict is verdict]
        if verdict is Verdict.FAIL and not items:
            items = ["<li>None was found.</li>"]
        if items:
            count = f" <small>({len(items)})</small>" if verdict is Verdict.PASS else ""
            parts.append(f'<{heading}>{title}{count}</{heading}><ul class="findings">{"".join(items)}</ul>')
    return "".join(parts)


def _unseen(findings: Sequence[Finding], told: _Told, heading: str) -> str:
    lines = "".join(
        f"<li>{escape(told.title(f.rule))}: <small>{escape(f.message.removeprefix('Not assessed: '))}</small></li>"
        for f in findings
    )
    return f'<{heading}>Never seen by these sensors</{heading}><ul class="unseen">{lines}</ul>' if lines else ""


def _finding(finding: Finding, told: _Told) -> str:
    is_mistake = finding.verdict is Verdict.FAIL and finding.severity is not None
    tag = str(finding.severity) if is_mistake else _TAGS[finding.verdict]
    # A rule's title names the mistake: of what is in order, what was seen says so.
    is_pass = finding.verdict is Verdict.PASS
    name = escape(finding.message if is_pass else told.title(finding.rule))
    if finding.start_s is not None and finding.end_s is not None:
        span = f'data-start="{finding.start_s:.3f}" data-end="{finding.end_s:.3f}"'
        name = f'<button type="button" {span} title="Show it in the curves">{name}</button>'
    numbers = ""
    if finding.value is not None:
        numbers = f"<b>{number(finding.value, finding.unit)}</b>"
        if finding.limit is not None:
            numbers += f" <small>limit {brief(finding.limit, finding.unit)}</small>"
    words = "" if is_pass else f"<p>{escape(finding.message)}</p>"
    said = told.review.entries if told.review is not None else ()
    for entry in said:
        if entry.rule == finding.rule and entry.verdict not in (None, finding.verdict):
            words += f'<p class="said">{_said(entry, {}, told)} <small>{escape(entry.who)}</small></p>'
    css = finding.severity if finding.verdict is Verdict.FAIL and finding.severity else finding.verdict
    return (
        f'<li class="{css}"><div><span class="tag">{escape(tag)}</span> {name} <span class="numbers">{numbers}</span>'
        f"</div>{words}</li>"
    )


def _measures(report: Report) -> str:
    rows = []
    for name, measure in report.measures.items():
        if name in INTERNAL_MEASURES:
            continue
        unit = unit_of(name)
        sd = f"± {number(measure.sd, unit)}" if measure.sd is not None and measure.value is not None else ""
        why = escape(in_words(measure.reason or "")) if measure.value is None else ""
        meaning = f"{escape(MEASURES.get(name, ''))}<br><code>{escape(name)}</code>"
        cells = f"<td>{number(measure.value, unit)}</td><td>{sd}</td><td>{why}</td>"
        rows.append(f'<tr><th scope="row">{meaning}</th>{cells}</tr>')
    if not rows:
        return "<p>Nothing was measured.</p>"
    head = "".join(f'<th scope="col">{column}</th>' for column in ("measure", "value", "deviation", "why not"))
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
