"""The audit, for administrators: who did or saw what, and whether the chain is whole."""

from __future__ import annotations

import orjson
from fastapi import APIRouter

from api.access import Administrator, ServiceDep
from api.models import AuditCheck, AuditOut, AuditPage
from api.moments import to_datetime
from api.routes.common import ClinicQuery, Cursor, Limit, problems
from api.store import audit

router = APIRouter(prefix="/v1/audit", tags=["audit"])


@router.get("", summary="Entries, newest first", responses=dict(problems(404)))
def list_audit(
    service: ServiceDep, who: Administrator, clinic: ClinicQuery = None, cursor: Cursor = None, limit: Limit = 50
) -> AuditPage:
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
    has_more = len(found) > limit
    return AuditPage(
        items=[
            AuditOut(
                clinic=slugs[each.clinic_id],
                seq=each.seq,
                at=to_datetime(each.at_us),
                actor=each.actor,
                action=each.action,
                subject=each.subject,
                detail=orjson.loads(each.detail),
                hash=each.hash.hex(),
            )
            for each in shown
        ],
        next=service.secret.sign_cursor("audit", (shown[-1].seq, shown[-1].clinic_id)) if has_more else None,
    )


@router.get("/verify", summary="Check the chain of every entry", responses=dict(problems(404)))
def verify(service: ServiceDep, who: Administrator, clinic: ClinicQuery = None) -> list[AuditCheck]:
    clinic_ids = who.narrowed(clinic)
    slugs = {clinic_id: slug for slug, clinic_id in who.clinics.items()}
    with service.store.read() as connection:
        return [
            AuditCheck(
                clinic=slugs[clinic_id],
                entries=audit.count(connection, clinic_id),
                faults=service.audit.faults(connection, clinic_id),
            )
            for clinic_id in clinic_ids
        ]
