"""Words and numbers as people read them, the same in tables and pages."""

from __future__ import annotations

from typing import Final

from inhalemon.values import Grade

DISCLAIMER: Final = (
    "Decision support for trained staff; not a medical device. It never tells a patient to change treatment."
)
INFERRED: Final = (
    "The phases “exhale” and “breath hold” are inferred from stillness: the sensors see the inhaler, not the breath."
)
GRADES: Final = {
    Grade.CORRECT: "correct",
    Grade.MINOR_MISTAKES: "minor mistakes",
    Grade.MAJOR_MISTAKES: "major mistakes",
    Grade.CRITICAL_MISTAKES: "critical mistakes",
    Grade.NOT_ASSESSABLE: "not assessable",
}


def in_words(name: str) -> str:
    """`shake_too_short` and `implied_by:no_press` without their underscores."""
    return name.replace("_", " ").replace(":", ": ")


def number(value: float | None, unit: str | None) -> str:
    """A number with its unit, or a dash."""
    if value is None:
        return "–"
    if unit == "s":
        return f"{value:.2f} s"
    if unit == "deg":
        return f"{value:.1f}°"
    return f"{value:g}"
