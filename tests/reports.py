"""Reports made by hand, for tests of how reports are written."""

from __future__ import annotations

from inhalemon.devices import load_device
from inhalemon.rules import load_rules
from inhalemon.rules.scoring import score
from inhalemon.stages.findings import apply_rules
from inhalemon.stages.worst import worst_of
from inhalemon.values import (
    DeviceKind,
    Dose,
    Event,
    EventKind,
    Flag,
    Measure,
    Phase,
    PhaseKind,
    Quality,
    Report,
    SensorName,
)

MEASURES = {
    "shake_duration_s": Measure(4.6, 0.05, None, 2.0, 6.6),
    "shake_cycles": Measure(15, 0.2, None, 2.0, 6.6),
    "shake_to_press_s": Measure(6.2, 0.02),
    "exhale_pause_s": Measure(2.4, 0.1, None, 7.5, 9.9),
    "inhalation_start_s": Measure(11.4, 0.04),
    "inhalation_s": Measure(3.9, 0.06, None, 11.4, 15.3),
    "coordination_s": Measure(1.4, 0.05, None, 11.4, 12.8),
    "press_count": Measure(1, 0.0),
    "partial_press_count": Measure(0, 0.0),
    "press_angle_deg": Measure(13.1, 0.3),
    "tilt_at_press_deg": Measure(21.0, 0.8),
    "breath_hold_s": Measure(None, None, "inhalation_end_not_seen"),
    "order_violations": Measure(0, 0.0),
    "mouth_stays": Measure(1, 0.0),
    "press_after_mouth_s": Measure(-2.5, 0.1),
}
PRESS = Event(EventKind.PRESS, 12.8, 12.95, 13.6, 13.1)
SPANS = [
    ("rest", 0.0, 1.1),
    ("handling", 1.1, 2.0),
    ("shake", 2.0, 6.6),
    ("handling", 6.6, 7.5),
    ("exhale", 7.5, 9.9),
    ("to_mouth", 9.9, 11.4),
    ("inhale", 11.4, 15.3),
    ("breath_hold", 15.3, 20.0),
    ("put_down", 20.0, 22.0),
    ("rest", 22.0, 24.0),
]


def made_dose(start_s: float = 0.0, **changes: Measure) -> Dose:
    measures = MEASURES | changes
    findings = apply_rules(measures, load_device("pmdi"), load_rules())
    return Dose(start_s, start_s + 24.0, (PRESS,), measures, findings, score(findings))


def made_report(session_id: str = "late", doses: tuple[Dose, ...] = ()) -> Report:
    """A pMDI session whose press came late and whose breath hold could not be seen."""
    doses = doses or (made_dose(),)
    measures, findings = worst_of(doses)
    return Report(
        session_id=session_id,
        device=DeviceKind.PMDI,
        pipeline_version="1",
        settings_digest="0" * 64,
        rules_digest=load_rules().digest,
        duration_s=24.0,
        quality=Quality(True, (Flag("gap", SensorName.LEVER, "0.12 s without samples at 8.31 s"),)),
        phases=tuple(Phase(PhaseKind(kind), start_s, end_s, 0.9) for kind, start_s, end_s in SPANS),
        events=(PRESS,),
        measures=measures,
        findings=findings,
        doses=doses,
        score=score(findings),
    )
