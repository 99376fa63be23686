"""Which mistakes were made: rules held against measures. The rules are data; nothing here knows any of them.

A measure nearer to its limit than its dead-band, or than 1.96 of its standard deviations, decides nothing (95 % two
sided, if errors are normal). Counts are compared at the half between two whole numbers, so that a count with no
deviation is always decided. Conditions combine by Kleene's three-valued logic, so that what is missing or too close
counts only where it could change the verdict.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Final

from inhalemon.devices import Device
from inhalemon.measures import unit_of
from inhalemon.rules.model import AnyOf, Comparison, Condition, Limit, Needs, Rule, RuleSet, Shown, Sign
from inhalemon.values import TWO_SIDED_95, DeviceKind, Finding, Measure, Severity, Verdict
from inhalemon.words import brief, in_words

_COMPARE: Final[dict[Sign, Callable[[float, float], bool]]] = {
    Sign.LESS: operator.lt,
    Sign.LESS_OR_EQUAL: operator.le,
    Sign.MORE: operator.gt,
    Sign.MORE_OR_EQUAL: operator.ge,
}


def apply_rules(
    measures: Mapping[str, Measure], device: Device, rules: RuleSet, *, unusable: str | None = None
) -> tuple[Finding, ...]:
    """What each rule of the device says of the measures, in the order of the rules.

    A measure that is missing or without a value makes its rules not assessable, with the measure's reason.
    `unusable` is why the measures cannot be trusted: then nothing is assessed.
    """
    of_device = {rule.id: rule for rule in rules.of(device.kind)}
    view = _View(measures, device)
    findings: dict[str, Finding] = {}

    def found(rule: Rule) -> Finding:
        if rule.id not in findings:
            causes = (of_device[cause] for cause in rule.implied_by if cause in of_device)
            failed = next((cause for cause in causes if found(cause).verdict is Verdict.FAIL), None)
            findings[rule.id] = _finding(rule, view, unusable, failed)
        return findings[rule.id]

    return tuple(found(rule) for rule in of_device.values())


class _Truth(Enum):
    YES = auto()
    NO = auto()
    CLOSE = auto()
    MISSING = auto()


@dataclass(frozen=True, slots=True)
class _Outcome:
    """Whether a condition holds, and the comparison that decided it."""

    truth: _Truth
    measure: str
    found: Measure
    limit: float | None
    reason: str | None = None


@dataclass(frozen=True, slots=True)
class _View:
    """The measures as one device's rules see them."""

    measures: Mapping[str, Measure]
    device: Device

    def measure(self, name: str) -> Measure:
        found = self.measures.get(name)
        if found is None:
            return Measure(None, reason=f"no_measure:{name}")
        if found.value is None or not math.isfinite(found.value):
            return Measure(None, reason=found.reason or f"no_value:{name}")
        return found

    def limit(self, limit: Limit) -> Measure:
        if limit.number is not None:
            return Measure(limit.number)
        if limit.measure is not None:
            return self.measure(limit.measure)
        if self.device.full_travel_rad is not None and limit.travel is not None:
            return Measure(limit.travel * math.degrees(self.device.full_travel_rad))
        return Measure(limit.uncalibrated_deg, reason="travel_not_calibrated")


def _finding(rule: Rule, view: _View, unusable: str | None, cause: Rule | None) -> Finding:
    if rule.never_decided is not None:
        return _not_assessed(rule, None, "not_observable", rule.never_decided)
    if cause is not None:
        return _not_assessed(rule, None, f"implied_by:{cause.id}", f"already told by “{cause.title}”")
    if unusable is not None:
        return _not_assessed(rule, rule.gravest, unusable, in_words(unusable))
    if rule.applies is not None:
        outcome = _outcome(rule.applies.condition, view)
        if outcome.truth in (_Truth.NO, _Truth.MISSING):
            reason = outcome.reason or rule.applies.reason
            return _not_assessed(rule, rule.gravest, reason, in_words(reason or "no reason given"))
    return _judged(rule, view)


def _judged(rule: Rule, view: _View) -> Finding:
    """The verdict of a rule that applies: the gravest level that surely holds, and a pass where surely none does.

    Levels need not be parts of one another, so a graver one that is open leaves the rule open although wider ones are
    not. What is told of an open rule is its gravest open level.
    """
    outcomes = [(level.severity, _outcome(level.when, view)) for level in rule.levels]
    for severity, outcome in outcomes:
        if outcome.truth is _Truth.YES:
            return _told(rule, view, Verdict.FAIL, severity, outcome)
    for severity, outcome in outcomes:
        if outcome.truth is not _Truth.NO:
            verdict = Verdict.INDETERMINATE if outcome.truth is _Truth.CLOSE else Verdict.NOT_ASSESSABLE
            return _told(rule, view, verdict, severity, outcome)
    widest_severity, widest = outcomes[-1]
    doubt = _outcome(rule.doubt.condition, view) if rule.doubt is not None else None
    if rule.doubt is not None and doubt is not None and doubt.truth is _Truth.YES:
        return _told(rule, view, Verdict.INDETERMINATE, widest_severity, replace(doubt, reason=rule.doubt.reason))
    return _told(rule, view, Verdict.PASS, None, widest)


def _outcome(condition: Condition, view: _View) -> _Outcome:
    if isinstance(condition, Comparison):
        return _compared(condition, view)
    if isinstance(condition, Needs):
        found = view.measure(condition.measure)
        truth = _Truth.NO if found.value is not None else _Truth.MISSING
        return _Outcome(truth, condition.measure, found, None, found.reason)
    # Kleene: one YES makes an `any`, one NO unmakes an `all`; what is missing or close matters only without it.
    decides, otherwise = (_Truth.YES, _Truth.NO) if isinstance(condition, AnyOf) else (_Truth.NO, _Truth.YES)
    parts = [_outcome(part, view) for part in condition.conditions if _concerns(part, view.device.kind)]
    for truth in (decides, _Truth.MISSING, _Truth.CLOSE, otherwise):
        for part in parts:
            if part.truth is truth:
                return part
    return _Outcome(otherwise, "", Measure(None), None)  # no part concerns this device


def _concerns(condition: Condition, device: DeviceKind) -> bool:
    return not isinstance(condition, Comparison) or condition.devices is None or device in condition.devices


def _compared(condition: Comparison, view: _View) -> _Outcome:
    found, limit = view.measure(condition.measure), view.limit(condition.limit)
    if found.value is None or limit.value is None:
        reason = found.reason if found.value is None else limit.reason
        return _Outcome(_Truth.MISSING, condition.measure, found, limit.value, reason)
    distance = abs(found.value - _boundary(condition, limit.value))
    nearest = max(condition.dead_band, TWO_SIDED_95 * math.hypot(found.sd or 0.0, limit.sd or 0.0))
    if distance < nearest:
        return _Outcome(_Truth.CLOSE, condition.measure, found, limit.value, "too_close_to_the_limit")
    truth = _Truth.YES if _COMPARE[condition.sign](found.value, limit.value) else _Truth.NO
    return _Outcome(truth, condition.measure, found, limit.value)


def _boundary(condition: Comparison, limit: float) -> float:
    if unit_of(condition.measure) != "count":
        return limit
    return limit - 0.5 if condition.sign in (Sign.LESS, Sign.MORE_OR_EQUAL) else limit + 0.5


def _not_assessed(rule: Rule, severity: Severity | None, reason: str, why: str) -> Finding:
    message = f"Not assessed: {why}."
    return Finding(rule.id, Verdict.NOT_ASSESSABLE, severity, None, None, rule.unit, None, None, reason, message)


def _told(rule: Rule, view: _View, verdict: Verdict, severity: Severity | None, outcome: _Outcome) -> Finding:
    name, found, limit = outcome.measure, outcome.found, outcome.limit
    if rule.shows is not None and verdict in (Verdict.FAIL, Verdict.PASS):
        name, found, limit = _shown(rule.shows, view)
    why = in_words(outcome.reason or "no reason given")
    if verdict is Verdict.FAIL:
        message = rule.message
    elif verdict is Verdict.PASS:
        message = rule.ok
    elif verdict is Verdict.INDETERMINATE:
        message = f"Undecided: {{value}} against a limit of {{limit}}, {why}."
    else:
        message = f"Not assessed: {why}."
    message = message.replace("{value}", _written(found.value, name)).replace("{limit}", _written(limit, name))
    unit = unit_of(name) if name else rule.unit
    return Finding(
        rule.id, verdict, severity, found.value, limit, unit, found.start_s, found.end_s, outcome.reason, message
    )


def _shown(shown: Shown, view: _View) -> tuple[str, Measure, float | None]:
    return shown.measure, view.measure(shown.measure), view.limit(shown.limit).value


def _written(value: float | None, measure: str) -> str:
    """A number as a person reads it, with its unit."""
    if value is None:
        return "nothing"
    return brief(value, unit_of(measure)) + (" cycles" if measure.endswith("_cycles") else "")
