"""Stored things in the words of `models.py`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import orjson

from api import models
from api.moments import to_datetime, to_iso
from api.principal import Role, Scope
from api.report_models import ReportVersion
from api.store.audit import AuditEntry
from api.store.people import ApiKey, User
from api.store.reviews import Lease, Review, ReviewKind
from api.store.sessions import Session, StoredReport
from api.verdicts import sign_offs
from inhalemon.values import Grade


def moment(at_us: int | None) -> str | None:
    return None if at_us is None else to_iso(at_us)


def summary(session: Session, mistakes: Sequence[str] = ()) -> models.SessionSummary:
    return models.SessionSummary(**_summary(session, mistakes))  # type: ignore[arg-type]  # pydantic parses the moments


def _summary(session: Session, mistakes: Sequence[str]) -> dict[str, object]:
    return {
        "id": session.id,
        "session_id": session.session_ref,
        "clinic": session.clinic,
        "device": session.device,
        "patient_ref": session.patient_ref,
        "recorded_at": moment(session.recorded_at_us),
        "uploaded_at": moment(session.uploaded_at_us),
        "state": session.state,
        "duration_s": session.duration_s,
        "grade": session.grade,
        "points": session.points,
        "machine_grade": session.machine_grade,
        "machine_points": session.machine_points,
        "mistakes": list(mistakes),
        "reviews": session.n_reviews,
        "reviewed_at": moment(session.reviewed_at_us),
        "signed_off_at": moment(session.signed_off_us),
    }


def detail(session: Session, report: StoredReport | None, mistakes: Sequence[str]) -> dict[str, object]:
    """A `SessionDetail` for orjson, with the stored report as it is."""
    return _summary(session, mistakes) | {
        "sha256": session.sha256,
        "n_bytes": session.n_bytes,
        "uploaded_by": session.uploaded_by,
        "report": None if report is None else orjson.Fragment(report.body),
        "problem": None if session.failure is None else orjson.Fragment(session.failure),
    }


def export_line(
    session: Session, body: bytes | None, mistakes: Sequence[str], entries: Sequence[Review]
) -> dict[str, object]:
    """A session for the export: as `detail`, without what is only about the upload, and with its review."""
    return _summary(session, mistakes) | {
        "report": None if body is None else orjson.Fragment(body),
        "reviews": [each.model_dump(mode="json") for each in history(session, entries).entries],
    }


def grade(name: str | None) -> Grade | None:
    return None if name is None else Grade(name)


def report_version(report: StoredReport) -> ReportVersion:
    return ReportVersion(
        version=report.version,
        created_at=to_datetime(report.created_at_us),
        pipeline_version=report.pipeline_version,
        settings_digest=report.settings_digest,
        rules_digest=report.rules_digest,
        grade=Grade(report.grade),
        points=report.points,
    )


def history(session: Session, entries: Sequence[Review]) -> models.ReviewHistory:
    undone = {entry.undoes for entry in entries if entry.kind == ReviewKind.UNDO}
    holding = {entry.id for entry in sign_offs(entries, session.report_id)}
    return models.ReviewHistory(
        session=session.id,
        version=session.n_reviews,
        signed_off_at=None if session.signed_off_us is None else to_datetime(session.signed_off_us),
        entries=[
            review(
                entry,
                is_undone=entry.id in undone,
                is_outdated=entry.kind == ReviewKind.SIGN_OFF and entry.id not in holding | undone,
            )
            for entry in entries
        ],
    )


def review(entry: Review, *, is_undone: bool = False, is_outdated: bool = False) -> models.ReviewOut:
    return models.ReviewOut(
        id=entry.id,
        version=entry.version,
        kind=ReviewKind(entry.kind),
        rule=entry.rule,
        verdict=entry.verdict,
        machine_verdict=entry.machine_verdict,
        reason=entry.reason,
        undoes=entry.undoes,
        is_undone=is_undone,
        is_outdated=is_outdated,
        reviewer=entry.reviewer,
        at=to_datetime(entry.at_us),
    )


def lease(found: Lease) -> models.LeaseOut:
    return models.LeaseOut(reviewer=found.reviewer, expires_at=to_datetime(found.expires_at_us))


def queue_item(session: Session, mistakes: Sequence[str], held: Lease | None) -> models.QueueItem:
    return models.QueueItem(session=summary(session, mistakes), lease=None if held is None else lease(held))


def key(found: ApiKey) -> models.KeyOut:
    return models.KeyOut(
        id=found.id,
        prefix=found.prefix,
        clinic=found.clinic,
        role=Role(found.role),
        scopes=[Scope(each) for each in found.scopes.split()],
        label=found.label,
        created_at=to_datetime(found.created_at_us),
        created_by=found.created_by,
        expires_at=None if found.expires_at_us is None else to_datetime(found.expires_at_us),
        last_used_at=None if found.last_used_us is None else to_datetime(found.last_used_us),
        revoked_at=None if found.revoked_at_us is None else to_datetime(found.revoked_at_us),
    )


def user(found: User, visible: Mapping[str, str]) -> models.UserOut:
    """A person, with the clinics that the one who asks may know of."""
    return models.UserOut(
        id=found.id,
        name=found.name,
        role=Role(found.role),
        clinics=[slug for slug in found.clinics if slug in visible],
        is_yours_alone=found.clinics.keys() <= visible.keys(),
        is_active=found.is_active,
        created_at=to_datetime(found.created_at_us),
        last_login_at=None if found.last_login_us is None else to_datetime(found.last_login_us),
    )


def audit_entry(found: AuditEntry, clinic: str) -> models.AuditOut:
    return models.AuditOut(
        clinic=clinic,
        seq=found.seq,
        at=to_datetime(found.at_us),
        actor=found.actor,
        action=found.action,
        subject=found.subject,
        detail=orjson.loads(found.detail),
        hash=found.hash.hex(),
    )
