"""What a rule is made of."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from dataclasses import dataclass
from enum import StrEnum

from inhalemon.values import DeviceKind, Severity


class Sign(StrEnum):
    LESS = "<"
    LESS_OR_EQUAL = "<="
    MORE = ">"
    MORE_OR_EQUAL = ">="


class Evidence(StrEnum):
    """How well a rule's number is founded."""

    S = "S"
    Q = "Q"
    E = "E"

    @property
    def meaning(self) -> str:
        return {
            Evidence.S: "a published number",
            Evidence.Q: "a published direction with our number",
            Evidence.E: "engineering, to be signed off by clinicians",
        }[self]


@dataclass(frozen=True, slots=True)
class Limit:
    """A number, another measure, or a fraction of the device's travel; exactly one of the three.

    `uncalibrated_deg` stands in for the fraction while the device's travel is not calibrated.
    """

    number: float | None = None
    measure: str | None = None
    travel: float | None = None
    uncalibrated_deg: float | None = None


@dataclass(frozen=True, slots=True)
class Comparison:
    """`measure sign limit`; nearer to the limit than the dead-band nothing is decided."""

    measure: str
    sign: Sign
    limit: Limit
    dead_band: float
    devices: tuple[DeviceKind, ...] | None = None  # None: every device of the rule


@dataclass(frozen=True, slots=True)
class Needs:
    """Never true; cannot be decided while the measure is missing."""

    measure: str


@dataclass(frozen=True, slots=True)
class AllOf:
    conditions: tuple[Condition, ...]


@dataclass(frozen=True, slots=True)
class AnyOf:
    conditions: tuple[Condition, ...]


Condition = Comparison | Needs | AllOf | AnyOf


@dataclass(frozen=True, slots=True)
class Level:
    severity: Severity
    when: Condition


@dataclass(frozen=True, slots=True)
class Shown:
    """The measure and limit that a finding shows, where the deciding ones say less to a person."""

    measure: str
    limit: Limit


@dataclass(frozen=True, slots=True)
class Unless:
    """A condition and the reason that is given because of it."""

    condition: Condition
    reason: str


@dataclass(frozen=True, slots=True)
class Rule:
    """One mistake: when it is one, how grave, and where the numbers come from.

    `levels` go from the gravest to the lightest. The gravest that surely holds is the mistake; a pass is when none can.
    `applies`: where its condition does not hold the rule is not assessable, with its reason.
    `doubt`: while its condition holds a pass is indeterminate, with its reason.
    `never_decided` is the reason why sensors can never decide the rule; such a rule has no levels.
    """

    id: str
    title: str
    devices: tuple[DeviceKind, ...]
    levels: tuple[Level, ...]
    unit: str | None
    implied_by: tuple[str, ...]
    applies: Unless | None
    doubt: Unless | None
    shows: Shown | None
    never_decided: str | None
    message: str
    ok: str
    evidence: Evidence | None
    source: str

    @property
    def gravest(self) -> Severity | None:
        return self.levels[0].severity if self.levels else None


@dataclass(frozen=True)
class RuleSet:
    """The rules of one profile, in the order in which reports list them."""

    profile: str
    rules: tuple[Rule, ...]

    def of(self, device: DeviceKind) -> tuple[Rule, ...]:
        return tuple(rule for rule in self.rules if device in rule.devices)

    @functools.cached_property
    def digest(self) -> str:
        """SHA-256 of the rules' canonical JSON: equal rules, equal digest."""
        canonical = json.dumps([dataclasses.asdict(rule) for rule in self.rules], sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(canonical.encode()).hexdigest()
