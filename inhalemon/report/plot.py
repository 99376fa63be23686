"""One panel of curves as SVG whose x is seconds, so that zooming is a change of its view box."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

import numpy as np

from inhalemon.report.curves import Curve, Panel, reduced
from inhalemon.values import Event, FloatArray, Phase

PLOT_HEIGHT: Final = 100.0  # in units of the view box
_MARGIN: Final = 4.0
_N_TICKS: Final = 4
_LEAST_SPAN: Final = 1e-6


def panel_html(panel: Panel, phases: Sequence[Phase], events: Sequence[Event], start_s: float, end_s: float) -> str:
    """The panel's row: its name and ticks beside the plot; phases lie behind the curves, events across them."""
    low, high = _range(panel)
    scale = _Scale(low, high)
    bands = "".join(
        f'<rect class="{phase.kind}" x="{phase.start_s:.3f}" y="0" width="{phase.end_s - phase.start_s:.3f}"'
        f' height="{PLOT_HEIGHT:g}"/>'
        for phase in phases
    )
    marks = "".join(
        f'<path class="event {event.kind}" d="M{event.start_s:.3f},0V{PLOT_HEIGHT:g}"/>' for event in events
    )
    ticks = _ticks(low, high, panel.is_log)
    lines = "".join(f'<path class="grid" d="M{start_s:.3f},{scale.y(t):.2f}H{end_s:.3f}"/>' for t in ticks)
    labels = "".join(f'<span class="tick" style="top:{scale.y(t):.2f}%">{_tick(t, panel.is_log)}</span>' for t in ticks)
    curves = "".join(_curve(curve, scale, i) for i, curve in enumerate(panel.curves))
    names = "".join(
        f'<li><i class="c{i}"></i>{escape(curve.name)} <output></output></li>' for i, curve in enumerate(panel.curves)
    )
    unit = f" <small>{escape(panel.unit)}{', logarithmic' if panel.is_log else ''}</small>"
    return (
        f'<section class="panel"><h2>{escape(panel.title)}{unit}</h2><ul class="names">{names}</ul>'
        f'<div class="row"><div class="label">{labels}</div>'
        f'<svg viewBox="{start_s:.3f} 0 {end_s - start_s:.3f} {PLOT_HEIGHT:g}" preserveAspectRatio="none" role="img"'
        f' aria-label="{escape(panel.title)} over time" data-low="{low:g}" data-high="{high:g}"'
        f'{" data-log" if panel.is_log else ""}>{bands}{lines}{marks}{curves}<path class="cursor" d=""/></svg>'
        f"</div></section>"
    )


def nice_step(step: float) -> float:
    """The next 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(max(step, _LEAST_SPAN)))
    return power * next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= step * (1 - 1e-9))


@dataclass(frozen=True, slots=True)
class _Scale:
    """From a panel's values to its view box, downwards."""

    low: float
    high: float

    def y(self, value: float) -> float:
        return PLOT_HEIGHT - _MARGIN - (value - self.low) * (PLOT_HEIGHT - 2 * _MARGIN) / (self.high - self.low)


def _range(panel: Panel) -> tuple[float, float]:
    values = [curve.value[np.isfinite(curve.value)] for curve in panel.curves]
    found = [(float(v.min()), float(v.max())) for v in values if v.size]
    low, high = min((f[0] for f in found), default=0.0), max((f[1] for f in found), default=1.0)
    if not panel.is_log:
        low, high = min(low, 0.0), max(high, 0.0)
    return (low, high) if high - low > _LEAST_SPAN else (low - 0.5, high + 0.5)


def _ticks(low: float, high: float, is_log: bool) -> list[float]:
    step = nice_step((high - low) / _N_TICKS)
    step = max(1.0, math.ceil(step)) if is_log else step
    first, last = math.ceil(low / step), math.floor(high / step)
    return [step * i for i in range(first, last + 1)]


def _tick(value: float, is_log: bool) -> str:
    return f"10<sup>{value:g}</sup>" if is_log else f"{value:g}"


def _curve(curve: Curve, scale: _Scale, i: int) -> str:
    band = ""
    if curve.half_width is not None:
        upper = reduced(curve.time_s, np.fmin(curve.value + curve.half_width, 1e6))
        lower = reduced(curve.time_s, np.fmax(curve.value - curve.half_width, -1e6))
        pieces = (
            (np.concatenate([up[0], down[0][::-1]]), np.concatenate([up[1], down[1][::-1]]))
            for up, down in zip(upper, lower, strict=False)
        )
        band = f'<path class="band c{i}" d="{_path(pieces, scale)}"/>'
    return f'{band}<path class="curve c{i}" d="{_path(reduced(curve.time_s, curve.value), scale)}"/>'


def _path(pieces: Iterable[tuple[FloatArray, FloatArray]], scale: _Scale) -> str:
    return "".join(
        "M" + " ".join(f"{t:.3f},{scale.y(v):.2f}" for t, v in zip(time_s.tolist(), value.tolist(), strict=True))
        for time_s, value in pieces
    )
