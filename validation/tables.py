"""A table of measured numbers, printed in a terminal and written to RESULTS.md by the same code."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Target:
    """One number to reach: `measured` is compared with `limit` and both are printed, reached or missed."""

    name: str
    measured: float
    limit: float
    unit: str = ""
    at_least: bool = False

    @property
    def is_reached(self) -> bool:
        return self.measured >= self.limit if self.at_least else self.measured <= self.limit

    def sentence(self) -> str:
        sign = ">=" if self.at_least else "<="
        verdict = (
            "reached" if self.is_reached else f"**missed** by {abs(self.measured - self.limit):.3g} {self.unit}".strip()
        )
        return f"{self.name}: {self.measured:.4g} {self.unit} (wanted {sign} {self.limit:.4g}): {verdict}"


@dataclass(frozen=True)
class Table:
    """Rows of text or numbers under `columns`; `measured_on` says what data and how many."""

    title: str
    measured_on: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str | float | int | None, ...], ...]
    targets: tuple[Target, ...] = ()
    notes: tuple[str, ...] = field(default=())

    def to_markdown(self) -> str:
        lines = [f"### {self.title}", "", f"Measured on {self.measured_on}.", ""]
        lines += ["| " + " | ".join(self.columns) + " |", "|" + "---|" * len(self.columns)]
        lines += ["| " + " | ".join(_cell(value) for value in row) + " |" for row in self.rows]
        lines += ["", *(f"- {target.sentence()}" for target in self.targets)]
        lines += [f"- {note}" for note in self.notes]
        return "\n".join(lines).rstrip() + "\n"


def _cell(value: str | float | int | None) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.3f}" if abs(value) < 100 else f"{value:.0f}"
    return str(value)
