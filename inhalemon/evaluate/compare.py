"""Reports against labels, session by session, rule by rule."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import TypeVar

import numpy as np

from inhalemon.evaluate.agreement import Agreement, agreement
from inhalemon.evaluate.documents import Session
from inhalemon.evaluate.segments import (
    Boundaries,
    Spread,
    agreed_s,
    boundaries,
    match_events,
    match_phases,
    spread,
)
from inhalemon.exceptions import LabelsError
from inhalemon.formats import EVALUATION_FORMAT
from inhalemon.values import Event, Phase, Verdict

Part = TypeVar("Part", Phase, Event)


@dataclass(frozen=True, slots=True)
class RuleResult:
    """One rule over all labelled sessions: a mistake counts as found only when the verdict is `fail`."""

    agreement: Agreement
    missed_as_indeterminate: int  # labelled, and the report would not decide; part of `agreement.fn`
    missed_as_not_assessable: int  # labelled, and the report could not assess; part of `agreement.fn`
    doubted: int  # not labelled, and the report would not decide; part of `agreement.tn`
    not_assessed: int  # not labelled, and the report could not assess; part of `agreement.tn`


@dataclass(frozen=True, slots=True)
class MeasureResult:
    """One measure over the sessions where label and report both have a value; errors in the measure's unit."""

    error: Spread | None
    n_missing: int  # labelled with a value, reported without
    normalised_error: float | None  # root mean square of error / sd: 1 when the claimed deviation is honest


@dataclass(frozen=True, slots=True)
class Evaluation:
    """How far reports and labels agree."""

    n_sessions: int
    n_unusable: int  # labelled sessions whose recording could not be used; their mistakes count as missed
    without_report: tuple[str, ...]
    without_labels: tuple[str, ...]
    macro_f1: float | None  # mean over the rules that somebody labelled or some report failed
    rules: dict[str, RuleResult]
    not_observable: dict[str, int]  # labelled mistakes that no such recording can show
    frame_accuracy: float | None
    segmental_f1_50: float | None
    phases: dict[str, Boundaries]
    events: dict[str, Boundaries]
    measures: dict[str, MeasureResult]

    def to_dict(self) -> dict[str, object]:
        """An `inhalemon-evaluation/1` document."""
        return {"format": EVALUATION_FORMAT, **asdict(self)}


def evaluate(reports: Iterable[Session], labels: Iterable[Session]) -> Evaluation:
    """The comparison of every labelled session with the report of the same `session_id`.

    Sessions without a partner are named and left out. Raises `LabelsError` when a `session_id` occurs twice on one
    side or when nothing matches.
    """
    reported, labelled = _by_id(reports, "report"), _by_id(labels, "label")
    pairs = [(labelled[session_id], reported[session_id]) for session_id in labelled if session_id in reported]
    if not pairs:
        raise LabelsError(
            f"none of {len(labelled)} labelled sessions has one of {len(reported)} reports; "
            "expected equal session_id on both sides"
        )
    rules, not_observable = _rules(pairs)
    scores = [rule.agreement.f1 for rule in rules.values() if rule.agreement.f1 is not None]
    phased = [(label, report) for label, report in pairs if label.phases and report.is_scored]
    timed = [(label, report) for label, report in pairs if (label.phases or label.events) and report.is_scored]
    labelled_s = sum(phase.end_s - phase.start_s for label, _ in phased for phase in label.phases)
    n_phases = sum(len(label.phases) + len(report.phases) for label, report in phased)
    n_matched = sum(len(match_phases(label.phases, report.phases, min_overlap=0.5)) for label, report in phased)
    return Evaluation(
        n_sessions=len(pairs),
        n_unusable=sum(not report.is_scored for _, report in pairs),
        without_report=tuple(sorted(set(labelled) - set(reported))),
        without_labels=tuple(sorted(set(reported) - set(labelled))),
        macro_f1=math.fsum(scores) / len(scores) if scores else None,
        rules=rules,
        not_observable=not_observable,
        frame_accuracy=sum(agreed_s(a.phases, b.phases) for a, b in phased) / labelled_s if labelled_s else None,
        segmental_f1_50=2 * n_matched / n_phases if n_phases else None,
        phases=_boundaries(phased, lambda session: session.phases, match_phases),
        events=_boundaries(timed, lambda session: session.events, match_events),
        measures=_measures(pairs),
    )


def _by_id(sessions: Iterable[Session], side: str) -> dict[str, Session]:
    by_id: dict[str, Session] = {}
    for session in sessions:
        if session.session_id in by_id:
            raise LabelsError(f"session {session.session_id} has more than one {side}; expected one")
        by_id[session.session_id] = session
    return by_id


def _rules(pairs: Sequence[tuple[Session, Session]]) -> tuple[dict[str, RuleResult], dict[str, int]]:
    not_observable: Counter[str] = Counter()
    counts: dict[str, Counter[tuple[bool, Verdict]]] = defaultdict(Counter)
    for label, report in pairs:
        for rule in sorted({*label.verdicts, *report.verdicts}):
            is_labelled = rule in label.verdicts
            if rule in report.not_observable:
                not_observable[rule] += is_labelled
            else:
                counts[rule][is_labelled, report.verdicts.get(rule, Verdict.NOT_ASSESSABLE)] += 1
    return {rule: _rule(counts[rule]) for rule in sorted(counts)}, {r: n for r, n in not_observable.items() if n}


def _rule(count: Counter[tuple[bool, Verdict]]) -> RuleResult:
    tp, fp = count[True, Verdict.FAIL], count[False, Verdict.FAIL]
    fn = sum(n for (is_labelled, _), n in count.items() if is_labelled) - tp
    tn = sum(n for (is_labelled, _), n in count.items() if not is_labelled) - fp
    return RuleResult(
        agreement=agreement(tp, fp, fn, tn),
        missed_as_indeterminate=count[True, Verdict.INDETERMINATE],
        missed_as_not_assessable=count[True, Verdict.NOT_ASSESSABLE],
        doubted=count[False, Verdict.INDETERMINATE],
        not_assessed=count[False, Verdict.NOT_ASSESSABLE],
    )


def _boundaries(
    pairs: Sequence[tuple[Session, Session]],
    parts: Callable[[Session], tuple[Part, ...]],
    match: Callable[[Sequence[Part], Sequence[Part]], list[tuple[Part, Part]]],
) -> dict[str, Boundaries]:
    n_labelled: Counter[str] = Counter(str(each.kind) for label, _ in pairs for each in parts(label))
    n_reported: Counter[str] = Counter(str(each.kind) for _, report in pairs for each in parts(report))
    matched: dict[str, list[tuple[Part, Part]]] = defaultdict(list)
    for label, report in pairs:
        for a, b in match(parts(label), parts(report)):
            matched[str(a.kind)].append((a, b))
    kinds = sorted({*n_labelled, *n_reported})
    return {kind: boundaries(matched[kind], n_labelled[kind], n_reported[kind]) for kind in kinds}


def _measures(pairs: Sequence[tuple[Session, Session]]) -> dict[str, MeasureResult]:
    errors, normalised, n_missing = defaultdict(list), defaultdict(list), Counter[str]()
    for label, report in pairs:
        for name, labelled in label.measures.items():
            reported = report.measures.get(name)
            if labelled.value is None:
                continue
            if reported is None or reported.value is None:
                n_missing[name] += 1
                continue
            error = reported.value - labelled.value
            errors[name].append(error)
            if reported.sd:
                normalised[name].append(error / reported.sd)
    return {
        name: MeasureResult(
            error=spread(errors[name]),
            n_missing=n_missing[name],
            normalised_error=float(np.sqrt(np.mean(np.square(normalised[name])))) if normalised[name] else None,
        )
        for name in sorted({*errors, *n_missing})
    }
