"""Rules in words: when they fail, how grave that is, and where the numbers come from."""

from __future__ import annotations

from inhalemon.exceptions import RulesError
from inhalemon.measures import INTERNAL_MEASURES, MEASURES, unit_of
from inhalemon.rules.load import measures_of
from inhalemon.rules.model import AllOf, AnyOf, Comparison, Condition, Limit, Needs, Rule, RuleSet

_DEVICE_NAMES = {"pmdi": "pMDI", "ellipta": "Ellipta", "hinge": "hinge"}
_UNITS = {"s": " s", "deg": "°", "count": ""}


def explain(rule_id: str, rules: RuleSet) -> str:
    """One rule as text: what it is, when it fails, what its measures mean, how well it is founded, its source.

    Raises `RulesError` for an id that the profile does not have.
    """
    by_id = {rule.id: rule for rule in rules.rules}
    if rule_id not in by_id:
        raise RulesError(f"rule is {rule_id!r}; expected one of {', '.join(by_id)}")
    rule = by_id[rule_id]
    lines = [f"{rule.id}: {rule.title} ({devices_in_words(rule)}; profile {rules.profile})", ""]
    if rule.never_decided is not None:
        lines += [f"Never decided: {rule.never_decided}.", "Every report says so.", ""]
    else:
        lines += ["Fails when", *(f"  {severity}: {words}" for severity, words in levels_in_words(rule)), ""]
    lines += notes_in_words(rule)
    used = dict.fromkeys(measure for level in rule.levels for measure in measures_of(level.when))
    used |= {rule.shows.measure: None} if rule.shows else {}
    lines += [f"{name}: {meaning_of(name)}." for name in used]
    if rule.evidence is not None:
        lines += ["", f"Evidence {rule.evidence}: {rule.evidence.meaning}."]
    lines += [f"Source: {rule.source}"]
    return "\n".join(lines)


def devices_in_words(rule: Rule) -> str:
    return ", ".join(_DEVICE_NAMES[device] for device in rule.devices)


def levels_in_words(rule: Rule) -> list[tuple[str, str]]:
    """Severity and condition of each level, the gravest first."""
    return [(str(level.severity), condition_in_words(level.when)) for level in rule.levels]


def notes_in_words(rule: Rule) -> list[str]:
    """What else bears on the verdict, a sentence each."""
    notes = []
    if rule.implied_by:
        notes.append(f"Implied by {', '.join(rule.implied_by)}: not assessed when one of them fails.")
    if rule.applies is not None:
        words = condition_in_words(rule.applies.condition)
        notes.append(f"Assessed only when {words}; otherwise not assessable ({rule.applies.reason}).")
    if rule.doubt is not None:
        words = condition_in_words(rule.doubt.condition)
        notes.append(f"Instead of a pass, indeterminate ({rule.doubt.reason}) while {words}.")
    return notes


def condition_in_words(condition: Condition) -> str:
    if isinstance(condition, AllOf | AnyOf):
        word = " and " if isinstance(condition, AllOf) else " or "
        parts = [part for part in condition.conditions if not isinstance(part, Needs)]
        needs = [part for part in condition.conditions if isinstance(part, Needs)]
        words = word.join(_bracketed(part) for part in parts)
        return words + "".join(f" (and {part.measure} must be known to pass)" for part in needs)
    if isinstance(condition, Needs):
        return f"never (but {condition.measure} must be known to pass)"
    words = f"{condition.measure} {condition.sign} {_limit_in_words(condition.limit, condition.measure)}"
    if condition.dead_band:
        words += f" (± {condition.dead_band:g}{_UNITS[unit_of(condition.measure)]} undecided)"
    if condition.devices is not None:
        words += f" [{', '.join(_DEVICE_NAMES[device] for device in condition.devices)}]"
    return words


def meaning_of(measure: str) -> str:
    return MEASURES.get(measure) or INTERNAL_MEASURES[measure]


def _bracketed(condition: Condition) -> str:
    words = condition_in_words(condition)
    return words if isinstance(condition, Comparison) else f"({words})"


def _limit_in_words(limit: Limit, measure: str) -> str:
    if limit.number is not None:
        return f"{limit.number:g}{_UNITS[unit_of(measure)]}"
    if limit.travel is not None:
        words = f"{100 * limit.travel:g} % of the travel"
        return words if limit.uncalibrated_deg is None else f"{words} (not calibrated: {limit.uncalibrated_deg:g}°)"
    return str(limit.measure)
