"""What a report's own page tells of its review: written here, read by the worker that makes the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from api import verdicts
from api.moments import to_datetime
from api.store.reviews import Review, ReviewKind
from inhalemon.report import page
from inhalemon.rules import RuleSet
from inhalemon.values import Grade, Report, Score, Verdict

Json = dict[str, Any]  # as it goes to the worker


def told(report: Report, entries: Sequence[Review], report_id: str, rules: RuleSet, roles: Mapping[str, str]) -> Json:
    """The result after review, its sign-offs and the entries that stand; `roles` are those of reviewers, by id."""
    held = verdicts.outcome(report, entries, rules).score

    def signature(entry: Review) -> tuple[str, str]:
        name = entry.reviewer.partition(":")[2]
        return f"{name}, {roles.get(entry.reviewer_id, 'left')}", f"{to_datetime(entry.at_us):%Y-%m-%d %H:%M} UTC"

    said = [entry for entry in verdicts.standing(entries) if entry.kind != ReviewKind.SIGN_OFF]
    return {
        "score": {"points": held.points, "grade": str(held.grade)},
        "signed_off": [", ".join(signature(entry)) for entry in verdicts.sign_offs(entries, report_id)],
        "entries": [
            dict(zip(("who", "when"), signature(entry), strict=True))
            | {"rule": entry.rule, "verdict": entry.verdict, "reason": entry.reason}
            for entry in said
        ],
    }


def read(found: Json) -> page.Review:
    """What `told` wrote."""
    return page.Review(
        score=Score(found["score"]["points"], Grade(found["score"]["grade"])),
        signed_off=found["signed_off"],
        entries=[
            page.ReviewEntry(**each | {"verdict": None if each["verdict"] is None else Verdict(each["verdict"])})
            for each in found["entries"]
        ],
    )
