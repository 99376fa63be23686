"""The audit, for administrators: who did or saw what, and whether the chain is whole."""

from __future__ import annotations

from fastapi import APIRouter

from api import viewing
from api.access import Administrator, ServiceDep
from api.models import AuditCheck, AuditPage
from api.routes.common import ClinicQuery, Cursor, Limit, problems

router = APIRouter(prefix="/v1/audit", tags=["audit"])


@router.get("", summary="Entries, newest first", responses=dict(problems(404)))
def list_audit(
    service: ServiceDep, who: Administrator, clinic: ClinicQuery = None, cursor: Cursor = None, limit: Limit = 50
) -> AuditPage:
    return viewing.audit_view(service, who, clinic=clinic, cursor=cursor, limit=limit)


@router.get("/verify", summary="Check the chain of every entry", responses=dict(problems(404)))
def verify(service: ServiceDep, who: Administrator, clinic: ClinicQuery = None) -> list[AuditCheck]:
    return viewing.audit_checks(service, who, clinic=clinic)
