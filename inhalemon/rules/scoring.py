"""What findings are worth: points and a grade, as the machine found them and after people have looked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Final

from inhalemon.rules.model import RuleSet
from inhalemon.values import Finding, Grade, Score, Severity, Verdict

POINTS: Final = {Severity.CRITICAL: 40, Severity.MAJOR: 15, Severity.MINOR: 5}
_GRADE: Final = {
    Severity.CRITICAL: Grade.CRITICAL_MISTAKES,
    Severity.MAJOR: Grade.MAJOR_MISTAKES,
    Severity.MINOR: Grade.MINOR_MISTAKES,
}
_UNWEIGHED: Final = Severity.MAJOR  # of a mistake that only people can see: the rules give it no severity
_BY_A_REVIEWER: Final = "reviewed"


def score(findings: Iterable[Finding]) -> Score:
    """Points and grade: 100 less 40 a critical, 15 a major and 5 a minor mistake; the grade is the worst of them.

    Without a failed critical rule, a critical one that could not be decided leaves the whole not assessable; rules that
    sensors can never decide, and those implied by another, carry no severity and do not count. Nothing assessed at all
    is not assessable too.
    """
    found = tuple(findings)
    failed = [finding.severity for finding in found if finding.verdict is Verdict.FAIL and finding.severity is not None]
    undecided = (Verdict.INDETERMINATE, Verdict.NOT_ASSESSABLE)
    is_open = any(finding.verdict in undecided and finding.severity is Severity.CRITICAL for finding in found)
    points = max(0, 100 - sum(POINTS[severity] for severity in failed))
    if not found or (is_open and Severity.CRITICAL not in failed):
        return Score(points, Grade.NOT_ASSESSABLE)
    worst = min(failed, key=list(Severity).index, default=None)
    return Score(points, _GRADE[worst] if worst else Grade.CORRECT)


def after_review(findings: Iterable[Finding], said: Mapping[str, Verdict], rules: RuleSet) -> tuple[Finding, ...]:
    """The findings with the verdicts that people have given instead, by rule; `score` tells what they are worth.

    A person says that something was a mistake, not how grave: it has the gravest severity still open to it, that of the
    finding or else of the rule, and is a major one where the rules give none. A rule without a finding is added.
    """
    gravest = {rule.id: rule.gravest for rule in rules.rules}
    found = {finding.rule: finding for finding in findings}
    for rule, verdict in said.items():
        held = found.get(rule) or Finding(rule, verdict, None, None, None, None, None, None, _BY_A_REVIEWER, "")
        if held.verdict is not verdict or rule not in found:
            severity = held.severity or gravest.get(rule) or (_UNWEIGHED if verdict is Verdict.FAIL else None)
            found[rule] = replace(held, verdict=verdict, severity=None if verdict is Verdict.PASS else severity)
    return tuple(found.values())
