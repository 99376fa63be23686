"""Scoring one stored session: a worker does it, the store keeps it, webhooks are told."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import orjson
import structlog
from starlette.concurrency import run_in_threadpool

from api import verdicts
from api.jobs import Answer, CrashedError, DeadlineError, SaturatedError
from api.moments import SECOND_US, now_us, recorded, to_iso
from api.problems import (
    BusyError,
    InvalidError,
    NotReadyError,
    ProblemError,
    ScoringFailedError,
    UnusableRecordingError,
)
from api.pseudonym import checked
from api.service import Service
from api.settings import ServiceSettings
from api.store import Connection, chores, reviews, sessions
from api.store.sessions import Session, StoredReport

log = structlog.get_logger(__name__)

Scored = tuple[Session, StoredReport]
_BACKOFF_S = (2.0, 10.0, 60.0, 300.0, 1800.0)


@dataclass(frozen=True, slots=True)
class _Told:
    """What the recording says of itself, by what came beside it or from within the file."""

    session_ref: str | None
    patient_ref: str | None
    recorded_at_us: int | None


def _told_within(found: Mapping[str, object], session: Session, settings: ServiceSettings) -> _Told:
    """What only the file tells. Raises `UnusableRecordingError`: one that itself tells a name must not be kept."""
    recorded_at = _text(found.get("recorded_at")) if session.recorded_at_us is None else None
    session_ref = _text(found.get("session_ref")) if session.session_ref is None else None
    patient_ref = _text(found.get("patient_ref")) if session.patient_ref is None else None
    try:
        recorded_at_us = None if recorded_at is None else recorded(recorded_at)
    except ValueError as error:
        raise UnusableRecordingError(
            f"recorded_at is {recorded_at!r}; expected a time from 1990 to 2100.", column="recorded_at"
        ) from error
    try:
        return _Told(
            session_ref,
            None if patient_ref is None else checked(patient_ref, settings),
            recorded_at_us,
        )
    except InvalidError as error:
        raise UnusableRecordingError(error.detail, headers=None, **error.extra) from error


class Scorer:
    """Scores sessions, each at most once at a time however many ask."""

    def __init__(self, service: Service) -> None:
        self._service = service
        self._under_way: dict[tuple[str, bytes | None], asyncio.Task[Scored]] = {}

    async def score(
        self, session: Session, actor: str, *, in_background: bool = False, device: str | None = None
    ) -> Scored:
        """The session as it now stands, and its new report; `device` corrects its device, if it can be scored as that.

        Raises `BusyError`, `ScoringFailedError`, `UnusableRecordingError`. A caller who leaves does not stop it.
        """
        wanted = session if device is None else replace(session, sidecar=_with_device(session.sidecar, device))
        key = (session.id, wanted.sidecar)
        task = self._under_way.get(key)
        if task is None:
            task = asyncio.create_task(self._score(wanted, actor, in_background=in_background, device=device))
            self._under_way[key] = task
            task.add_done_callback(lambda _: self._under_way.pop(key, None))
        return await asyncio.shield(task)

    async def finish(self) -> None:
        """Wait for what is under way."""
        await asyncio.gather(*self._under_way.values(), return_exceptions=True)

    async def _score(self, session: Session, actor: str, *, in_background: bool, device: str | None) -> Scored:
        started_s = time.perf_counter()
        outcome = "failed"
        if in_background:  # whoever stores a session counts the first try with it
            session = await run_in_threadpool(self._begin, session)
        try:
            answer = await ask_worker(self._service, "score", session, in_background=in_background)
            kept = await run_in_threadpool(self._keep, session, answer, actor, device)
            outcome = "scored"
            return kept
        except BusyError:
            outcome = "saturated"
            await run_in_threadpool(self._put_off, session)
            raise
        except ProblemError as problem:
            outcome = problem.kind
            if device is None:  # otherwise nothing was corrected, and the session is as it was
                await run_in_threadpool(self._note, session, problem)
            raise
        finally:
            duration_s = time.perf_counter() - started_s
            self._service.metrics.scorings.labels(outcome).observe(duration_s)
            log.info("scored", session=session.id, outcome=outcome, duration_ms=round(duration_s * 1000))

    def _keep(self, session: Session, answer: Answer, actor: str, device: str | None) -> Scored:
        service = self._service
        found = answer.head
        told = _told_within(found, session, service.settings)
        with service.store.write() as connection:
            session = sessions.find(connection, (session.clinic_id,), session.id, lock=True)
            if device is not None:
                session = replace(session, sidecar=_with_device(session.sidecar, device))
                chores.forget_answers(connection, session.id)  # they tell of the wrong device
                service.audit.record(
                    connection, session.clinic_id, actor, "session.device_corrected", session.id, device=device
                )
            entries = reviews.history(connection, session.id) if session.n_reviews else []
            session, kept = sessions.keep_report(
                connection,
                session,
                answer.body,
                verdicts.outcome(verdicts.report_of(answer.body), entries, service.rules),
                device=str(found["device"]),
                session_ref=told.session_ref,
                patient_ref=told.patient_ref,
                recorded_at_us=told.recorded_at_us,
            )
            service.audit.record(
                connection,
                session.clinic_id,
                actor,
                "session.scored",
                session.id,
                version=kept.version,
                pipeline=kept.pipeline_version,
                settings=kept.settings_digest[:12],
                rules=kept.rules_digest[:12],
            )
            announce(connection, session, "session.scored", grade=kept.grade, points=kept.points, version=kept.version)
        return session, kept

    def _begin(self, session: Session) -> Session:
        with self._service.store.write() as connection:
            attempts = sessions.begin_try(connection, session.id, 2 * self._service.settings.score_deadline_s)
        return replace(session, attempts=attempts)

    def _put_off(self, session: Session) -> None:
        with self._service.store.write() as connection:
            sessions.put_off(connection, session.id, attempts=max(session.attempts - 1, 0))

    def _note(self, session: Session, problem: ProblemError) -> None:
        is_final = isinstance(problem, UnusableRecordingError)
        tries = max(session.attempts, 1)
        is_last = is_final or tries >= self._service.settings.score_attempts
        pause_s = _BACKOFF_S[min(tries, len(_BACKOFF_S)) - 1]
        with self._service.store.write() as connection:
            sessions.note_failure(
                connection,
                session.id,
                problem.body(),
                next_try_us=None if is_last else now_us() + round(pause_s * SECOND_US),
                is_final=is_final,
            )


async def ask_worker(
    service: Service, task: str, session: Session, *, in_background: bool = False, **more: object
) -> Answer:
    """Have a worker do something with a session's recording; its failures told as problems."""
    order = {
        "path": str(service.files.path(session.clinic_id, session.sha256)),
        # Errors name it, and without a session_id of its own the recording is called by it.
        "name": f"{session.id}{session.suffix}",
        "metadata": None if session.sidecar is None else session.sidecar.decode(),
        **more,
    }
    try:
        answer = await service.pool.run(_order(service, task, **order), in_background=in_background)
    except SaturatedError as error:
        raise BusyError(
            f"Session {session.id} is kept; its scoring waits until there is room.", session=session.id
        ) from error
    except CrashedError as error:
        raise ScoringFailedError(
            f"A worker crashed on session {session.id}; its recording is kept and will be tried again.",
            session=session.id,
        ) from error
    except DeadlineError as error:
        raise ScoringFailedError(
            f"Session {session.id} was not done within {service.settings.score_deadline_s:g} s; its recording is kept"
            " and will be tried again.",
            session=session.id,
        ) from error
    refusal = answer.head.get("refusal")
    if isinstance(refusal, dict):
        told = str(refusal.pop("sentence"))
        raise UnusableRecordingError(told, **refusal)
    if (failure := answer.head.get("failure")) is not None:
        log.error("worker failed", session=session.id, failure=failure)
        raise ScoringFailedError(
            f"Session {session.id} could not be worked on; its recording is kept.", session=session.id
        )
    return answer


def _order(service: Service, task: str, **more: object) -> dict[str, object]:
    settings = service.settings.scoring_settings
    return {
        "task": task,
        "settings": None if settings is None else str(settings),
        "rules": service.settings.scoring_rules,
        **more,
    }


async def pipeline_versions(service: Service) -> dict[str, str]:
    """`pipeline`, `settings_digest` and `rules_digest`, as the workers have them; asked once."""
    if not service.versions:
        try:
            async with asyncio.timeout(service.pool.deadline_s):
                answer = await service.pool.run(_order(service, "versions"), in_background=True)
        except (CrashedError, DeadlineError, SaturatedError, TimeoutError) as error:
            raise NotReadyError("No worker can start; the log says why.") from error
        service.versions.update({name: str(value) for name, value in answer.head.items()})
    return service.versions


def announce(connection: Connection, session: Session, event: str, **more: object) -> None:
    """Tell the clinic's webhooks of something about a session: identifiers and grades, nothing of the patient."""
    body = {"event": event, "session": session.id, "clinic": session.clinic, "at": to_iso(now_us()), **more}
    chores.announce(connection, session.clinic_id, event, orjson.dumps(body))


def _with_device(sidecar: bytes | None, device: str) -> bytes:
    return orjson.dumps(orjson.loads(sidecar or b"{}") | {"device": device})


def _text(value: object) -> str | None:
    return value if isinstance(value, str) and value else None
