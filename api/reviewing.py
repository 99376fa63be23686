"""What a review entry must be to make sense, and how it is appended."""

from __future__ import annotations

from api.models import ReviewIn
from api.principal import Principal
from api.problems import ChangedMeanwhileError, ConflictError, InvalidError
from api.scoring import announce
from api.service import Service
from api.store import Connection, reviews, sessions
from api.store.reviews import Review, ReviewKind
from api.store.sessions import Session, State


def append(
    service: Service, who: Principal, session_id: str, given: ReviewIn, expected: int | None
) -> tuple[Review, Session]:
    """Append an entry to a session's review, and tell who listens.

    `expected` is the version that the reviewer saw. Raises `ChangedMeanwhileError`, `ConflictError`, `InvalidError`,
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
        machine_verdict = _checked(connection, session, who, given)
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
        service.audit.record(
            connection, session.clinic_id, who.actor, "session.reviewed", session.id, kind=given.kind, entry=entry.id
        )
        announce(connection, session, "session.reviewed", kind=given.kind, version=entry.version)
        if given.kind == ReviewKind.SIGN_OFF:
            announce(connection, session, "session.signed_off", version=entry.version)
            reviews.release_lease(connection, session.id, who.id)
        return entry, sessions.find(connection, who.clinic_ids, session_id)


def _verdict(given: ReviewIn) -> str | None:
    return "fail" if given.kind == ReviewKind.ADD else given.verdict


def _checked(connection: Connection, session: Session, who: Principal, given: ReviewIn) -> str | None:
    """What the machine said of the rule, after the entry was found to make sense."""
    kind = given.kind
    needs_rule = kind in {ReviewKind.CONFIRM, ReviewKind.OVERRIDE, ReviewKind.ADD}
    _want(needs_rule == (given.rule is not None), kind, "a rule" if needs_rule else "no rule")
    _want((kind == ReviewKind.OVERRIDE) == (given.verdict is not None), kind, "a verdict with `override`, only")
    needs_reason = kind in {ReviewKind.OVERRIDE, ReviewKind.ADD, ReviewKind.COMMENT}
    _want(not needs_reason or given.reason is not None, kind, "a reason")
    _want((kind == ReviewKind.UNDO) == (given.undoes is not None), kind, "`undoes` with `undo`, only")
    said = sessions.verdicts_of(connection, [session.id])[session.id]
    machine_verdict = None if given.rule is None else said.get(given.rule)
    if kind in {ReviewKind.CONFIRM, ReviewKind.OVERRIDE} and machine_verdict is None:
        raise InvalidError(f"The report has no finding {given.rule!r}; its rules are {', '.join(said)}.", column="rule")
    if kind == ReviewKind.OVERRIDE and machine_verdict == given.verdict:
        raise InvalidError(f"The machine says {machine_verdict} too; confirm it instead.", column="verdict")
    if kind == ReviewKind.ADD and machine_verdict == "fail":
        raise InvalidError("The machine found that mistake too; confirm it instead.", column="rule")
    if kind == ReviewKind.UNDO:
        _check_undo(reviews.history(connection, session.id), who, given)
    return machine_verdict


def _check_undo(entries: list[Review], who: Principal, given: ReviewIn) -> None:
    target = next((entry for entry in reviews.standing(entries) if entry.id == given.undoes), None)
    if target is None:
        raise InvalidError("There is no standing entry of that id here; undo what is there.", column="undoes")
    if target.reviewer_id != who.id:
        raise ConflictError("That entry is somebody else's; write one of your own beside it.")


def _want(is_so: bool, kind: ReviewKind, wanted: str) -> None:
    if not is_so:
        raise InvalidError(f"An entry of kind `{kind}` needs {wanted}.")
