"""How a patient does over time, and how machine and reviewers agree."""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from api import models, present, verdicts
from api.moments import DAY_US, to_datetime
from api.store import Connection, listing, reviews, sessions
from api.store.listing import Filter
from api.store.reviews import Review
from api.store.sessions import Session, State
from api.verdicts import adherence, by_reviewer, mistakes
from inhalemon.evaluate.agreement import agreement, wilson_interval
from inhalemon.values import TWO_SIDED_95, Report, Verdict

_BLOCK = 500
_MIN_SESSIONS = 4  # below this no order of values is rarer than 5 %


# ------------------------------------------------------------------------------------------ progress


def progress(connection: Connection, clinic: str, clinic_id: str, patient_ref: str) -> models.Progress | None:
    """A clinic's patient: sessions in order of time, what became of each rule, and the trend; `None` without any."""
    found = list(listing.every(connection, [clinic_id], Filter(patient_ref=patient_ref, state=State.SCORED)))
    if not found:
        return None
    said = sessions.verdicts_of(connection, [each.id for each in found])
    points = []
    rules: dict[str, list[str]] = defaultdict(list)
    for session in found:
        held = said[session.id]
        kept, decided = adherence(held)
        for rule, verdict in held.items():
            rules[rule].append(verdict)
        points.append(
            models.ProgressPoint(
                session=session.id,
                at=to_datetime(session.happened_at_us),
                grade=present.grade(session.grade),
                points=session.points,
                machine_grade=present.grade(session.machine_grade),
                machine_points=session.machine_points,
                mistakes=mistakes(held),
                steps_kept=kept,
                steps_decided=decided,
                signed_off=session.signed_off_us is not None,
            )
        )
    days = [session.happened_at_us / DAY_US for session in found]
    return models.Progress(
        patient_ref=patient_ref,
        clinic=clinic,
        sessions=points,
        rules=[_rule(rule, held) for rule, held in sorted(rules.items()) if {"pass", "fail"} & set(held)],
        trend=trend(days, [len(each.mistakes) for each in points]),
    )


def _rule(rule: str, verdicts: Sequence[str]) -> models.RuleProgress:
    decided = [verdict for verdict in verdicts if verdict in {"pass", "fail"}]
    return models.RuleProgress(
        rule=rule, decided=len(decided), failed=decided.count("fail"), last=Verdict(decided[-1]) if decided else None
    )


def trend(days: Sequence[float], counts: Sequence[int]) -> models.Trend:
    """Whether mistakes become fewer: Theil and Sen's slope, and Mann and Kendall's test with its correction for ties.

    Both look at pairs of sessions only, so a single bad day does not make a trend.
    """
    pairs = list(itertools.combinations(zip(days, counts, strict=True), 2))
    slopes = sorted((b[1] - a[1]) / (b[0] - a[0]) for a, b in pairs if b[0] > a[0])
    middle = len(slopes) // 2
    slope = None if not slopes else (slopes[middle] + slopes[-1 - middle]) / 2
    n = len(counts)
    if n < _MIN_SESSIONS:
        return models.Trend(direction="unknown", mistakes_per_30_days=None if slope is None else 30 * slope)
    s = sum((b[1] > a[1]) - (b[1] < a[1]) for a, b in pairs)
    ties = sum(t * (t - 1) * (2 * t + 5) for t in Counter(counts).values())
    variance = (n * (n - 1) * (2 * n + 5) - ties) / 18
    z = 0.0 if variance == 0 or s == 0 else (s - math.copysign(1, s)) / math.sqrt(variance)
    direction: models.Direction = "steady"
    if abs(z) >= TWO_SIDED_95:
        direction = "improving" if z < 0 else "worsening"
    return models.Trend(direction=direction, mistakes_per_30_days=None if slope is None else 30 * slope)


# ------------------------------------------------------------------------------------------ agreement


@dataclass(slots=True)
class _Counts:
    tp: int = 0
    fp: int = 0
    fn: int = 0
    tn: int = 0

    def add(self, judged: str, truth: str) -> None:
        match judged, truth:
            case "fail", "fail":
                self.tp += 1
            case "fail", "pass":
                self.fp += 1
            case "pass", "fail":
                self.fn += 1
            case "pass", "pass":
                self.tn += 1


@dataclass(slots=True)
class _Tally:
    rules: dict[str, _Counts] = field(default_factory=lambda: defaultdict(_Counts))
    undecided: Counter[str] = field(default_factory=Counter)
    n_sessions: int = 0


def agreements(connection: Connection, clinic_ids: Sequence[str]) -> models.Agreements:
    """Machine against reviewers, and reviewers against each other, rule by rule."""
    machine_tally, people_tally = _Tally(), _Tally()
    for session, report, entries in _reviewed(connection, clinic_ids):
        machine = verdicts.machine(report)
        people = by_reviewer(machine, entries, session.report_id)
        machine_tally.n_sessions += bool(people)
        for said in people.values():
            for rule, verdict in said.items():
                judged = machine.get(rule, "not_assessable")
                if judged in {"pass", "fail"}:
                    machine_tally.rules[rule].add(judged, verdict)
                else:
                    machine_tally.undecided[rule] += 1
        people_tally.n_sessions += len(people) > 1
        for one, other in itertools.combinations(sorted(people), 2):
            for rule in people[one].keys() & people[other].keys():
                people_tally.rules[rule].add(people[one][rule], people[other][rule])
    return models.Agreements(
        machine_and_reviewers=_table(machine_tally), reviewers_among_each_other=_table(people_tally)
    )


def _reviewed(connection: Connection, clinic_ids: Sequence[str]) -> Iterator[tuple[Session, Report, Sequence[Review]]]:
    """Each session that somebody has written about, with its newest report."""
    every = listing.stream(connection, clinic_ids, Filter(state=State.SCORED, has_reviews=True))
    while block := list(itertools.islice(every, _BLOCK)):
        entries = reviews.histories_of(connection, [session.id for session, _ in block])
        for session, body in block:
            if body is not None:
                yield session, verdicts.report_of(body), entries[session.id]


def _table(tally: _Tally) -> models.AgreementTable:
    rows = [_row(rule, tally.rules[rule], tally.undecided[rule]) for rule in sorted({*tally.rules, *tally.undecided})]
    return models.AgreementTable(sessions=tally.n_sessions, rules=rows)


def _row(rule: str, counts: _Counts, undecided: int) -> models.AgreementRow:
    found = agreement(counts.tp, counts.fp, counts.fn, counts.tn)
    return models.AgreementRow(
        rule=rule,
        n=counts.tp + counts.fp + counts.fn + counts.tn,
        both_fail=counts.tp,
        only_first_fails=counts.fp,
        only_second_fails=counts.fn,
        both_pass=counts.tn,
        undecided=undecided,
        sensitivity=_estimate(found.recall, _wilson(counts.tp, counts.tp + counts.fn)),
        specificity=_estimate(found.specificity, _wilson(counts.tn, counts.tn + counts.fp)),
        kappa=_estimate(found.kappa, found.kappa_interval),
    )


def _wilson(hits: int, n: int) -> tuple[float, float] | None:
    return wilson_interval(hits, n) if n else None


def _estimate(value: float | None, interval: tuple[float, float] | None) -> models.Estimate | None:
    if value is None or interval is None:
        return None
    return models.Estimate(value=value, low=interval[0], high=interval[1])
