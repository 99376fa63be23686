"""What people and programs look at, for routes and pages alike: one transaction and one audit entry each."""

from __future__ import annotations

from dataclasses import dataclass

import orjson

from api import following, models, present, report_page, verdicts
from api.principal import Principal
from api.problems import AmbiguousPatientError, NotFoundError
from api.service import Service
from api.store import Connection, audit, listing, people, reviews, sessions
from api.store.listing import Filter, Order
from api.store.reviews import Lease, Review
from api.store.sessions import Session, StoredReport


@dataclass(frozen=True, slots=True)
class SessionView:
    """A session with its newest report and its review."""

    session: Session
    report: StoredReport | None
    mistakes: list[str]  # after review
    entries: list[Review]
    lease: Lease | None


def read_session(connection: Connection, who: Principal, session_id: str) -> SessionView:
    """The session as it stands; whoever calls this leaves the audit entry. Raises `NotFoundError`."""
    session = sessions.find(connection, who.clinic_ids, session_id)
    return SessionView(
        session=session,
        report=sessions.report(connection, session.id),
        mistakes=sessions.mistakes_of(connection, [session.id])[session.id],
        entries=reviews.history(connection, session.id),
        lease=reviews.leases_of(connection, [session.id]).get(session.id),
    )


def session_view(service: Service, who: Principal, session_id: str) -> SessionView:
    """The session, looked at. Raises `NotFoundError`."""
    with service.store.write() as connection:
        found = read_session(connection, who, session_id)
        service.audit.record(connection, found.session.clinic_id, who.actor, "session.read", session_id)
    return found


def seen(service: Service, who: Principal, session_id: str, action: str) -> Session:
    """The session, with an audit entry that something of it was looked at. Raises `NotFoundError`."""
    with service.store.write() as connection:
        session = sessions.find(connection, who.clinic_ids, session_id)
        service.audit.record(connection, session.clinic_id, who.actor, action, session.id)
    return session


def report_page_view(service: Service, who: Principal, session_id: str) -> tuple[Session, str, str]:
    """A session, and its report and review as the worker that makes their page takes them. Raises `NotFoundError`."""
    with service.store.write() as connection:
        found = read_session(connection, who, session_id)
        if found.report is None:
            raise NotFoundError(f"Session {session_id} is {found.session.state}.", state=found.session.state)
        roles = people.roles_of(connection, {entry.reviewer_id for entry in found.entries})
        service.audit.record(
            connection, found.session.clinic_id, who.actor, "report.read", session_id, version=found.report.version
        )
    report = verdicts.report_of(found.report.body)
    review = report_page.told(report, found.entries, found.report.id, service.rules, roles)
    return found.session, found.report.body.decode(), orjson.dumps(review).decode()


def review_view(service: Service, who: Principal, session_id: str) -> models.ReviewHistory:
    """Every entry of a session's review. Raises `NotFoundError`."""
    with service.store.write() as connection:
        session = sessions.find(connection, who.clinic_ids, session_id)
        entries = reviews.history(connection, session.id)
        service.audit.record(connection, session.clinic_id, who.actor, "reviews.read", session.id)
    return present.history(session, entries)


def list_view(
    service: Service,
    who: Principal,
    narrowed: Filter,
    *,
    order: Order,
    clinic: str | None,
    cursor: str | None,
    limit: int,
) -> models.SessionPage:
    """A page of sessions. Raises `BadRequestError` for a cursor of another listing, `NotFoundError`."""
    clinic_ids = who.narrowed(clinic)
    # A cursor belongs to its listing: with other filters or another order it is refused, not misread.
    name = f"sessions:{order}:{narrowed}:{clinic_ids}"
    after = None if cursor is None else service.secret.read_cursor(name, cursor)
    with service.store.write() as connection:
        found = listing.page(connection, clinic_ids, narrowed, order, after, limit + 1)
        shown = found[:limit]
        mistakes = sessions.mistakes_of(connection, [each.id for each in shown])
        owners = [each.clinic_id for each in shown]
        service.audit.record_listing(
            connection, clinic_ids, who.actor, "sessions.listed", owners, by_patient=narrowed.is_of_patient
        )
    last = listing.position(shown[-1], order) if len(found) > limit else None
    return models.SessionPage(
        items=[present.summary(each, mistakes[each.id]) for each in shown],
        next=None if last is None else service.secret.sign_cursor(name, last),
    )


def queue_view(service: Service, who: Principal, *, clinic: str | None, limit: int) -> models.Queue:
    """Scored, not signed off, and held by nobody else: the worst first. Raises `NotFoundError`."""
    clinic_ids = who.narrowed(clinic)
    with service.store.write() as connection:
        found = reviews.queue(connection, clinic_ids, who.id, limit)
        ids = [each.id for each in found]
        mistakes, leases = sessions.mistakes_of(connection, ids), reviews.leases_of(connection, ids)
        owners = [each.clinic_id for each in found]
        service.audit.record_listing(connection, clinic_ids, who.actor, "queue.read", owners)
    return models.Queue(items=[present.queue_item(each, mistakes[each.id], leases.get(each.id)) for each in found])


def progress_view(service: Service, who: Principal, patient_ref: str, *, clinic: str | None) -> models.Progress:
    """A patient over time. Raises `AmbiguousPatientError` when several clinics have such a patient, `NotFoundError`."""
    with service.store.write() as connection:
        having = listing.clinics_of_patient(connection, who.narrowed(clinic), patient_ref)
        if len(having) > 1:
            raise AmbiguousPatientError(patient_ref, list(having))
        found = next((following.progress(connection, *each, patient_ref) for each in having.items()), None)
        if found is None:
            raise NotFoundError("There is no scored session of such a patient here.")
        for clinic_id in having.values():
            service.audit.record(
                connection, clinic_id, who.actor, "patient.read", sessions=[each.session for each in found.sessions]
            )
    return found


def agreement_view(service: Service, who: Principal, *, clinic: str | None) -> models.Agreements:
    """Machine against reviewers, and reviewers against each other. Raises `NotFoundError`."""
    with service.store.read() as connection:
        return following.agreements(connection, who.narrowed(clinic))


def audit_view(
    service: Service, who: Principal, *, clinic: str | None, cursor: str | None, limit: int
) -> models.AuditPage:
    """Entries of the audit, newest first. Raises `BadRequestError` for a cursor of another listing, `NotFoundError`."""
    clinic_ids = who.narrowed(clinic)
    slugs = {clinic_id: slug for slug, clinic_id in who.clinics.items()}
    before = None
    if cursor is not None:
        seq, clinic_id = service.secret.read_cursor("audit", cursor)
        before = (int(seq), str(clinic_id))
    with service.store.write() as connection:
        found = audit.page(connection, clinic_ids, before, limit + 1)
        for clinic_id in clinic_ids:
            service.audit.record(connection, clinic_id, who.actor, "audit.read")
    shown = found[:limit]
    last = (shown[-1].seq, shown[-1].clinic_id) if len(found) > limit else None
    return models.AuditPage(
        items=[present.audit_entry(each, slugs[each.clinic_id]) for each in shown],
        next=None if last is None else service.secret.sign_cursor("audit", last),
    )


def audit_checks(service: Service, who: Principal, *, clinic: str | None) -> list[models.AuditCheck]:
    """Whether the chain of each clinic is whole. Raises `NotFoundError`."""
    clinic_ids = who.narrowed(clinic)
    slugs = {clinic_id: slug for slug, clinic_id in who.clinics.items()}
    with service.store.read() as connection:
        return [
            models.AuditCheck(
                clinic=slugs[clinic_id],
                entries=audit.count(connection, clinic_id),
                faults=service.audit.faults(connection, clinic_id),
            )
            for clinic_id in clinic_ids
        ]
