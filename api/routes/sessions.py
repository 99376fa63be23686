"""Sessions and what belongs to each: reports, the recording itself, curves; correcting and erasing."""

from __future__ import annotations

import base64
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import HTMLResponse, StreamingResponse
from starlette.concurrency import run_in_threadpool

from api import correcting, erasing, present, series, viewing
from api.access import Administrator, Corrector, Reader, ServiceDep
from api.answers import REPORT_POLICY, Json
from api.idempotency import Once
from api.models import SessionCorrection, SessionDetail, SessionPage, SessionSummary
from api.problems import ConflictError, NotFoundError
from api.report_models import Report, ReportVersion
from api.routes.common import ClinicQuery, Cursor, Limit, SessionId, problems
from api.routes.filters import FilterDep
from api.scoring import Scorer, ask_worker
from api.store import sessions
from api.store.listing import Order
from api.store.sessions import State

router = APIRouter(prefix="/v1/sessions", tags=["sessions"])
_MEDIA_TYPES = {
    ".csv": "text/csv",
    ".csv.gz": "application/gzip",
    ".csv.zst": "application/zstd",
    ".parquet": "application/vnd.apache.parquet",
}


@router.get("", summary="Sessions, filtered and ordered, a page at a time", responses=dict(problems(404)))
def list_sessions(
    service: ServiceDep,
    who: Reader,
    narrowed: FilterDep,
    order: Order = Order.NEWEST,
    clinic: ClinicQuery = None,
    cursor: Cursor = None,
    limit: Limit = 50,
) -> SessionPage:
    return viewing.list_view(service, who, narrowed, order=order, clinic=clinic, cursor=cursor, limit=limit)


@router.get(
    "/{session_id}",
    summary="One session with its newest report",
    responses={**problems(404), 200: {"model": SessionDetail}},
)
def get_session(service: ServiceDep, who: Reader, session_id: SessionId) -> Response:
    found = viewing.session_view(service, who, session_id)
    body = present.detail(found.session, found.report, found.mistakes)
    return Json(body, headers={"etag": f'"{found.session.n_reviews}"'})


@router.patch(
    "/{session_id}",
    summary="Correct a wrong patient_ref or device",
    responses=dict(problems(404, 500, 503)),
)
async def correct_session(
    request: Request, service: ServiceDep, who: Corrector, session_id: SessionId, given: SessionCorrection
) -> SessionSummary:
    """With another device the session is scored again; when it cannot be, it stays as it was."""
    return await correcting.correct(service, request.app.state.scorer, who, session_id, given)


@router.delete("/{session_id}", status_code=204, summary="Erase a session", responses=dict(problems(404)))
def erase_session(service: ServiceDep, who: Administrator, session_id: SessionId) -> Response:
    """Recording, reports, reviews and cached curves go; an audit entry without anything of the patient stays."""
    erasing.erase_asked_for(service, who, session_id)
    return Response(status_code=204)


# ------------------------------------------------------------------------------------------ reports


@router.get(
    "/{session_id}/report",
    summary="The newest report, or one version",
    responses={**problems(404), 200: {"model": Report}},
)
def get_report(
    service: ServiceDep,
    who: Reader,
    session_id: SessionId,
    version: Annotated[int | None, Query(ge=1)] = None,
) -> Response:
    with service.store.write() as connection:
        session = sessions.find(connection, who.clinic_ids, session_id)
        report = sessions.report(connection, session.id, version)
        if report is None:
            told = f"is {session.state}" if version is None else f"has no report version {version}"
            raise NotFoundError(f"Session {session.id} {told}.", state=session.state)
        service.audit.record(
            connection, session.clinic_id, who.actor, "report.read", session.id, version=report.version
        )
    return Response(
        report.body, media_type="application/json", headers={"inhalemon-report-version": str(report.version)}
    )


@router.get("/{session_id}/reports", summary="Every report ever made of a session", responses=dict(problems(404)))
def list_reports(service: ServiceDep, who: Reader, session_id: SessionId) -> list[ReportVersion]:
    with service.store.write() as connection:
        session = sessions.find(connection, who.clinic_ids, session_id)
        service.audit.record(connection, session.clinic_id, who.actor, "reports.listed", session.id)
        return [present.report_version(each) for each in sessions.report_versions(connection, session.id)]


@router.post(
    "/{session_id}/reports",
    status_code=201,
    summary="Score again, with the pipeline of today",
    responses={**problems(404, 500, 503), 201: {"model": Report}},
)
async def score_again(request: Request, service: ServiceDep, who: Corrector, session_id: SessionId) -> Response:
    """A report equal to the newest is not kept twice: then 201 answers with that one."""
    session = await run_in_threadpool(viewing.seen, service, who, session_id, "session.scored_again")
    once = Once(service, who, request, session.id)
    if (before := await once.begin()) is not None:
        return before
    async with once:
        scorer: Scorer = request.app.state.scorer
        _, report = await scorer.score(session, who.actor)
        location = f"/v1/sessions/{session.id}/report?version={report.version}"
        answer = Response(report.body, 201, {"location": location}, "application/json")
        return await once.finish(answer, session_ids=[session.id])


@router.get(
    "/{session_id}/report.html",
    summary="The report as a page of its own",
    response_class=HTMLResponse,
    responses=dict(problems(404, 409, 500, 503)),
)
async def get_report_page(service: ServiceDep, who: Reader, session_id: SessionId) -> Response:
    """The newest report as it is stored, with its review; the curves are those of its recording."""
    session, report, review = await run_in_threadpool(viewing.report_page_view, service, who, session_id)
    answer = await ask_worker(service, "page", session, report=report, review=review)
    return Response(answer.body, media_type="text/html", headers={"content-security-policy": REPORT_POLICY})


# ------------------------------------------------------------------------------------------ recording and curves


@router.get(
    "/{session_id}/recording",
    summary="The original bytes",
    response_class=StreamingResponse,
    responses=dict(problems(404)),
)
def get_recording(service: ServiceDep, who: Reader, session_id: SessionId) -> StreamingResponse:
    session = viewing.seen(service, who, session_id, "recording.read")
    digest = base64.b64encode(bytes.fromhex(session.sha256)).decode()
    return StreamingResponse(
        service.files.blocks(session.clinic_id, session.sha256),
        media_type=_MEDIA_TYPES.get(session.suffix, "application/octet-stream"),
        headers={
            "content-length": str(session.n_bytes),
            "content-disposition": f'attachment; filename="{session.id}{session.suffix or ".csv"}"',
            "repr-digest": f"sha-256=:{digest}:",
        },
    )


@router.get(
    "/{session_id}/series",
    summary="Curves, reduced to what a screen can show",
    responses={
        **problems(404, 500, 503),
        200: {"content": {"application/json": {}, series.BINARY_TYPE: {}}, "description": "min/max reduced"},
    },
)
async def get_series(
    service: ServiceDep,
    who: Reader,
    session_id: SessionId,
    channels: Annotated[str | None, Query(max_length=500, examples=["tilt_deg,angle_deg"])] = None,
    from_s: float | None = None,
    to_s: float | None = None,
    max_points: Annotated[int, Query(ge=2, le=50_000)] = 1500,
    format: Annotated[str | None, Query(pattern="^(json|binary)$")] = None,  # noqa: A002
    accept: Annotated[str, Header(include_in_schema=False)] = "",
) -> Response:
    """JSON, or little-endian float32 with `format=binary` or `Accept: application/vnd.inhalemon.series`: a uint32 with
    the length of a JSON head, the head, then one row of points for the time and for each channel.
    """
    names = series.chosen(channels)
    session = await run_in_threadpool(viewing.seen, service, who, session_id, "series.read")
    if session.state == State.UNUSABLE:
        raise ConflictError(f"Session {session.id} cannot be used; there is nothing to show.")
    table = await series.table_of(service, session)
    is_binary = format == "binary" or (format is None and series.BINARY_TYPE in accept)

    def packed() -> bytes:
        points = series.reduced(table, names, from_s=from_s, to_s=to_s, max_points=max_points)
        return series.as_binary(names, points) if is_binary else series.as_json(names, points)

    return Response(await run_in_threadpool(packed), media_type=series.BINARY_TYPE if is_binary else "application/json")
