"""Reports as they go over the wire, typed and with examples; they are sent as they were stored."""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from inhalemon.values import DeviceKind, EventKind, Grade, PhaseKind, Severity, Verdict


class Out(BaseModel):
    """What goes out is not changed any more."""

    model_config = ConfigDict(frozen=True)


class Measure(Out):
    value: float | None = Field(examples=[5.41])
    sd: float | None = Field(None, examples=[0.1])
    reason: str | None = None


class Phase(Out):
    kind: PhaseKind
    start_s: float = Field(examples=[2.7])
    end_s: float = Field(examples=[8.11])
    confidence: float = Field(examples=[0.97])


class Event(Out):
    kind: EventKind
    start_s: float
    peak_s: float
    end_s: float
    angle_deg: float


class Finding(Out):
    rule: str = Field(examples=["press_late"])
    verdict: Verdict = Field(examples=["fail"])
    severity: Severity | None = Field(examples=["major"])
    value: float | None = Field(examples=[1.32])
    limit: float | None = Field(examples=[0.9])
    unit: str | None = Field(examples=["s"])
    start_s: float | None
    end_s: float | None
    reason: str | None
    message: str = Field(examples=["Pressed 1.3 s after the inhalation began"])


class Score(Out):
    points: int = Field(examples=[85])
    grade: Grade = Field(examples=["major_mistakes"])


class Flag(Out):
    code: str
    sensor: str | None
    detail: str


class Quality(Out):
    usable: bool
    flags: list[Flag]


class Dose(Out):
    start_s: float
    end_s: float
    events: list[Event]
    measures: dict[str, Measure]
    findings: list[Finding]
    score: Score


class Report(Out):
    """inhalemon-report/1; times are seconds on the body sensor's clock."""

    format: Literal["inhalemon-report/1"]
    session_id: str
    device: DeviceKind
    pipeline_version: str
    settings_digest: str
    rules_digest: str
    duration_s: float
    quality: Quality
    phases: list[Phase]
    events: list[Event]
    measures: dict[str, Measure]
    findings: list[Finding]
    doses: list[Dose]
    score: Score


class ReportVersion(Out):
    """One of a session's reports: which pipeline, settings and rules made it."""

    version: int = Field(examples=[1])
    created_at: datetime
    pipeline_version: str
    settings_digest: str
    rules_digest: str
    grade: Grade
    points: int
