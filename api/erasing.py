"""Erasing a session: rows, recording, cached series. The audit keeps that it happened, and nothing of the patient."""

from __future__ import annotations

from api.principal import Principal
from api.service import Service
from api.store import chores, sessions
from api.store.sessions import Session


def erase_asked_for(service: Service, who: Principal, session_id: str) -> None:
    """Erase a session because somebody wants it gone. Raises `NotFoundError`."""
    with service.store.read() as connection:
        session = sessions.find(connection, who.clinic_ids, session_id)
    erase(service, session, who.actor, reason="request")


def erase(service: Service, session: Session, actor: str, *, reason: str) -> None:
    """Erase a session. The files go after the rows; a crash in between is made good at the next start."""
    with service.store.write() as connection:
        chores.forget_answers(connection, session.id)
        sessions.erase(connection, session)
        service.audit.record(connection, session.clinic_id, actor, "session.erased", session.id, reason=reason)
    finish(service)


def finish(service: Service) -> None:
    """Remove the files of erased sessions."""
    with service.store.read() as connection:
        due = sessions.erasures_due(connection)
    for clinic_id, sha256, session_id in due:
        # The same bytes may have been uploaded again meanwhile: then the file stays, it is another session's.
        with service.files.held(sha256), service.store.write() as connection:
            if not sessions.is_kept(connection, clinic_id, sha256):
                service.files.erase(clinic_id, sha256)
            service.cache.drop(session_id)
            sessions.erased(connection, clinic_id, sha256)
