"""Who asks, and what each role may do. Clinics are tenants: a principal sees its own and no other exists for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

from api.problems import InvalidError, NotAllowedError, NotFoundError


class Role(StrEnum):
    UPLOADER = "uploader"
    CLINICIAN = "clinician"
    PHARMACIST = "pharmacist"
    ADMINISTRATOR = "administrator"


class Scope(StrEnum):
    UPLOAD = "upload"  # send recordings, and see the report that is answered
    READ = "read"  # see sessions, reports, patients' progress
    REVIEW = "review"  # confirm, override, comment, sign off
    CORRECT = "correct"  # score again, mend a wrong patient_ref
    EXPORT = "export"  # everything of a clinic in one file
    ADMIN = "admin"  # people, keys, webhooks, audit, erasing


SCOPES: Mapping[Role, frozenset[Scope]] = MappingProxyType(
    {
        Role.UPLOADER: frozenset({Scope.UPLOAD}),
        Role.CLINICIAN: frozenset({Scope.UPLOAD, Scope.READ, Scope.REVIEW, Scope.CORRECT, Scope.EXPORT}),
        Role.PHARMACIST: frozenset({Scope.READ, Scope.REVIEW}),
        Role.ADMINISTRATOR: frozenset(Scope),
    }
)


@dataclass(frozen=True, slots=True)
class Principal:
    """A person or a program that is known; `clinics` maps the slug of each of its clinics to the identifier."""

    id: str
    kind: str  # user, key
    name: str
    role: Role
    scopes: frozenset[Scope]
    clinics: Mapping[str, str]
    csrf_token: str | None = None  # people who came with a cookie
    must_change_password: bool = False

    @property
    def actor(self) -> str:
        """As the audit names it."""
        return f"{self.kind}:{self.name}"

    @property
    def clinic_ids(self) -> tuple[str, ...]:
        return tuple(self.clinics.values())

    def require(self, scope: Scope) -> None:
        """Raises `NotAllowedError` when the role or the key's scopes lack `scope`."""
        if scope not in self.scopes:
            raise NotAllowedError(f"This needs the scope `{scope}`; this {self.kind} is a {self.role}.")

    def narrowed(self, slug: str | None) -> tuple[str, ...]:
        """The clinics to look into: all of one's own, or the one named. Another's is not found."""
        if slug is None:
            return self.clinic_ids
        if slug not in self.clinics:
            raise NotFoundError(f"There is no clinic {slug!r} here.")
        return (self.clinics[slug],)

    def one_clinic(self, slug: str | None) -> str:
        """The clinic that a new thing belongs to. Raises `InvalidError` when several could be meant."""
        ids = self.narrowed(slug)
        if len(ids) != 1:
            raise InvalidError(f"Say which clinic: clinic={' or '.join(sorted(self.clinics))}.")
        return ids[0]
