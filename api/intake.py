"""From received bytes to a stored and scored session: store durably first, then score, then answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import orjson
from starlette.concurrency import run_in_threadpool

from api import erasing
from api.moments import new_id, recorded
from api.principal import Principal
from api.problems import InvalidError, NotFoundError, UnusableRecordingError
from api.pseudonym import checked
from api.scoring import Scorer
from api.service import Service
from api.settings import ServiceSettings
from api.store import Connection, chores, sessions
from api.store.sessions import Session, State, StoredReport
from api.uploads import Received, Upload
from inhalemon.values import DeviceKind

_SHORT = ("device", "patient_ref", "recorded_at", "session_id")
_KNOWN = frozenset({"format", "sensors", *_SHORT})
_MAX_TEXT = 200


@dataclass(frozen=True, slots=True)
class Metadata:
    """What came beside the samples; `sidecar` is all of it, as the reader takes it."""

    sidecar: bytes | None
    device: str | None
    patient_ref: str | None
    session_ref: str | None
    recorded_at_us: int | None


@dataclass(frozen=True, slots=True)
class Taken:
    """A session as it stands after an upload."""

    session: Session
    report: StoredReport
    is_new: bool
    differing: Sequence[str] = ()  # what was said of known bytes otherwise than the session has it; nothing was changed


# ------------------------------------------------------------------------------------------ metadata


def metadata_of(upload: Upload, query: Mapping[str, str], settings: ServiceSettings) -> list[Metadata]:
    """The metadata of each recording. Raises `InvalidError`.

    The k-th `metadata` part belongs to the k-th recording; a single one, and what stands in the query or in fields of
    its own, belongs to all.
    """
    parts = [_parsed(each) for each in upload.fields.get("metadata", [])]
    if "metadata" in query:
        parts = parts or [_parsed(query["metadata"].encode())]
    n = len(upload.recordings)
    if len(parts) not in (0, 1, n):
        raise InvalidError(
            f"There are {n} recordings and {len(parts)} metadata parts; send one for each, or one for all."
        )
    if len(parts) != n:
        parts = (parts or [{}]) * n
    short: dict[str, object] = {name: query[name] for name in _SHORT if name in query}
    for name in _SHORT:
        for value in upload.fields.get(name, []):
            try:
                short[name] = value.decode()
            except UnicodeDecodeError as error:
                raise InvalidError(f"{name} is not UTF-8.") from error
    return [_metadata(short | part, settings) for part in parts]


def _parsed(text: bytes) -> dict[str, object]:
    try:
        found = orjson.loads(text)
    except orjson.JSONDecodeError as error:
        raise InvalidError(f"metadata is not JSON: {error}.", line=error.lineno, column="metadata") from error
    if not isinstance(found, dict):
        raise InvalidError("metadata is not a JSON object.", column="metadata")
    return found


def _metadata(fields: Mapping[str, object], settings: ServiceSettings) -> Metadata:
    fields = {name: value for name, value in fields.items() if name in _KNOWN}  # names could hide in others
    values = {name: _text(fields, name) for name in _SHORT}
    if values["device"] is not None and values["device"] not in tuple(DeviceKind):
        raise InvalidError(
            f"device is {values['device']!r}; expected {', '.join(DeviceKind)}.", column="device", code="unknown_device"
        )
    recorded_at_us = _moment(values["recorded_at"])
    if values["patient_ref"] is not None:
        values["patient_ref"] = checked(values["patient_ref"], settings)
    given = dict(fields) | {name: value for name, value in values.items() if value is not None}
    return Metadata(
        sidecar=orjson.dumps(given) if given else None,
        device=values["device"],
        patient_ref=values["patient_ref"],
        session_ref=values["session_id"],
        recorded_at_us=recorded_at_us,
    )


def _text(fields: Mapping[str, object], name: str) -> str | None:
    found = fields.get(name)
    if found is None:
        return None
    if not isinstance(found, str) or not found.strip() or len(found) > _MAX_TEXT or not found.isprintable():
        raise InvalidError(f"{name} is not a text of 1 to {_MAX_TEXT} printable characters.", column=name)
    return found.strip()


def _moment(text: str | None) -> int | None:
    if text is None:
        return None
    try:
        return recorded(text)
    except (ValueError, OverflowError) as error:
        raise InvalidError(
            f"recorded_at is {text!r}; expected ISO 8601 from 1990 to 2100, such as 2026-11-20T08:30:00+09:00.",
            column="recorded_at",
        ) from error


# ------------------------------------------------------------------------------------------ taking


async def take(
    service: Service, scorer: Scorer, who: Principal, clinic_id: str, one: Received, metadata: Metadata
) -> Taken:
    """Store one recording and score it. Bytes that this clinic already has are not stored or scored again.

    Raises `DiskFullError`, `UnusableRecordingError` (nothing is kept), `BusyError`, `ScoringFailedError` (it is kept).
    """
    session, is_new = await run_in_threadpool(store, service, who.actor, clinic_id, one, metadata)
    service.metrics.uploads.labels("new" if is_new else "known").inc()
    service.metrics.upload_bytes.inc(one.incoming.size)
    if session.state == State.SCORED:
        report = await run_in_threadpool(_newest, service, session)
        return Taken(session, report, is_new=False, differing=() if is_new else _differing(session, metadata))
    try:
        session, report = await scorer.score(session, who.actor)
    except UnusableRecordingError as refusal:
        if is_new:
            await run_in_threadpool(erasing.erase, service, session, who.actor, reason="unusable")
        # Its sender knows the file by its own name; here that name is kept nowhere.
        refusal.detail = refusal.detail.replace(f"{session.id}{session.suffix}", one.file_name or "recording")
        refusal.extra["file"] = one.file_name
        raise
    return Taken(session, report, is_new)


def store(
    service: Service,
    actor: str,
    clinic_id: str,
    one: Received,
    metadata: Metadata,
    *,
    first_try_s: float | None = None,
) -> tuple[Session, bool]:
    """The stored session, durable, and whether it is new. Whoever stores it scores it; the background does after
    `first_try_s`, by default when that must have come to nothing.

    Known bytes that are not scored yet, or could not be, take the new metadata; a scored session keeps its own. Raises
    `DiskFullError`.
    """
    is_tried_now = first_try_s is None
    if first_try_s is None:
        first_try_s = 2 * service.settings.score_deadline_s
    sha256 = one.incoming.sha256
    with service.files.held(sha256):
        if not service.files.path(clinic_id, sha256).exists():
            service.files.keep(one.incoming, clinic_id)
        with service.store.write() as connection:
            session, is_new = sessions.add(
                connection,
                clinic_id,
                session_id=new_id(),
                sha256=sha256,
                n_bytes=one.incoming.size,
                suffix=one.suffix,
                session_ref=metadata.session_ref,
                device=metadata.device,
                patient_ref=metadata.patient_ref,
                sidecar=metadata.sidecar,
                recorded_at_us=metadata.recorded_at_us,
                uploaded_by=actor,
                attempts=int(is_tried_now),
                first_try_s=first_try_s,
            )
            if not is_new and session.state != State.SCORED and _differing(session, metadata):
                session = _described(connection, session, metadata, first_try_s)
            action = "session.uploaded" if is_new else "session.uploaded_again"
            service.audit.record(connection, clinic_id, actor, action, session.id, n_bytes=session.n_bytes)
    return session, is_new


def _differing(session: Session, metadata: Metadata) -> list[str]:
    """What the metadata give otherwise than the session has it, by name; what they leave out contradicts nothing."""
    held = _sidecar(session.sidecar) | {
        "device": session.device,
        "patient_ref": session.patient_ref,
        "recorded_at": session.recorded_at_us,
        "session_id": session.session_ref,
    }
    given = _sidecar(metadata.sidecar)
    if metadata.recorded_at_us is not None:
        given["recorded_at"] = metadata.recorded_at_us
    return sorted(name for name, value in given.items() if held.get(name) != value)


def _described(connection: Connection, session: Session, metadata: Metadata, first_try_s: float) -> Session:
    """The session with new metadata where they say something, due to be scored."""
    recorded_at_us = metadata.recorded_at_us or session.recorded_at_us
    chores.forget_answers(connection, session.id)  # they tell of the old metadata
    return sessions.describe(
        connection,
        session,
        sidecar=orjson.dumps(_sidecar(session.sidecar) | _sidecar(metadata.sidecar)),
        session_ref=metadata.session_ref or session.session_ref,
        device=metadata.device or session.device,
        patient_ref=metadata.patient_ref or session.patient_ref,
        recorded_at_us=recorded_at_us,
        first_try_s=first_try_s,
    )


def _sidecar(content: bytes | None) -> dict[str, object]:
    found: dict[str, object] = orjson.loads(content or b"{}")
    return found


def _newest(service: Service, session: Session) -> StoredReport:
    with service.store.read() as connection:
        report = sessions.report(connection, session.id)
    if report is None:
        raise NotFoundError("The session was erased meanwhile.")
    return report


def mistakes_in(report: StoredReport) -> Sequence[str]:
    """The rules that failed in a report."""
    findings = orjson.loads(report.body)["findings"]
    return sorted(each["rule"] for each in findings if each["verdict"] == "fail")
