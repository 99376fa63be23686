"""Patients over time, agreement, export."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query
from fastapi.responses import StreamingResponse

from api import exporting, following
from api.access import Exporter, Reader, ServiceDep
from api.models import Agreements, Progress
from api.problems import NotFoundError
from api.routes.common import ClinicQuery, problems
from api.routes.filters import FilterDep, is_named

router = APIRouter(prefix="/v1", tags=["following"])


@router.get(
    "/patients/{ref}/progress",
    summary="A patient's mistakes over time, the trend, the steps kept",
    responses=dict(problems(404)),
)
def get_progress(
    service: ServiceDep,
    who: Reader,
    ref: Annotated[str, Path(max_length=64, description="patient_ref")],
    clinic: ClinicQuery = None,
) -> Progress:
    """Verdicts are those after review: what a reviewer has overridden counts as the reviewer said."""
    clinic_ids = who.narrowed(clinic)
    with service.store.write() as connection:
        found = following.progress(connection, clinic_ids, ref)
        if found is None:
            raise NotFoundError("There is no scored session of such a patient here.")
        for clinic_id in clinic_ids:
            service.audit.record(
                connection, clinic_id, who.actor, "patient.read", sessions=[each.session for each in found.sessions]
            )
    return found


@router.get(
    "/agreement", summary="Machine against reviewers, reviewers among each other", responses=dict(problems(404))
)
def get_agreement(service: ServiceDep, who: Reader, clinic: ClinicQuery = None) -> Agreements:
    """Per rule: n, sensitivity, specificity and Cohen's kappa with 95 % intervals, over reviewed sessions. A sign-off
    says that what its reviewer has not contradicted is right.
    """
    with service.store.read() as connection:
        return following.agreements(connection, who.narrowed(clinic))


@router.get("/export", summary="Everything, streamed", response_class=StreamingResponse, responses=dict(problems(404)))
def export(
    service: ServiceDep,
    who: Exporter,
    narrowed: FilterDep,
    clinic: ClinicQuery = None,
    format: Annotated[Literal["csv", "jsonl"], Query()] = "csv",  # noqa: A002
) -> StreamingResponse:
    """CSV: a row a session, measures and verdicts. JSONL: a line a session with its report and its whole review."""
    clinic_ids = who.narrowed(clinic)
    with service.store.write() as connection:
        for clinic_id in clinic_ids:
            service.audit.record(
                connection, clinic_id, who.actor, "sessions.exported", format=format, by_patient=is_named(narrowed)
            )
    make, media_type = {
        "csv": (exporting.csv_lines, "text/csv; charset=utf-8"),
        "jsonl": (exporting.jsonl, "application/jsonl"),
    }[format]
    return StreamingResponse(
        make(service, clinic_ids, narrowed),
        media_type=media_type,
        headers={"content-disposition": f'attachment; filename="inhalemon-export.{format}"'},
    )
