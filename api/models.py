"""What goes over the wire, typed and with examples. Reports go out as they were stored; `Report` describes them."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StrictBool, StringConstraints, model_validator

from api.principal import Role, Scope
from api.store.reviews import ReviewKind
from inhalemon.values import DeviceKind, EventKind, Grade, PhaseKind, Severity, Verdict

Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=2000)]
Slug = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9-]{0,62}$")]
UserName = Annotated[
    str, StringConstraints(strip_whitespace=True, to_lower=True, pattern=r"^[A-Za-z0-9][\w.@+-]{1,99}$")
]
RuleId = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{1,63}$")]


class _Out(BaseModel):
    model_config = ConfigDict(frozen=True)


class _In(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Problem(_Out):
    """RFC 9457 problem details; some kinds carry more members, as `line` and `column` here."""

    model_config = ConfigDict(
        extra="allow",
        json_schema_extra={
            "example": {
                "type": "urn:inhalemon:problem:unusable-recording",
                "title": "The recording cannot be used",
                "status": 422,
                "detail": "a.csv line 812: gyr_x_rad_s is 'nan'; expected a finite number",
                "line": 812,
                "column": "gyr_x_rad_s",
            }
        },
    )
    type: str
    title: str
    status: int
    detail: str
    instance: str | None = None


# ------------------------------------------------------------------------------------------ reports


class Measure(_Out):
    value: float | None = Field(examples=[5.41])
    sd: float | None = Field(None, examples=[0.1])
    reason: str | None = None


class Phase(_Out):
    kind: PhaseKind
    start_s: float = Field(examples=[2.7])
    end_s: float = Field(examples=[8.11])
    confidence: float = Field(examples=[0.97])


class Event(_Out):
    kind: EventKind
    start_s: float
    peak_s: float
    end_s: float
    angle_deg: float


class Finding(_Out):
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


class Score(_Out):
    points: int = Field(examples=[85])
    grade: Grade = Field(examples=["major_mistakes"])


class Flag(_Out):
    code: str
    sensor: str | None
    detail: str


class Quality(_Out):
    usable: bool
    flags: list[Flag]


class Dose(_Out):
    start_s: float
    end_s: float
    events: list[Event]
    measures: dict[str, Measure]
    findings: list[Finding]
    score: Score


class Report(_Out):
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


class ReportVersion(_Out):
    """One of a session's reports: which pipeline, settings and rules made it."""

    version: int = Field(examples=[1])
    created_at: datetime
    pipeline_version: str
    settings_digest: str
    rules_digest: str
    grade: Grade
    points: int


# ------------------------------------------------------------------------------------------ sessions


class SessionSummary(_Out):
    id: str = Field(examples=["q3l5c2m7k4vq6t2xw3yb5n7d4e"])
    session_id: str | None = Field(None, description="the recording's own name, when it has one")
    clinic: str = Field(examples=["north"])
    device: DeviceKind | None = Field(None, examples=["pmdi"])
    patient_ref: str | None = Field(None, examples=["P-0042"])
    recorded_at: datetime | None = None
    uploaded_at: datetime
    state: Literal["unscored", "scored", "unusable"]
    duration_s: float | None = None
    grade: Grade | None = Field(None, description="after review")
    points: int | None = Field(None, description="after review")
    machine_grade: Grade | None = Field(None, description="of the newest report")
    machine_points: int | None = Field(None, description="of the newest report")
    mistakes: list[str] = Field(
        default_factory=list, examples=[["press_late"]], description="rules that failed, after review"
    )
    reviews: int = Field(0, description="entries so far: the version that If-Match takes")
    reviewed_at: datetime | None = None
    signed_off_at: datetime | None = Field(None, description="of this report and this review; null once either changes")


class SessionDetail(SessionSummary):
    sha256: str
    n_bytes: int
    uploaded_by: str = Field(examples=["key:5c1f0a9be2d7"])
    report: Report | None = Field(None, description="the newest report")
    problem: Problem | None = Field(None, description="why there is none")


class SessionPage(_Out):
    items: list[SessionSummary]
    next: str | None = Field(None, description="pass it as `cursor` for the next page")


class UploadItem(_Out):
    """One of several files: a session, or a problem, with the status it would have had alone."""

    file: str | None
    status: int
    location: str | None = None
    session: SessionDetail | None = None
    problem: Problem | None = None


class UploadItems(_Out):
    items: list[UploadItem]


class SessionCorrection(_In):
    """What is left out stays; a `patient_ref` of null takes the patient away."""

    patient_ref: Annotated[str | None, Field(examples=["P-0043"])] = None
    device: Annotated[DeviceKind, Field(description="the session is scored again as this one's")] = DeviceKind.PMDI

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        if not self.model_fields_set:
            raise ValueError("expected patient_ref, device or both")
        return self


# ------------------------------------------------------------------------------------------ reviews


class ReviewIn(_In):
    """`confirm` and `override` need a rule; `override` a verdict and a reason; `add` a rule and a reason; `undo` the
    entry it takes back.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"kind": "override", "rule": "press_late", "verdict": "pass", "reason": "spacer in use"},
                {"kind": "sign_off"},
            ]
        },
    )
    kind: ReviewKind
    rule: RuleId | None = None
    verdict: Literal[Verdict.PASS, Verdict.FAIL, Verdict.NOT_ASSESSABLE] | None = None
    reason: Text | None = None
    undoes: str | None = None


class ReviewOut(_Out):
    id: str
    version: int
    kind: ReviewKind
    rule: str | None = None
    verdict: str | None = None
    machine_verdict: str | None = Field(None, description="what the report said when this was written")
    reason: str | None = None
    undoes: str | None = None
    is_undone: bool = False
    is_outdated: bool = Field(False, description="a sign-off of another report, or of the review as it was before")
    reviewer: str = Field(examples=["user:kimura"])
    at: datetime


class ReviewHistory(_Out):
    session: str
    version: int = Field(description="also the ETag, for If-Match")
    signed_off_at: datetime | None
    entries: list[ReviewOut]


class LeaseOut(_Out):
    reviewer: str
    expires_at: datetime


class QueueItem(_Out):
    session: SessionSummary
    lease: LeaseOut | None = None


class Queue(_Out):
    items: list[QueueItem]


# ------------------------------------------------------------------------------------------ people and programs


class Me(_Out):
    kind: Literal["user", "key"]
    name: str
    role: Role
    scopes: list[Scope]
    clinics: list[str]
    csrf_token: str | None = Field(None, description="for people: send it as X-CSRF-Token with every change")


class KeyIn(_In):
    role: Role = Field(examples=["uploader"])
    scopes: list[Scope] | None = Field(None, description="fewer than the role's")
    label: str = Field("", max_length=100, examples=["Spirometry room"])
    days: float | None = Field(None, gt=0, le=3650, description="until it runs out")
    clinic: Slug | None = None


class KeyOut(_Out):
    id: str
    prefix: str
    clinic: str
    role: Role
    scopes: list[Scope]
    label: str
    created_at: datetime
    created_by: str
    expires_at: datetime | None = None
    last_used_at: datetime | None = None
    revoked_at: datetime | None = None


class KeyMade(KeyOut):
    key: str = Field(description="shown this once", examples=["inh_5c1f0a9be2d7_..."])


class UserIn(_In):
    name: UserName = Field(examples=["kimura"])
    role: Role
    clinics: list[Slug] | None = Field(None, description="a pharmacist may have several; default: yours")


class UserChange(_In):
    is_active: StrictBool | None = None
    reset_password: StrictBool = False


class UserOut(_Out):
    id: str
    name: str
    role: Role
    clinics: list[str]
    is_yours_alone: bool = Field(description="no other clinic's: you may lock out, let in and give a new password")
    is_active: bool
    created_at: datetime
    last_login_at: datetime | None = None


class UserMade(UserOut):
    one_time_password: str = Field(description="shown this once; to be changed at the first login")


class WebhookIn(_In):
    url: str = Field(max_length=2000, examples=["https://hooks.example.org/inhalemon"])
    events: list[Literal["session.scored", "session.reviewed", "session.signed_off"]] = Field(min_length=1)
    clinic: Slug | None = None


class WebhookOut(_Out):
    id: str
    url: str
    events: list[str]
    created_at: datetime


class WebhookMade(WebhookOut):
    secret: str = Field(description="shown this once; signs every delivery")


class AuditOut(_Out):
    clinic: str
    seq: int
    at: datetime
    actor: str = Field(examples=["user:kimura"])
    action: str = Field(examples=["session.read"])
    subject: str | None
    detail: dict[str, Any]
    hash: str


class AuditPage(_Out):
    items: list[AuditOut]
    next: str | None = None


class AuditCheck(_Out):
    clinic: str
    entries: int
    faults: list[str]


class Version(_Out):
    service: str
    database: str
    pipeline: str
    settings_digest: str
    rules_digest: str


# ------------------------------------------------------------------------------------------ following

Direction = Literal["improving", "steady", "worsening", "unknown"]


class ProgressPoint(_Out):
    """One session, as it stands after review."""

    session: str
    at: datetime
    grade: Grade | None
    points: int | None
    machine_grade: Grade | None
    machine_points: int | None
    mistakes: list[str]
    steps_kept: int = Field(description="rules kept")
    steps_decided: int = Field(description="rules that could be decided")
    signed_off: bool


class RuleProgress(_Out):
    rule: str
    decided: int
    failed: int
    last: Verdict | None


class Trend(_Out):
    direction: Direction = Field(description="of the number of mistakes; unknown below four sessions")
    mistakes_per_30_days: float | None = Field(description="Theil and Sen's slope")


class Progress(_Out):
    patient_ref: str
    clinic: str
    sessions: list[ProgressPoint]
    rules: list[RuleProgress]
    trend: Trend


class Estimate(_Out):
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float


class AgreementRow(_Out):
    """The first judge is the machine (or one reviewer), the second, taken as the truth, a reviewer."""

    rule: str
    n: int
    both_fail: int
    only_first_fails: int
    only_second_fails: int
    both_pass: int
    undecided: int = Field(description="a reviewer decided, the machine could not; not in n")
    sensitivity: Estimate | None
    specificity: Estimate | None
    kappa: Estimate | None = Field(description="Cohen's; null when both always say the same one thing")


class AgreementTable(_Out):
    sessions: int
    rules: list[AgreementRow]


class Agreements(_Out):
    machine_and_reviewers: AgreementTable
    reviewers_among_each_other: AgreementTable
