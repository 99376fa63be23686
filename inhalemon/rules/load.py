"""Rule files read and checked. Every refusal names file, rule, field, what was found and what was wanted."""

from __future__ import annotations

import functools
import graphlib
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Final, NoReturn, TypeGuard

from inhalemon.exceptions import RulesError
from inhalemon.formats import RULES_FORMAT
from inhalemon.measures import INTERNAL_MEASURES, MEASURES, unit_of
from inhalemon.rules.model import (
    AllOf,
    AnyOf,
    Comparison,
    Condition,
    Evidence,
    Level,
    Limit,
    Needs,
    Rule,
    RuleSet,
    Shown,
    Sign,
    Unless,
)
from inhalemon.values import DeviceKind, Severity

Table = Mapping[str, object]

_TOP_FIELDS: Final = ("format", "profile", "base", "rules")
_RULE_FIELDS: Final = (
    "title",
    "devices",
    "unit",
    "when",
    "implied_by",
    "applies",
    "doubt",
    "shows",
    "never_decided",
    "message",
    "ok",
    "evidence",
    "source",
)
_RULE_ID: Final = re.compile(r"[a-z][a-z0-9_]{0,63}")
_PLACES: Final = re.compile(r"\{[^}]*\}?|\}")
_MAX_NESTING: Final = 8
_LARGEST: Final = 10**12


@functools.cache
def profile_names() -> tuple[str, ...]:
    """The names of the profiles that come with the package."""
    files = resources.files("inhalemon").joinpath("data/rules").iterdir()
    return tuple(sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml")))


def load_rules(profile_or_path: str | Path = "default") -> RuleSet:
    """The rules of a profile (`default`, `strict`), or of a TOML file laid over a profile.

    In a file, a rule that exists already is changed in the fields that are given, and a new id adds a rule.
    Raises `RulesError`.
    """
    return _shipped(str(profile_or_path)) if profile_or_path in profile_names() else _loaded(profile_or_path)


@functools.cache
def _shipped(profile: str) -> RuleSet:
    return _loaded(profile)


def _loaded(profile_or_path: str | Path) -> RuleSet:
    where, top = _read(profile_or_path)
    tables: dict[str, Table] = {}
    layers = [(where, top)]
    while (base := _base(*layers[-1])) is not None:
        if any(base == name for name, _ in layers):
            _refuse(where, "base", base, "a profile that does not build on itself")
        layers.append(_read(base))
    for name, layer in reversed(layers):
        for rule_id, changes in _rules_of(name, layer).items():
            tables[rule_id] = _merged(tables.get(rule_id, {}), changes)
    rules = tuple(_rule(rule_id, table, f"{where}: rule {rule_id}") for rule_id, table in tables.items())
    _check_implications(rules, where)
    return RuleSet(profile=str(top.get("profile", Path(profile_or_path).stem)), rules=rules)


def _read(profile_or_path: str | Path) -> tuple[str, Table]:
    name = str(profile_or_path)
    try:
        if name in profile_names():
            file = resources.files("inhalemon").joinpath(f"data/rules/{name}.toml")
            return name, tomllib.loads(file.read_text(encoding="utf-8"))
        if not name.endswith(".toml"):
            wanted = f"one of {', '.join(profile_names())}, or the path of a .toml file"
            raise RulesError(f"rules is {name!r}; expected {wanted}")
        return name, tomllib.loads(Path(name).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:  # not there, not text, not TOML, nested too deeply
        raise RulesError(f"{name}: {error}. Give a readable TOML file") from error


def _base(where: str, top: Table) -> str | None:
    """The profile that this one is laid over; the shipped default stands alone, and so does `base = "none"`."""
    base = top.get("base", "none" if where in profile_names() else "default")
    if base == "none":
        return None
    if base not in profile_names():
        _refuse(where, "base", base, f"one of {', '.join(profile_names())}, none")
    return str(base)


def _rules_of(where: str, top: Table) -> Mapping[str, Table]:
    _check_fields(top, _TOP_FIELDS, where)
    if top.get("format", RULES_FORMAT) != RULES_FORMAT:
        _refuse(where, "format", top["format"], repr(RULES_FORMAT))
    if not isinstance(top.get("profile", "own"), str):
        _refuse(where, "profile", top["profile"], "a text")
    rules = top.get("rules", {})
    if not isinstance(rules, dict):
        _refuse(where, "rules", rules, "tables [rules.ID]")
    for rule_id, table in rules.items():
        if not _RULE_ID.fullmatch(rule_id):
            _refuse(where, "rule id", rule_id, "lower-case letters, digits and _")
        if not isinstance(table, dict):
            _refuse(where, f"rule {rule_id}", table, f"a table [rules.{rule_id}]")
        _check_fields(table, _RULE_FIELDS, f"{where}: rule {rule_id}")
    return rules


def _merged(base: Table, changes: Table) -> Table:
    merged = {**base, **changes}
    if "never_decided" in changes and "when" not in changes:
        merged.pop("when", None)
    if "when" in changes and "never_decided" not in changes:
        merged.pop("never_decided", None)
    return merged


def _rule(rule_id: str, table: Table, where: str) -> Rule:
    is_decided = "never_decided" not in table
    reader = _Reader(where)
    reader.wants(table, ("title", "devices", "source", *(("when", "message", "evidence") if is_decided else ())))
    if not is_decided and "when" in table:
        _refuse(where, "never_decided", table["never_decided"], "either `when` or `never_decided`")
    rule = Rule(
        id=rule_id,
        title=reader.text(table["title"], "title"),
        devices=reader.devices(table["devices"], "devices"),
        levels=reader.levels(table["when"]) if is_decided else (),
        unit=reader.text(table["unit"], "unit") if is_decided and "unit" in table else None,
        implied_by=reader.ids(table.get("implied_by", []), "implied_by"),
        applies=reader.unless(table["applies"], "applies") if "applies" in table else None,
        doubt=reader.unless(table["doubt"], "doubt") if "doubt" in table else None,
        shows=reader.shown(table["shows"]) if "shows" in table else None,
        never_decided=None if is_decided else reader.text(table["never_decided"], "never_decided"),
        message=reader.message(table["message"]) if is_decided else "",
        ok=reader.text(table["ok"], "ok") if "ok" in table else "Not found.",
        evidence=reader.evidence(table["evidence"]) if "evidence" in table else None,
        source=reader.text(table["source"], "source"),
    )
    units = {unit_of(measure) for level in rule.levels for measure in measures_of(level.when)}
    units |= {unit_of(rule.shows.measure)} if rule.shows else set()
    if rule.unit is not None and rule.unit not in units:
        _refuse(where, "unit", rule.unit, f"the unit of its measures, {' or '.join(sorted(units)) or 'none'}")
    return rule


def measures_of(condition: Condition) -> tuple[str, ...]:
    """The measures that a condition looks at, in its order; limits that are measures come after their measure."""
    if isinstance(condition, AllOf | AnyOf):
        return tuple(measure for part in condition.conditions for measure in measures_of(part))
    if isinstance(condition, Comparison) and condition.limit.measure is not None:
        return condition.measure, condition.limit.measure
    return (condition.measure,)


def _check_implications(rules: tuple[Rule, ...], where: str) -> None:
    known = {rule.id for rule in rules}
    for rule in rules:
        for cause in rule.implied_by:
            if cause not in known:
                _refuse(f"{where}: rule {rule.id}", "implied_by", cause, "the id of another rule")
    try:
        graphlib.TopologicalSorter({rule.id: rule.implied_by for rule in rules}).prepare()
    except graphlib.CycleError as error:
        circle = " -> ".join(error.args[1])
        raise RulesError(f"{where}: implied_by goes in a circle: {circle}; expected none") from error


@dataclass(frozen=True, slots=True)
class _Reader:
    """Reads the fields of one rule; `where` is the file and the rule."""

    where: str

    def wants(self, table: Table, fields: tuple[str, ...]) -> None:
        for field in fields:
            if field not in table:
                raise RulesError(f"{self.where}: field {field} is missing")

    def text(self, found: object, field: str) -> str:
        if not isinstance(found, str) or not found.strip():
            _refuse(self.where, field, found, "a text")
        return found

    def message(self, found: object) -> str:
        text = self.text(found, "message")
        for place in _PLACES.findall(text):
            if place not in ("{value}", "{limit}"):
                _refuse(self.where, "message", text, f"{{value}} and {{limit}} only, not {place}")
        return text

    def evidence(self, found: object) -> Evidence:
        if found not in tuple(Evidence):
            _refuse(self.where, "evidence", found, f"one of {', '.join(Evidence)}")
        return Evidence(str(found))

    def devices(self, found: object, field: str) -> tuple[DeviceKind, ...]:
        if not isinstance(found, list) or not found or any(name not in tuple(DeviceKind) for name in found):
            _refuse(self.where, field, found, f"a list of {', '.join(DeviceKind)}")
        return tuple(DeviceKind(name) for name in found)

    def ids(self, found: object, field: str) -> tuple[str, ...]:
        if not isinstance(found, list) or not all(isinstance(name, str) for name in found):
            _refuse(self.where, field, found, "a list of rule ids")
        return tuple(found)

    def levels(self, found: object) -> tuple[Level, ...]:
        table = self._table(found, "when", tuple(Severity))
        levels = [Level(s, self.condition(table[s], f"when.{s}", 0)) for s in Severity if s in table]
        if not levels:
            _refuse(self.where, "when", found, f"a condition under one of {', '.join(Severity)}")
        return tuple(levels)

    def unless(self, found: object, field: str) -> Unless:
        table = self._table(found, field, ("when", "reason"))
        for name in ("when", "reason"):
            if name not in table:
                raise RulesError(f"{self.where}: field {field}.{name} is missing")
        condition = self.condition(table["when"], f"{field}.when", 0)
        return Unless(condition, self.text(table["reason"], f"{field}.reason"))

    def shown(self, found: object) -> Shown:
        table = self._table(found, "shows", ("measure", "limit"))
        measure = self.measure(table.get("measure"), "shows.measure")
        return Shown(measure, self.limit(table.get("limit"), "shows.limit", measure))

    def condition(self, found: object, field: str, depth: int) -> Condition:
        """A comparison, `{any = [...]}`, `{all = [...]}` or `{needs = MEASURE}`."""
        if not isinstance(found, dict) or depth > _MAX_NESTING:
            _refuse(self.where, field, found, "a comparison, or `any`, `all`, `needs`")
        for word, group in (("any", AnyOf), ("all", AllOf)):
            if word in found:
                parts = self._table(found, field, (word,))[word]
                if not isinstance(parts, list) or not parts:
                    _refuse(self.where, f"{field}.{word}", parts, "a list of conditions")
                inner = [self.condition(part, f"{field}.{word}[{i}]", depth + 1) for i, part in enumerate(parts)]
                return group(tuple(inner))
        if "needs" in found:
            table = self._table(found, field, ("needs",))
            return Needs(self.measure(table["needs"], f"{field}.needs"))
        return self._comparison(found, field)

    def _comparison(self, found: object, field: str) -> Comparison:
        table = self._table(found, field, ("measure", "is", "limit", "dead_band", "devices"))
        measure = self.measure(table.get("measure"), f"{field}.measure")
        sign = table.get("is")
        if sign not in tuple(Sign):
            _refuse(self.where, f"{field}.is", sign, f"one of {', '.join(Sign)}")
        dead_band = table.get("dead_band", 0.0)
        if not _is_number(dead_band) or dead_band < 0:
            _refuse(self.where, f"{field}.dead_band", dead_band, "a number, 0 or more, in the measure's unit")
        devices = self.devices(table["devices"], f"{field}.devices") if "devices" in table else None
        limit = self.limit(table.get("limit"), f"{field}.limit", measure)
        return Comparison(measure, Sign(str(sign)), limit, float(dead_band), devices)

    def measure(self, found: object, field: str) -> str:
        if not isinstance(found, str) or (found not in MEASURES and found not in INTERNAL_MEASURES):
            _refuse(self.where, field, found, f"one of {', '.join((*MEASURES, *INTERNAL_MEASURES))}")
        return found

    def limit(self, found: object, field: str, measure: str) -> Limit:
        if _is_number(found):
            return Limit(number=float(found))
        wanted = "a number, { measure = NAME } or { travel = FRACTION }"
        if not isinstance(found, dict):
            _refuse(self.where, field, found, wanted)
        if "measure" in found:
            name = self.measure(self._table(found, field, ("measure",))["measure"], f"{field}.measure")
            if unit_of(name) != unit_of(measure):
                _refuse(self.where, field, name, f"a measure in {unit_of(measure)}, as {measure} is")
            return Limit(measure=name)
        table = self._table(found, field, ("travel", "uncalibrated"))
        travel, uncalibrated = table.get("travel"), table.get("uncalibrated")
        if unit_of(measure) != "deg":
            _refuse(self.where, field, found, f"a limit in {unit_of(measure)}; a fraction of the travel is in deg")
        if not _is_number(travel) or not 0 < travel <= 2:
            _refuse(self.where, f"{field}.travel", travel, "a fraction of the device's travel, above 0, up to 2")
        if uncalibrated is None:
            return Limit(travel=float(travel))
        if not _is_number(uncalibrated):
            _refuse(self.where, f"{field}.uncalibrated", uncalibrated, "a number of degrees")
        return Limit(travel=float(travel), uncalibrated_deg=float(uncalibrated))

    def _table(self, found: object, field: str, known: tuple[str, ...]) -> Table:
        if not isinstance(found, dict):
            _refuse(self.where, field, found, f"a table with {', '.join(known)}")
        _check_fields(found, known, self.where, f"{field}.")
        return found


def _is_number(found: object) -> TypeGuard[float]:
    if isinstance(found, int) and abs(found) > _LARGEST:  # TOML's integers may be larger than any float
        return False
    return isinstance(found, int | float) and not isinstance(found, bool) and math.isfinite(found)


def _check_fields(table: Table, known: tuple[str, ...], where: str, prefix: str = "") -> None:
    for name in table:
        if name not in known:
            raise RulesError(f"{where}: field {prefix}{name} is unknown; expected one of {', '.join(known)}")


def _refuse(where: str, field: str, found: object, wanted: str) -> NoReturn:
    raise RulesError(f"{where}: {field} is {found!r}; expected {wanted}")
