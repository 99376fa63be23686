"""Numbers and names as people read them, the same in messages, tables and pages."""

from __future__ import annotations


def in_words(name: str) -> str:
    """`shake_too_short` and `implied_by:no_press` without their underscores."""
    return name.replace("_", " ").replace(":", ": ")


def number(value: float | None, unit: str | None) -> str:
    """A number with its unit, or a dash."""
    if value is None:
        return "–"
    rounded = round(value, 6) + 0.0  # as documents have it, so that what is read back is told alike
    if unit == "s":
        return f"{rounded:.2f} s"
    if unit == "deg":
        return f"{rounded:.1f}°"
    return f"{rounded:g}"


def brief(value: float | None, unit: str | None) -> str:
    """The same number within a sentence: without the zeros at its end."""
    digits = number(value, unit).rstrip("° s")
    trimmed = digits.rstrip("0").rstrip(".") if "." in digits else digits
    return trimmed + {"s": " s", "deg": "°"}.get(unit or "", "")
