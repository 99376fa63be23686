"""Sessions as HL7 FHIR R4B."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from fastapi import APIRouter, Response

from api.access import Anybody, Reader, ServiceDep
from api.problems import NotFoundError, NotInstalledError
from api.routes.common import SessionId, problems
from api.store import reviews, sessions

router = APIRouter(prefix="/v1", tags=["fhir"])
_BUNDLE: dict[int | str, dict[str, Any]] = {200: {"content": {"application/fhir+json": {}}, "description": "a Bundle"}}


def _fhir() -> ModuleType:
    """The module that needs fhir.resources: an extra, and slow to load."""
    try:
        from api import fhir  # noqa: PLC0415
    except ImportError as error:
        raise NotInstalledError("FHIR needs the extra `fhir`: pip install 'inhalemon[fhir]'.") from error
    return fhir


@router.get(
    "/sessions/{session_id}/fhir",
    summary="A session as an HL7 FHIR R4B Bundle",
    response_class=Response,
    responses={**problems(404), **_BUNDLE},
)
def get_bundle(service: ServiceDep, who: Reader, session_id: SessionId) -> Response:
    """Two Devices, an Observation with components, a DiagnosticReport (preliminary until signed off), a Provenance."""
    with service.store.write() as connection:
        session = sessions.find(connection, who.clinic_ids, session_id)
        report = sessions.report(connection, session.id)
        if report is None:
            raise NotFoundError(f"Session {session.id} is {session.state}.", state=session.state)
        entries = reviews.history(connection, session.id)
        service.audit.record(connection, session.clinic_id, who.actor, "fhir.read", session.id, version=report.version)
    fhir = _fhir()
    content = fhir.bundle(session, report, entries, service.rules)
    return Response(content, media_type=fhir.MEDIA_TYPE)


@router.get(
    "/fhir/code-systems",
    summary="The codes of rules and measures, as FHIR CodeSystems",
    response_class=Response,
    responses={**problems(), **_BUNDLE},
)
def get_code_systems(service: ServiceDep, _who: Anybody) -> Response:
    fhir = _fhir()
    return Response(fhir.code_systems(service.rules), media_type=fhir.MEDIA_TYPE)
