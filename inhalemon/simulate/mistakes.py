"""Which mistakes can be acted, and which cannot happen together."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from inhalemon.exceptions import SimulationError
from inhalemon.values import DeviceKind

MISTAKES: Final[dict[DeviceKind, tuple[str, ...]]] = {
    DeviceKind.PMDI: (
        "not_shaken",
        "shake_too_short",
        "shake_to_press_delay",
        "not_upright_at_press",
        "inverted_at_press",
        "press_early",
        "press_late",
        "no_press",
        "multiple_presses",
        "press_incomplete",
        "no_exhale_pause",
        "inhalation_too_short",
        "breath_hold_too_short",
        "no_inhalation",
        "order_wrong",
    ),
    DeviceKind.ELLIPTA: (
        "cover_not_fully_open",
        "shaken_after_open",
        "inverted_after_open",
        "tilted_at_inhalation",
        "no_exhale_pause",
        "inhalation_too_short",
        "breath_hold_too_short",
        "cover_not_closed",
        "opened_repeatedly",
        "no_inhalation",
        "order_wrong",
    ),
}

# What cannot be acted together, or what makes the other impossible to tell (a rule implied by another that failed).
_CLASHES: Final[dict[DeviceKind, tuple[tuple[str, str], ...]]] = {
    DeviceKind.PMDI: (
        ("not_shaken", "shake_too_short shake_to_press_delay order_wrong"),
        ("not_upright_at_press", "inverted_at_press"),
        (
            "no_press",
            "shake_to_press_delay not_upright_at_press inverted_at_press press_early press_late multiple_presses"
            " press_incomplete",
        ),
        (
            "press_incomplete",
            "shake_to_press_delay not_upright_at_press inverted_at_press press_early press_late multiple_presses",
        ),
        ("press_early", "press_late multiple_presses"),
        ("press_late", "multiple_presses inhalation_too_short"),
        ("multiple_presses", "inhalation_too_short"),
        (
            "no_inhalation",
            "shake_to_press_delay not_upright_at_press inverted_at_press press_early press_late multiple_presses"
            " no_exhale_pause inhalation_too_short breath_hold_too_short order_wrong",
        ),
        ("order_wrong", "shake_to_press_delay no_exhale_pause"),
    ),
    DeviceKind.ELLIPTA: (
        ("cover_not_fully_open", "opened_repeatedly"),
        (
            "no_inhalation",
            "shaken_after_open inverted_after_open tilted_at_inhalation no_exhale_pause inhalation_too_short"
            " breath_hold_too_short opened_repeatedly order_wrong",
        ),
        ("order_wrong", "cover_not_closed opened_repeatedly shaken_after_open inverted_after_open"),
    ),
}


def checked_mistakes(device: DeviceKind, mistakes: Iterable[str], *, n_doses: int = 1) -> frozenset[str]:
    """The mistakes as a set. Raises `SimulationError` for one that is unknown or clashes with another."""
    known = MISTAKES.get(device)
    if known is None:
        raise SimulationError(f"device is {device.value!r}; expected one of {', '.join(MISTAKES)}")
    if isinstance(mistakes, str):
        raise SimulationError(f"mistakes is {mistakes!r}; expected a sequence of rule ids, such as ({mistakes!r},)")
    chosen = frozenset(mistakes)
    for mistake in sorted(chosen):
        if mistake not in known:
            raise SimulationError(
                f"mistake {mistake!r} cannot be acted with {device.value}; expected one of {', '.join(known)}"
            )
    for first, second in clashes(device):
        if {first, second} <= chosen:
            raise SimulationError(
                f"mistakes {first!r} and {second!r} cannot be told apart or together; give one of them"
            )
    if n_doses < 1:
        raise SimulationError(f"n_doses is {n_doses}; expected 1 or more")
    if n_doses > 1 and "no_inhalation" in chosen:
        # An inhalation is what ends a dose: without one, two doses are one with everything done twice.
        raise SimulationError(f"mistake 'no_inhalation' makes {n_doses} doses one; give n_doses=1")
    return chosen


def clashes(device: DeviceKind) -> list[tuple[str, str]]:
    return [(first, second) for first, others in _CLASHES[device] for second in others.split()]


def draw_mistakes(device: DeviceKind | str, rng: np.random.Generator, *, most: int = 3) -> tuple[str, ...]:
    """Up to `most` mistakes that go together, in the order of the rules; none in about a quarter of the draws."""
    device = DeviceKind(device)
    forbidden = set(clashes(device))
    chosen: list[str] = []
    for mistake in rng.permutation(MISTAKES[device])[: rng.integers(0, most + 1)]:
        if not any((mistake, other) in forbidden or (other, mistake) in forbidden for other in chosen):
            chosen.append(str(mistake))
    return tuple(sorted(chosen, key=MISTAKES[device].index))
