"""What a review entry must be to make sense, how it is appended, and who reviews what next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from api import present, verdicts
from api.models import LeaseOut, QueueItem, ReviewIn
from api.principal import Principal
from api.problems import ChangedMeanwhileError, ConflictError, InvalidError
from api.scoring import announce
from api.service import Service
from api.store import Connection, reviews, sessions
from api.store.reviews import Review, ReviewKind
from api.store.sessions import Session, State
from api.viewing import SessionView, read_session
from inhalemon.values import Report


def append(
    service: Service, who: Principal, session_id: str, given: ReviewIn, expected: int | None, *, holds: bool = False
) -> tuple[Review, SessionView]:
    """Append an entry to a session's review, and tell who listens; gives the entry and the session as it then stands.

    `expected` is the version that the reviewer saw. Who `holds` the session goes on holding it, unless somebody else
    has it or this signs it off. Raises `ChangedMeanwhileError`, `ConflictError`, `InvalidError`,
    `NotFoundError`.
    """
    with service.store.write() as connection:
        session = sessions.find(connection, who.clinic_ids, session_id, lock=True)
        if expected is not None and expected != session.n_reviews:
            raise ChangedMeanwhileError(
                f"The review is at version {session.n_reviews}, you saw {expected}; look again before you go on.",
                version=session.n_reviews,
            )
        if session.state != State.SCORED:
            raise ConflictError(f"Session {session.id} is {session.state}; there is nothing to review yet.")
        report, entries = _newest(connection, session), reviews.history(connection, session.id)
        machine_verdict = _checked(verdicts.machine(report), entries, who, given)
        entry = reviews.append(
            connection,
            session,
            given.kind,
            reviewer_id=who.id,
            reviewer=who.actor,
            rule=given.rule,
            verdict=machine_verdict if given.kind == ReviewKind.CONFIRM else _verdict(given),
            machine_verdict=machine_verdict,
            reason=given.reason,
            undoes=given.undoes,
        )
        entries = [*entries, entry]
        signed = verdicts.sign_offs(entries, session.report_id)
        sessions.settle(
            connection,
            session,
            verdicts.outcome(report, entries, service.rules),
            signed_off_us=signed[-1].at_us if signed else None,
        )
        service.audit.record(
            connection, session.clinic_id, who.actor, "session.reviewed", session.id, kind=given.kind, entry=entry.id
        )
        announce(connection, session, "session.reviewed", kind=given.kind, version=entry.version)
        if given.kind == ReviewKind.SIGN_OFF:
            announce(connection, session, "session.signed_off", version=entry.version)
            reviews.release_lease(connection, session.id, who.id)
        elif holds:
            reviews.try_lease(connection, session.id, who.id, who.actor, _lease_s(service))
        return entry, read_session(connection, who, session_id)


def take_next(service: Service, who: Principal, *, clinic: str | None, after: str | None) -> QueueItem | None:
    """The next session of the queue, held for this reviewer; `after`, just done, is let go and not given again."""
    clinic_ids = who.narrowed(clinic)
    with service.store.write() as connection:
        if after is not None:
            reviews.release_lease(connection, after, who.id)
        for session in reviews.queue(connection, clinic_ids, who.id, 20):
            if session.id == after:
                continue
            lease = reviews.try_lease(connection, session.id, who.id, who.actor, _lease_s(service))
            if lease is not None:
                service.audit.record(connection, session.clinic_id, who.actor, "queue.taken", session.id)
                mistakes = sessions.mistakes_of(connection, [session.id])[session.id]
                return present.queue_item(session, mistakes, lease)
    return None


def hold(service: Service, who: Principal, session_id: str) -> LeaseOut:
    """Hold a session for this reviewer, or hold it longer. Raises `ConflictError`, `NotFoundError`."""
    with service.store.write() as connection:
        session = sessions.find(connection, who.clinic_ids, session_id)
        lease = reviews.take_lease(connection, session.id, who.id, who.actor, _lease_s(service))
        service.audit.record(connection, session.clinic_id, who.actor, "queue.taken", session.id)
    return present.lease(lease)


def _lease_s(service: Service) -> float:
    return service.settings.lease_minutes * 60


def _newest(connection: Connection, session: Session) -> Report:
    report = sessions.report(connection, session.id)
    if report is None:  # a scored session has one
        raise ConflictError(f"Session {session.id} has no report; there is nothing to review yet.")
    return verdicts.report_of(report.body)


def _verdict(given: ReviewIn) -> str | None:
    return "fail" if given.kind == ReviewKind.ADD else given.verdict


def _checked(said: Mapping[str, str], entries: Sequence[Review], who: Principal, given: ReviewIn) -> str | None:
    """What the machine said of the rule, after the entry was found to make sense."""
    kind = given.kind
    needs_rule = kind in {ReviewKind.CONFIRM, ReviewKind.OVERRIDE, ReviewKind.ADD}
    _want(needs_rule == (given.rule is not None), kind, "a rule" if needs_rule else "no rule")
    _want((kind == ReviewKind.OVERRIDE) == (given.verdict is not None), kind, "a verdict with `override`, only")
    needs_reason = kind in {ReviewKind.OVERRIDE, ReviewKind.ADD, ReviewKind.COMMENT}
    _want(not needs_reason or given.reason is not None, kind, "a reason")
    _want((kind == ReviewKind.UNDO) == (given.undoes is not None), kind, "`undoes` with `undo`, only")
    machine_verdict = None if given.rule is None else said.get(given.rule)
    if kind in {ReviewKind.CONFIRM, ReviewKind.OVERRIDE} and machine_verdict is None:
        raise InvalidError(f"The report has no finding {given.rule!r}; its rules are {', '.join(said)}.", column="rule")
    if kind == ReviewKind.OVERRIDE and machine_verdict == given.verdict:
        raise InvalidError(f"The machine says {machine_verdict} too; confirm it instead.", column="verdict")
    if kind == ReviewKind.ADD and machine_verdict == "fail":
        raise InvalidError("The machine found that mistake too; confirm it instead.", column="rule")
    if kind == ReviewKind.UNDO:
        _check_undo(entries, who, given)
    return machine_verdict


def _check_undo(entries: Sequence[Review], who: Principal, given: ReviewIn) -> None:
    target = next((entry for entry in verdicts.standing(entries) if entry.id == given.undoes), None)
    if target is None:
        raise InvalidError("There is no standing entry of that id here; undo what is there.", column="undoes")
    if target.reviewer_id != who.id:
        raise ConflictError("That entry is somebody else's; write one of your own beside it.")


def _want(is_so: bool, kind: ReviewKind, wanted: str) -> None:
    if not is_so:
        raise InvalidError(f"An entry of kind `{kind}` needs {wanted}.")
