"""What a session of several doses is told by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from inhalemon.values import Dose, Finding, Measure, Severity, Verdict

_GRAVITY: Final = {severity: -place for place, severity in enumerate(Severity)}
_WORSE: Final = {
    verdict: place
    for place, verdict in enumerate((Verdict.PASS, Verdict.NOT_ASSESSABLE, Verdict.INDETERMINATE, Verdict.FAIL))
}


def worst_of(doses: Sequence[Dose]) -> tuple[Mapping[str, Measure], tuple[Finding, ...]]:
    """The measures of the dose with the fewest points (of several, the first), and each rule's worst finding over all.

    Worst is a fail (gravest first), then indeterminate, not assessable, pass.
    """
    worst: dict[str, Finding] = {}
    for dose in doses:
        for finding in dose.findings:
            held = worst.get(finding.rule)
            if held is None or _badness(finding) > _badness(held):
                worst[finding.rule] = finding
    return min(doses, key=lambda dose: dose.score.points).measures, tuple(worst.values())


def _badness(finding: Finding) -> tuple[int, int]:
    return _WORSE[finding.verdict], _GRAVITY[finding.severity] if finding.severity else -len(_GRAVITY)
