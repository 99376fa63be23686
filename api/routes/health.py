"""Whether the service lives, can work, and what it is: for load balancers, Prometheus and people who ask."""

from __future__ import annotations

from fastapi import APIRouter, Response

import inhalemon
from api.access import ServiceDep
from api.answers import Json
from api.models import Version
from api.problems import NotReadyError
from api.scoring import pipeline_versions
from api.service import Service
from api.store import chores, sessions

router = APIRouter(tags=["service"])


@router.get("/livez", summary="The process answers")
@router.get("/v1/livez", include_in_schema=False)
async def livez() -> Response:
    return Json({"status": "alive"})


@router.get("/readyz", summary="Uploads can be kept: database and disk take a write")
@router.get("/v1/readyz", include_in_schema=False)
def readyz(service: ServiceDep) -> Response:
    _try_writing(service)
    return Json({"status": "ready"})


def _try_writing(service: Service) -> None:
    """Raises `DiskFullError` or `NotReadyError`."""
    try:
        service.files.require_room()
        service.files.try_writing()
    except OSError as error:
        raise NotReadyError("The folder of the recordings cannot be written to.") from error
    with service.store.write() as connection:
        chores.beat(connection)


@router.get("/metrics", summary="Counters and durations in Prometheus' text format", response_class=Response)
@router.get("/v1/metrics", include_in_schema=False, response_class=Response)
def metrics(service: ServiceDep) -> Response:
    with service.store.read() as connection:
        for state, count in sessions.count_by_state(connection).items():
            service.metrics.sessions.labels(state).set(count)
    service.metrics.waiting.set(service.pool.n_waiting)
    service.metrics.crashes.set(service.pool.crashes)
    return Response(service.metrics.text(), media_type="text/plain; version=0.0.4; charset=utf-8")


@router.get("/version", summary="The versions of service, pipeline and database")
@router.get("/v1/version", include_in_schema=False)
async def version(service: ServiceDep) -> Version:
    return Version(
        service=inhalemon.__version__,
        database=service.store.url.get_backend_name(),
        **await pipeline_versions(service),
    )
