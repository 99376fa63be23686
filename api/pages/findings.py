"""A report's findings with what reviewers said of them, as the session's page shows them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from api.models import ReviewHistory, ReviewOut
from api.store.reviews import ReviewKind
from api.words import Words
from inhalemon.values import Severity, Verdict

_ABOUT_RULES: Final = frozenset({ReviewKind.CONFIRM, ReviewKind.OVERRIDE, ReviewKind.ADD})
_DECIDED_BY_PEOPLE: Final = (Verdict.PASS, Verdict.FAIL, Verdict.NOT_ASSESSABLE)
_HEADINGS: Final = (
    (Verdict.FAIL, "Mistakes"),
    (Verdict.INDETERMINATE, "Undecided"),
    (Verdict.NOT_ASSESSABLE, "Could not be assessed"),
    (Verdict.PASS, "In order"),
)
_GRAVITY: Final = {str(severity): place for place, severity in enumerate(Severity)}  # the gravest first
NEVER_SEEN: Final = "Never seen by these sensors"
_NOT_OBSERVABLE: Final = "not_observable"


@dataclass(frozen=True, slots=True)
class Shown:
    """One finding in the reader's words."""

    rule: str
    title: str
    verdict: str
    tag: str  # the severity of a mistake, otherwise the verdict
    css: str
    value: str | None
    limit: str | None
    message: str
    start_s: float | None
    end_s: float | None
    entries: tuple[ReviewOut, ...]  # what stands of the reviews, oldest first
    is_done: bool  # this reviewer has said something
    others: tuple[str, ...]  # the verdicts an override can choose


@dataclass(frozen=True, slots=True)
class Group:
    title: str
    verdict: str
    findings: tuple[Shown, ...]


def standing(history: ReviewHistory) -> list[ReviewOut]:
    """Entries that were not taken back."""
    return [entry for entry in history.entries if entry.kind != ReviewKind.UNDO and not entry.is_undone]


def grouped(
    report: Mapping[str, Any],
    history: ReviewHistory,
    words: Words,
    titles: Mapping[str, str],
    *,
    actor: str,
) -> list[Group]:
    """Findings by verdict: mistakes first, the gravest at the top; what is never seen just before what is in order."""
    entries = [entry for entry in standing(history) if entry.kind in _ABOUT_RULES]
    found = [
        (finding, _shown(finding, [each for each in entries if each.rule == finding["rule"]], words, titles, actor))
        for finding in report["findings"]
    ]
    seen = [(finding, shown) for finding, shown in found if finding["reason"] != _NOT_OBSERVABLE]
    seen.sort(key=lambda each: _GRAVITY.get(each[0]["severity"], len(_GRAVITY)))
    groups = [
        Group(title, verdict, tuple(shown for finding, shown in seen if finding["verdict"] == verdict))
        for verdict, title in _HEADINGS
    ]
    unseen = tuple(shown for finding, shown in found if finding["reason"] == _NOT_OBSERVABLE)
    groups.insert(3, Group(NEVER_SEEN, Verdict.NOT_ASSESSABLE, unseen))
    return [group for group in groups if group.findings or group.verdict == Verdict.FAIL]


def _shown(
    finding: Mapping[str, Any], entries: Iterable[ReviewOut], words: Words, titles: Mapping[str, str], actor: str
) -> Shown:
    rule, verdict = finding["rule"], finding["verdict"]
    is_mistake = verdict == Verdict.FAIL and finding["severity"] is not None
    entries = tuple(entries)
    return Shown(
        rule=rule,
        title=words.name("rule", rule, titles.get(rule)),
        verdict=verdict,
        tag=words.name("severity", finding["severity"]) if is_mistake else words.name("verdict", verdict),
        css=finding["severity"] if is_mistake else verdict,
        value=None if finding["value"] is None else words.quantity(finding["value"], finding["unit"]),
        limit=None if finding["limit"] is None else words.limit(finding["limit"], finding["unit"]),
        message=words.told(
            rule, verdict, **{name: finding[name] for name in ("value", "limit", "unit", "reason", "message")}
        ),
        start_s=finding["start_s"],
        end_s=finding["end_s"],
        entries=entries,
        is_done=any(entry.reviewer == actor for entry in entries),
        others=tuple(str(each) for each in _DECIDED_BY_PEOPLE if each != verdict),
    )
