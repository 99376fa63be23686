"""What goes over the wire, typed and with examples. Reports go out as they were stored; `Report` describes them."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, StrictBool, StringConstraints, model_validator

from api.principal import Role, Scope
from api.report_models import Out, Report
from api.store.reviews import ReviewKind
from inhalemon.values import DeviceKind, Grade, Verdict

Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1, max_length=2000)]
Slug = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9-]{0,62}$")]
UserName = Annotated[
    str, StringConstraints(strip_whitespace=True, to_lower=True, pattern=r"^[A-Za-z0-9][\w.@+-]{1,99}$")
]
RuleId = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{1,63}$")]


class _In(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Problem(Out):
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


# ------------------------------------------------------------------------------------------ sessions


class SessionSummary(Out):
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


class SessionPage(Out):
    items: list[SessionSummary]
    next: str | None = Field(None, description="pass it as `cursor` for the next page")


class UploadItem(Out):
    """One of several files: a session, or a problem, with the status it would have had alone."""

    file: str | None
    status: int
    location: str | None = None
    session: SessionDetail | None = None
    problem: Problem | None = None
    differing: list[str] = Field(default_factory=list, description="as the header Inhalemon-Differing")


class UploadItems(Out):
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


class ReviewOut(Out):
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


class ReviewHistory(Out):
    session: str
    version: int = Field(description="also the ETag, for If-Match")
    signed_off_at: datetime | None
    entries: list[ReviewOut]


class LeaseOut(Out):
    reviewer: str
    expires_at: datetime


class QueueItem(Out):
    session: SessionSummary
    lease: LeaseOut | None = None


class Queue(Out):
    items: list[QueueItem]


# ------------------------------------------------------------------------------------------ people and programs


class Me(Out):
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


class KeyOut(Out):
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


class UserOut(Out):
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


class WebhookOut(Out):
    id: str
    url: str
    events: list[str]
    created_at: datetime


class WebhookMade(WebhookOut):
    secret: str = Field(description="shown this once; signs every delivery")


class AuditOut(Out):
    clinic: str
    seq: int
    at: datetime
    actor: str = Field(examples=["user:kimura"])
    action: str = Field(examples=["session.read"])
    subject: str | None
    detail: dict[str, Any]
    hash: str


class AuditPage(Out):
    items: list[AuditOut]
    next: str | None = None


class AuditCheck(Out):
    clinic: str
    entries: int
    faults: list[str]


class Version(Out):
    service: str
    database: str
    pipeline: str
    settings_digest: str
    rules_digest: str


# ------------------------------------------------------------------------------------------ following

Direction = Literal["improving", "steady", "worsening", "unknown"]


class ProgressPoint(Out):
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


class RuleProgress(Out):
    rule: str
    decided: int
    failed: int
    last: Verdict | None


class Trend(Out):
    direction: Direction = Field(description="of the number of mistakes; unknown below four sessions")
    mistakes_per_30_days: float | None = Field(description="Theil and Sen's slope")


class Progress(Out):
    patient_ref: str
    clinic: str
    sessions: list[ProgressPoint]
    rules: list[RuleProgress]
    trend: Trend


class Estimate(Out):
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float


class AgreementRow(Out):
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


class AgreementTable(Out):
    sessions: int
    rules: list[AgreementRow]


class Agreements(Out):
    machine_and_reviewers: AgreementTable
    reviewers_among_each_other: AgreementTable
