"""What holds of a session once people have looked: its verdicts, its result, and whether that was signed off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import orjson

from api.store.reviews import Review, ReviewKind
from api.store.sessions import Outcome
from inhalemon.report import from_dict
from inhalemon.rules import RuleSet
from inhalemon.rules.scoring import after_review, score
from inhalemon.values import Report, Verdict

_DECIDED = frozenset({Verdict.PASS, Verdict.FAIL})
_JUDGING = frozenset({ReviewKind.CONFIRM, ReviewKind.OVERRIDE, ReviewKind.ADD})


def report_of(body: bytes) -> Report:
    """A stored report, read."""
    return from_dict(orjson.loads(body))


def machine(report: Report) -> dict[str, Verdict]:
    """Rule to verdict, as the report has them."""
    return {finding.rule: finding.verdict for finding in report.findings}


def outcome(report: Report, entries: Sequence[Review], rules: RuleSet) -> Outcome:
    """What holds after review: the machine's findings, unless somebody contradicted them; the last word stands."""
    findings = after_review(report.findings, _said(standing(entries)), rules)
    return Outcome(findings, score(findings))


def _said(entries: Sequence[Review]) -> dict[str, Verdict]:
    return {
        entry.rule: Verdict(entry.verdict)
        for entry in entries
        if entry.kind in _JUDGING and entry.rule is not None and entry.verdict is not None
    }


# ------------------------------------------------------------------------------------------ what stands, what is signed


def standing(entries: Sequence[Review]) -> list[Review]:
    """What is left when entries taken back, and the entries that took them back, are left out."""
    undone = {entry.undoes for entry in entries if entry.kind == ReviewKind.UNDO}
    return [entry for entry in entries if entry.kind != ReviewKind.UNDO and entry.id not in undone]


def sign_offs(entries: Sequence[Review], report_id: str | None) -> list[Review]:
    """The sign-offs that hold: of this report, and of a review to which nothing was added or taken since."""
    return [entry for entry in standing(entries) if _is_sign_off(entry) and _is_unchanged(entry, entries, report_id)]


def is_amended(entries: Sequence[Review], report_id: str | None) -> bool:
    """Whether something else was signed off before."""
    return any(_is_sign_off(entry) and not _is_unchanged(entry, entries, report_id) for entry in entries)


def _is_sign_off(entry: Review) -> bool:
    return entry.kind == ReviewKind.SIGN_OFF


def _is_unchanged(signed: Review, entries: Sequence[Review], report_id: str | None) -> bool:
    before = [entry for entry in entries if entry.version < signed.version]
    return signed.report_id == report_id and _content(before) == _content(entries)


def _content(entries: Sequence[Review]) -> list[str]:
    return [entry.id for entry in standing(entries) if not _is_sign_off(entry)]


# ------------------------------------------------------------------------------------------ who says what


def by_reviewer(
    machine: Mapping[str, str], entries: Sequence[Review], report_id: str | None
) -> dict[str, dict[str, str]]:
    """What each reviewer says of each rule, decided verdicts only.

    Signing this report off says that whatever then held, and the reviewer had not contradicted, is right.
    """
    found: dict[str, dict[str, str]] = {}
    holds = dict(machine)
    for entry in standing(entries):
        said = found.setdefault(entry.reviewer_id, {})
        judged = _said([entry])
        said.update(judged)
        holds.update(judged)
        if _is_sign_off(entry) and entry.report_id == report_id:
            found[entry.reviewer_id] = holds | said
    return {
        reviewer: decided
        for reviewer, said in found.items()
        if (decided := {rule: verdict for rule, verdict in said.items() if verdict in _DECIDED})
    }


def mistakes(verdicts: Mapping[str, str]) -> list[str]:
    """The rules that were broken, by name."""
    return sorted(rule for rule, verdict in verdicts.items() if verdict == Verdict.FAIL)


def adherence(verdicts: Mapping[str, str]) -> tuple[int, int]:
    """How many rules were kept, of how many that could be decided."""
    decided = [verdict for verdict in verdicts.values() if verdict in _DECIDED]
    return decided.count(Verdict.PASS), len(decided)
