"""What a setting may be: its range stands in its type, and every stage's settings are checked when they are made.

A plain `float` is above zero and finite, a plain `int` a count; `Annotated[..., Range(...)]` says where another range
is wanted. Ranges are wide: they keep out what no stage can work with, not what is unwise.
"""

from __future__ import annotations

import dataclasses
import functools
import types
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from inhalemon.exceptions import SettingsError


@dataclass(frozen=True, slots=True)
class Range:
    """The smallest and the largest value that a number may have."""

    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}"


Share = Annotated[float, Range(0.0, 1.0)]
NotNegative = Annotated[float, Range(0.0, 1e6)]
Block = Annotated[float, Range(0.005, 10.0)]  # seconds: what a recording of an hour is cut into

_DEFAULT_RANGES = {float: Range(1e-6, 1e6), int: Range(1, 10_000)}


class Checked:
    """What a stage's settings are: a dataclass that holds its fields to their types and ranges.

    Whole numbers become floats, text a choice, a list a tuple. Raises `SettingsError` naming the field, what was found
    and what was wanted.
    """

    __slots__ = ()

    def __post_init__(self) -> None:
        for name, wanted in field_types(type(self)).items():  # type: ignore[arg-type]  # a class can be hashed
            found = getattr(self, name)
            checked = _checked(found, wanted, name)
            if checked is not found:
                object.__setattr__(self, name, checked)


@functools.cache
def field_types(stage: type) -> types.MappingProxyType[str, Any]:
    """The type of each field with the range that stands in it, in the order of the fields."""
    hints = get_type_hints(stage, include_extras=True)
    return types.MappingProxyType({each.name: hints[each.name] for each in dataclasses.fields(stage)})


def _checked(found: object, wanted: Any, name: str) -> object:
    if get_origin(wanted) is tuple:
        if not isinstance(found, list | tuple) or not found:
            raise _wrong(name, found, "a list of one number or more")
        return tuple(_checked(each, get_args(wanted)[0], name) for each in found)
    if get_origin(wanted) is Annotated:
        kind, allowed = get_args(wanted)
    else:
        kind, allowed = wanted, _DEFAULT_RANGES.get(wanted)
    if allowed is not None:
        return _number(found, kind, allowed, name)
    if issubclass(kind, StrEnum):
        if not isinstance(found, str) or found not in tuple(kind):
            raise _wrong(name, found, f"one of {', '.join(kind)}")
        return kind(found)
    if not isinstance(found, kind):
        raise _wrong(name, found, "true or false" if kind is bool else kind.__name__)
    return found


def _number(found: object, kind: type[float], allowed: Range, name: str) -> float:
    """Whole numbers pass for any; nan lies in no range."""
    is_kind = isinstance(found, int | kind) and not isinstance(found, bool)
    if not is_kind or not allowed.low <= found <= allowed.high:  # type: ignore[operator]  # a number by now
        raise _wrong(name, found, f"a {'whole number' if kind is int else 'number'} from {allowed}")
    return kind(found)  # type: ignore[arg-type]  # likewise


def _wrong(name: str, found: object, wanted: str) -> SettingsError:
    shown = repr(found) if len(repr(found)) <= 60 else repr(found)[:60] + "..."
    return SettingsError(f"{name} is {shown}; expected {wanted}")
