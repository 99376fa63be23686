"""Patients over time, agreement, export."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query
from fastapi.responses import StreamingResponse

from api import exporting, viewing
from api.access import Exporter, Reader, ServiceDep
from api.models import Agreements, Progress
from api.routes.common import ClinicQuery, problems
from api.routes.filters import FilterDep

router = APIRouter(prefix="/v1", tags=["following"])


@router.get(
    "/patients/{ref}/progress",
    summary="A patient's mistakes over time, the trend, the steps kept",
    responses=dict(problems(404, 409)),
)
def get_progress(
    service: ServiceDep,
    who: Reader,
    ref: Annotated[str, Path(max_length=64, description="patient_ref")],
    clinic: ClinicQuery = None,
) -> Progress:
    """Verdicts are those after review: what a reviewer has overridden counts as the reviewer said. A reference that
    several of your clinics use may mean different people: 409 names the clinics until `clinic` says which.
    """
    return viewing.progress_view(service, who, ref, clinic=clinic)


@router.get(
    "/agreement", summary="Machine against reviewers, reviewers among each other", responses=dict(problems(404))
)
def get_agreement(service: ServiceDep, who: Reader, clinic: ClinicQuery = None) -> Agreements:
    """Per rule: n, sensitivity, specificity and Cohen's kappa with 95 % intervals, over reviewed sessions. A sign-off
    says that what its reviewer has not contradicted is right.
    """
    return viewing.agreement_view(service, who, clinic=clinic)


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
                connection, clinic_id, who.actor, "sessions.exported", format=format, by_patient=narrowed.is_of_patient
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
