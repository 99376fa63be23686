"""Everything the service refuses or fails at: one tree of errors, told as RFC 9457 problem details by one handler.

Modules raise these; none of them builds an error response of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence


class ServiceError(Exception):
    """Base of every error that the service raises on purpose."""


class ConfigurationError(ServiceError):
    """Settings that cannot be used; told to the operator, never to a client."""


class ProblemError(ServiceError):
    """An error that a client is told. `kind` is stable; `detail` says what was found, wanted, and what to do."""

    status = 500
    kind = "internal-error"
    title = "Something went wrong here"

    def __init__(self, detail: str, *, headers: Mapping[str, str] | None = None, **extra: object) -> None:
        super().__init__(detail)
        self.detail = detail
        self.headers = dict(headers or {})
        self.extra = extra

    def body(self, instance: str | None = None) -> dict[str, object]:
        """The problem as a JSON object."""
        members: dict[str, object] = {
            "type": f"urn:inhalemon:problem:{self.kind}",
            "title": self.title,
            "status": self.status,
            "detail": self.detail,
        }
        if instance is not None:
            members["instance"] = instance
        return members | {name: value for name, value in self.extra.items() if value is not None}


class BadRequestError(ProblemError):
    status, kind, title = 400, "bad-request", "The request cannot be understood"


class NotLoggedInError(ProblemError):
    status, kind, title = 401, "not-authenticated", "A valid key or login is needed"

    def __init__(self, detail: str = "Send `Authorization: Bearer KEY`, or log in.") -> None:
        super().__init__(detail, headers={"WWW-Authenticate": 'Bearer realm="inhalemon"'})


class NotAllowedError(ProblemError):
    status, kind, title = 403, "not-allowed", "This role or key may not do that"


class CsrfError(NotAllowedError):
    kind, title = "csrf", "The form's token is missing or old"


class PasswordChangeError(NotAllowedError):
    kind, title = "password-change-needed", "The one-time password must be changed first"


class NotFoundError(ProblemError):
    status, kind, title = 404, "not-found", "There is no such thing here"


class ConflictError(ProblemError):
    status, kind, title = 409, "conflict", "That does not fit the present state"


class AmbiguousPatientError(ConflictError):
    """A pseudonym means somebody else at each clinic."""

    kind, title = "ambiguous-patient", "Several clinics have such a patient"

    def __init__(self, patient_ref: str, clinics: Sequence[str]) -> None:
        super().__init__(
            f"{' and '.join(clinics)} each have a patient of that reference, who may be different people;"
            " say which with ?clinic=.",
            clinics=list(clinics),
        )
        self.patient_ref = patient_ref
        self.clinics = tuple(clinics)


class ChangedMeanwhileError(ProblemError):
    status, kind, title = 412, "changed-meanwhile", "Somebody was first"


class TooLargeError(ProblemError):
    status, kind, title = 413, "too-large", "The upload is too large"


class TooSlowError(ProblemError):
    status, kind, title = 408, "too-slow", "The upload stalled"

    def __init__(self, detail: str) -> None:
        super().__init__(detail, headers={"Connection": "close"})


class UnsupportedTypeError(ProblemError):
    status, kind, title = 415, "unsupported-type", "That is not a recording this service reads"


class InvalidError(ProblemError):
    status, kind, title = 422, "invalid", "A value cannot be used"


class UnusableRecordingError(ProblemError):
    status, kind, title = 422, "unusable-recording", "The recording cannot be used"


class TooManyRequestsError(ProblemError):
    status, kind, title = 429, "too-many-requests", "Too many requests"

    def __init__(self, detail: str, retry_after_s: float) -> None:
        super().__init__(detail, headers={"Retry-After": str(max(1, round(retry_after_s)))})


class ScoringFailedError(ProblemError):
    status, kind, title = 500, "scoring-failed", "Scoring failed; the recording is kept and will be tried again"


class NotInstalledError(ProblemError):
    status, kind, title = 501, "not-installed", "This installation lacks an extra part"


class BusyError(ProblemError):
    status, kind, title = 503, "busy", "Scoring is saturated; the recording is kept and will be scored later"

    def __init__(self, detail: str, retry_after_s: float = 5, **extra: object) -> None:
        super().__init__(detail, headers={"Retry-After": str(max(1, round(retry_after_s)))}, **extra)


class CrowdedError(ProblemError):
    status, kind, title = 503, "crowded", "Too many ask at once"

    def __init__(self, detail: str, retry_after_s: float) -> None:
        super().__init__(detail, headers={"Retry-After": str(max(1, round(retry_after_s)))})


class NotReadyError(ProblemError):
    status, kind, title = 503, "not-ready", "The service cannot work at present"


class DiskFullError(ProblemError):
    status, kind, title = 507, "disk-full", "There is no room left on the disk"

    def __init__(self, detail: str = "Nothing of this request was kept. Free some space, then send it again.") -> None:
        super().__init__(detail)
