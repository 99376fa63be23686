"""What the findings of a dose or a session add up to."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from inhalemon.values import Finding, Grade, Score, Severity, Verdict

POINTS: Final = {Severity.CRITICAL: 40, Severity.MAJOR: 15, Severity.MINOR: 5}
_GRADE: Final = {
    Severity.CRITICAL: Grade.CRITICAL_MISTAKES,
    Severity.MAJOR: Grade.MAJOR_MISTAKES,
    Severity.MINOR: Grade.MINOR_MISTAKES,
}


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
