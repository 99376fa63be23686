"""A report and its curves with times that a person can read, where the sensor's clock counts from long ago."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, TypeVar

from inhalemon.report.curves import Panel
from inhalemon.values import Dose, Event, Finding, Measure, Phase, Report

Part = TypeVar("Part", Phase, Event, Finding, Dose)

# Longer than any recording: a clock that says more counts from somewhere else than the session.
_LONG_AGO_S: Final = 3600.0
_TIMES: Final = ("inhalation_start_s",)  # measures that are themselves a time on the clock


def origin_of(start_s: float) -> float:
    """The whole second from which the times of a session that starts at `start_s` are told; 0 for most."""
    return float(math.floor(start_s)) if abs(start_s) > _LONG_AGO_S else 0.0


def counted_from(origin_s: float, report: Report, panels: Sequence[Panel]) -> tuple[Report, tuple[Panel, ...]]:
    """The same report and curves with all times told from `origin_s`."""

    def counted(parts: Iterable[Part]) -> tuple[Part, ...]:
        return tuple(_counted(part, origin_s) for part in parts)

    def measured(measures: Mapping[str, Measure]) -> dict[str, Measure]:
        return {
            name: dataclasses.replace(measure, value=measure.value - origin_s)
            if name in _TIMES and measure.value is not None
            else measure
            for name, measure in measures.items()
        }

    doses = (
        dataclasses.replace(
            dose, events=counted(dose.events), findings=counted(dose.findings), measures=measured(dose.measures)
        )
        for dose in report.doses
    )
    told = dataclasses.replace(
        report,
        phases=counted(report.phases),
        events=counted(report.events),
        findings=counted(report.findings),
        doses=counted(doses),
        measures=measured(report.measures),
    )
    curves = (
        tuple(dataclasses.replace(curve, time_s=curve.time_s - origin_s) for curve in panel.curves) for panel in panels
    )
    return told, tuple(dataclasses.replace(panel, curves=each) for panel, each in zip(panels, curves, strict=True))


def _counted(part: Part, origin_s: float) -> Part:
    at = {name: getattr(part, name, None) for name in ("start_s", "peak_s", "end_s")}
    return dataclasses.replace(part, **{name: time - origin_s for name, time in at.items() if time is not None})
