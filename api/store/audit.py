"""The audit: who did or saw what, in the transaction of the deed, chained per clinic, never changed.

Each entry's hash is an HMAC-SHA256 over the one before it and its own content, keyed with a secret that is not in the
database: whoever can write the tables cannot mend the chain after changing an entry.
"""

from __future__ import annotations

import hashlib
import hmac
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields

from sqlalchemy import Connection, bindparam, func, select, update

from api.moments import now_us
from api.store.engine import streamed
from api.store.tables import audit, audit_heads

_START = bytes(32)


@dataclass(frozen=True, slots=True)
class AuditEntry:
    clinic_id: str
    seq: int
    at_us: int
    actor: str
    action: str
    subject: str | None
    detail: str
    hash: bytes


# Built once: these run with every request.
_HEAD = (
    select(audit_heads.c.seq, audit_heads.c.hash)
    .where(audit_heads.c.clinic_id == bindparam("of_clinic"))
    .with_for_update()
)
_APPEND = audit.insert()
_MOVE_HEAD = update(audit_heads).where(audit_heads.c.clinic_id == bindparam("of_clinic"))
_NAMES = [each.name for each in fields(AuditEntry)]


class AuditLog:
    """Writes and verifies the chains."""

    def __init__(self, key: bytes) -> None:
        self._key = key

    def record(
        self,
        connection: Connection,
        clinic_id: str,
        actor: str,
        action: str,
        subject: str | None = None,
        **detail: object,
    ) -> None:
        """Append one entry. Details hold identifiers, versions and counts, never what is known of a patient."""
        head = connection.execute(_HEAD, {"of_clinic": clinic_id}).one()
        seq, at_us = head.seq + 1, now_us()
        text = json.dumps(detail, sort_keys=True, separators=(",", ":"))
        mark = self._hash(head.hash, clinic_id, seq, at_us, actor, action, subject, text)
        entry = AuditEntry(clinic_id, seq, at_us, actor, action, subject, text, mark)
        connection.execute(_APPEND, {name: getattr(entry, name) for name in _NAMES})
        connection.execute(_MOVE_HEAD, {"of_clinic": clinic_id, "seq": seq, "hash": mark})

    def record_listing(
        self,
        connection: Connection,
        clinic_ids: Sequence[str],
        actor: str,
        action: str,
        shown: Iterable[str],
        **detail: object,
    ) -> None:
        """One entry for each clinic that was looked into: how many of `shown` (a clinic for each thing) are its own."""
        counts = Counter(shown)
        for clinic_id in clinic_ids:
            self.record(connection, clinic_id, actor, action, None, count=counts[clinic_id], **detail)

    def _hash(self, before: bytes, *content: object) -> bytes:
        canonical = json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode()
        return hmac.new(self._key, before + canonical, hashlib.sha256).digest()

    def faults(self, connection: Connection, clinic_id: str) -> list[str]:
        """What is wrong with one clinic's chain, in words; empty when it is whole."""
        before, seq = _START, 0
        for entry in entries(connection, (clinic_id,), oldest_first=True):
            if entry.seq != seq + 1:
                return [f"entry {seq + 1} is missing; {entry.seq} follows {seq}"]
            seq = entry.seq
            content = (clinic_id, seq, entry.at_us, entry.actor, entry.action, entry.subject, entry.detail)
            if not hmac.compare_digest(self._hash(before, *content), entry.hash):
                return [f"entry {seq} was changed, or an entry before it"]
            before = entry.hash
        head = connection.execute(select(audit_heads).where(audit_heads.c.clinic_id == clinic_id)).one_or_none()
        if head is None:
            return ["the head of the chain is missing"]
        if (head.seq, bytes(head.hash)) != (seq, before):
            return [f"the chain ends at entry {seq}; its head says {head.seq}"]
        return []


def begin(connection: Connection, clinic_id: str) -> None:
    """Start the chain of a new clinic."""
    connection.execute(audit_heads.insert().values(clinic_id=clinic_id, seq=0, hash=_START))


def chains(connection: Connection) -> list[str]:
    """The clinics that have a chain or entries, by identifier."""
    heads = select(audit_heads.c.clinic_id).union(select(audit.c.clinic_id))
    return sorted(connection.scalars(heads))


def page(
    connection: Connection, clinic_ids: Sequence[str], before: tuple[int, str] | None, limit: int
) -> list[AuditEntry]:
    """Entries, newest first, after a cursor of (sequence number, clinic)."""
    statement = select(audit).where(audit.c.clinic_id.in_(clinic_ids))
    if before is not None:
        seq, clinic_id = before
        statement = statement.where(
            (audit.c.seq < seq) | ((audit.c.seq == seq) & (audit.c.clinic_id < clinic_id)),
        )
    statement = statement.order_by(audit.c.seq.desc(), audit.c.clinic_id.desc()).limit(limit)
    return [AuditEntry(**row) for row in connection.execute(statement).mappings()]


def entries(connection: Connection, clinic_ids: Sequence[str], *, oldest_first: bool = False) -> Iterator[AuditEntry]:
    """All entries."""
    order = audit.c.seq.asc() if oldest_first else audit.c.seq.desc()
    statement = select(audit).where(audit.c.clinic_id.in_(clinic_ids)).order_by(audit.c.clinic_id, order)
    for row in streamed(connection, statement):
        yield AuditEntry(**row)


def count(connection: Connection, clinic_id: str) -> int:
    return connection.scalar(select(func.count()).select_from(audit).where(audit.c.clinic_id == clinic_id)) or 0
