"""Putting right what was said of a recording: its patient, its device."""

from __future__ import annotations

import orjson
from starlette.concurrency import run_in_threadpool

from api import present
from api.models import SessionCorrection, SessionSummary
from api.principal import Principal
from api.pseudonym import checked
from api.scoring import Scorer
from api.service import Service
from api.store import chores, sessions
from api.store.sessions import Session


async def correct(
    service: Service, scorer: Scorer, who: Principal, session_id: str, given: SessionCorrection
) -> SessionSummary:
    """The session as corrected; with another device it is scored again first, and stays as it was if it cannot be.

    Raises `InvalidError`, `NotFoundError`, and what `Scorer.score` raises.
    """
    ref = given.patient_ref
    if ref is not None:
        ref = checked(ref, service.settings)
    if "device" in given.model_fields_set:
        await scorer.score(await run_in_threadpool(_found, service, who, session_id), who.actor, device=given.device)
    if "patient_ref" in given.model_fields_set:
        await run_in_threadpool(_correct_patient, service, who, session_id, ref)
    return await run_in_threadpool(_summary, service, who, session_id)


def _found(service: Service, who: Principal, session_id: str) -> Session:
    with service.store.read() as connection:
        return sessions.find(connection, who.clinic_ids, session_id)


def _correct_patient(service: Service, who: Principal, session_id: str, ref: str | None) -> None:
    with service.store.write() as connection:
        session = sessions.find(connection, who.clinic_ids, session_id, lock=True)
        sidecar = orjson.loads(session.sidecar or b"{}") | {"patient_ref": ref}
        kept = {name: value for name, value in sidecar.items() if value is not None}
        sessions.set_patient(connection, session.id, ref, orjson.dumps(kept) if kept else None)
        chores.forget_answers(connection, session.id)  # they hold the wrong reference
        # That it was changed and by whom; neither the old reference nor the new one.
        service.audit.record(connection, session.clinic_id, who.actor, "session.patient_corrected", session.id)


def _summary(service: Service, who: Principal, session_id: str) -> SessionSummary:
    with service.store.read() as connection:
        session = sessions.find(connection, who.clinic_ids, session_id)
        return present.summary(session, sessions.mistakes_of(connection, [session.id])[session.id])
