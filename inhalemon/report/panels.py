"""Which curves of a session are drawn, on which axes, under which names: the same on every page."""

from __future__ import annotations

from dataclasses import dataclass

from inhalemon.values import STANDARD_GRAVITY_M_S2


@dataclass(frozen=True, slots=True)
class CurveKind:
    """One line: the channel that it shows, and the one with its standard deviation, if that is shown as a band."""

    channel: str
    name: str
    sd_channel: str | None = None


@dataclass(frozen=True, slots=True)
class PanelKind:
    """Lines on one axis, in `unit`, of which `per_unit` is what the channels count in; the least and the greatest value
    of a logarithmic one are far apart.
    """

    title: str
    unit: str
    curves: tuple[CurveKind, ...]
    per_unit: float = 1.0
    is_log: bool = False


def panel_kinds(moving_part: str = "lever", r_unit: str = "") -> tuple[PanelKind, ...]:
    """Tilt, lever or cover angle, rates, specific force and the filter's adaptive R."""
    return (
        PanelKind("Tilt from upright", "°", (CurveKind("tilt_deg", "tilt", "tilt_sd_deg"),)),
        PanelKind(
            f"{moving_part.capitalize()} angle",
            "°",
            (CurveKind("angle_deg", "angle", "angle_sd_deg"), CurveKind("off_axis_deg", "off the axis")),
        ),
        PanelKind(
            "Rate of the body",
            "°/s",
            (CurveKind("gyr_x_deg_s", "x (hinge)"), CurveKind("gyr_y_deg_s", "y"), CurveKind("gyr_z_deg_s", "z")),
        ),
        PanelKind(
            "Specific force",
            "g",
            (CurveKind("acc_norm_m_s2", "body"), CurveKind("lever_acc_norm_m_s2", moving_part)),
            per_unit=STANDARD_GRAVITY_M_S2,
        ),
        PanelKind(
            "R of the adaptive filter",
            r_unit.replace("2", "²"),
            (CurveKind("r", "body"), CurveKind("lever_r", moving_part)),
            is_log=True,
        ),
    )
