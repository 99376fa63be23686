"""What holds of each rule once people have looked: the machine's verdict, unless somebody contradicted it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from api.store.reviews import Review, ReviewKind, standing

_DECIDED = frozenset({"pass", "fail"})
_JUDGING = frozenset({ReviewKind.CONFIRM, ReviewKind.OVERRIDE, ReviewKind.ADD})


def effective(machine: Mapping[str, str], entries: Sequence[Review]) -> dict[str, str]:
    """Rule to verdict after review: the last word of anybody stands."""
    found = dict(machine)
    for entry in standing(entries):
        if entry.kind in _JUDGING and entry.rule is not None and entry.verdict is not None:
            found[entry.rule] = entry.verdict
    return found


def by_reviewer(machine: Mapping[str, str], entries: Sequence[Review]) -> dict[str, dict[str, str]]:
    """What each reviewer says of each rule, decided verdicts only.

    Signing off says that everything the reviewer has not contradicted is right.
    """
    found: dict[str, dict[str, str]] = {}
    for entry in standing(entries):
        said = found.setdefault(entry.reviewer_id, {})
        if entry.kind in _JUDGING and entry.rule is not None and entry.verdict is not None:
            said[entry.rule] = entry.verdict
        elif entry.kind == ReviewKind.SIGN_OFF:
            for rule, verdict in machine.items():
                said.setdefault(rule, verdict)
    return {
        reviewer: {rule: verdict for rule, verdict in said.items() if verdict in _DECIDED}
        for reviewer, said in found.items()
        if any(verdict in _DECIDED for verdict in said.values())
    }


def mistakes(verdicts: Mapping[str, str]) -> list[str]:
    return sorted(rule for rule, verdict in verdicts.items() if verdict == "fail")


def adherence(verdicts: Mapping[str, str]) -> tuple[int, int]:
    """How many rules were kept, of how many that could be decided."""
    decided = [verdict for verdict in verdicts.values() if verdict in _DECIDED]
    return decided.count("pass"), len(decided)
