"""Recordings come in."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Sequence
from typing import Any

from fastapi import APIRouter, Request, Response

from api import intake, present
from api.access import ServiceDep, Uploader
from api.answers import Json
from api.idempotency import Once
from api.models import SessionDetail, UploadItems
from api.problems import ProblemError
from api.routes.common import ClinicQuery, problems
from api.scoring import Scorer
from api.uploads import Upload, received

router = APIRouter(prefix="/v1", tags=["sessions"])

_METADATA = {
    "type": "object",
    "description": "the recording's sidecar, or a part of it",
    "example": {"device": "pmdi", "patient_ref": "P-0042", "recorded_at": "2026-11-20T08:30:00+09:00"},
}
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_BODY: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["recording"],
                    "properties": {
                        "recording": {"type": "array", "minItems": 1, "items": {"type": "string", "format": "binary"}},
                        "metadata": _METADATA,
                    },
                },
                "encoding": {"metadata": {"contentType": "application/json"}},
            },
            "text/csv": _BINARY,
            "application/gzip": _BINARY,
            "application/zstd": _BINARY,
            "application/vnd.apache.parquet": _BINARY,
        },
    },
    "parameters": [
        {"name": name, "in": "query", "schema": {"type": "string"}, "description": "of the recording, or in metadata"}
        for name in ("device", "patient_ref", "recorded_at", "session_id", "file_name")
    ]
    + [
        {"name": "Idempotency-Key", "in": "header", "schema": {"type": "string", "maxLength": 200}},
        {"name": "Repr-Digest", "in": "header", "schema": {"type": "string"}, "description": "sha-256=:BASE64:"},
    ],
}


@router.post(
    "/sessions",
    status_code=201,
    summary="Upload a recording, or several, and have it scored",
    openapi_extra=_BODY,
    responses={
        **problems(404, 408, 409, 413, 415, 500, 503, 507),
        200: {
            "model": SessionDetail,
            "description": "This clinic already had these bytes",
            "headers": {
                "Inhalemon-Differing": {
                    "schema": {"type": "string"},
                    "description": "what was said of them otherwise than the session has it; nothing was changed",
                }
            },
        },
        201: {"model": SessionDetail, "description": "Stored and scored"},
        207: {"model": UploadItems, "description": "Several files: one answer each"},
    },
)
async def upload_session(request: Request, service: ServiceDep, who: Uploader, clinic: ClinicQuery = None) -> Response:
    """One file answers 201 or 200 with the report. Several answer 207, item by item. Bytes are kept before they are
    scored: after 500 and 503 the session exists, is `unscored`, and is scored as soon as can be.
    """
    clinic_id = who.one_clinic(clinic)
    async with received(request, service.files, service.settings) as upload:
        metadata = intake.metadata_of(upload, request.query_params, service.settings)
        once = Once(service, who, request, _fingerprint(upload, metadata))
        if (before := await once.begin()) is not None:
            return before
        async with once:
            scorer: Scorer = request.app.state.scorer
            outcomes = await asyncio.gather(
                *(
                    intake.take(service, scorer, who, clinic_id, one, each)
                    for one, each in zip(upload.recordings, metadata, strict=True)
                ),
                return_exceptions=True,
            )
            return await once.finish(_answer(request, upload, outcomes), session_ids=_told_for_good(outcomes))


def _answer(request: Request, upload: Upload, outcomes: Sequence[intake.Taken | BaseException]) -> Response:
    if len(outcomes) == 1:
        (outcome,) = outcomes
        if isinstance(outcome, BaseException):
            raise outcome
        headers = {"location": _location(outcome)}
        if outcome.differing:
            headers["inhalemon-differing"] = ", ".join(outcome.differing)
        return Json(_detail(outcome), status_code=_status(outcome), headers=headers)
    items = []
    for one, outcome in zip(upload.recordings, outcomes, strict=True):
        if isinstance(outcome, intake.Taken):
            told: dict[str, object] = {"location": _location(outcome), "session": _detail(outcome)}
            if outcome.differing:
                told["differing"] = list(outcome.differing)
            items.append({"file": one.file_name, "status": _status(outcome), **told})
        elif isinstance(outcome, ProblemError):
            items.append({"file": one.file_name, "status": outcome.status, "problem": outcome.body()})
        else:
            raise outcome
    return Json({"items": items}, status_code=207)


def _detail(taken: intake.Taken) -> dict[str, object]:
    return present.detail(taken.session, taken.report, intake.mistakes_in(taken.report))


def _status(taken: intake.Taken) -> int:
    return 201 if taken.is_new else 200


def _location(taken: intake.Taken) -> str:
    return f"/v1/sessions/{taken.session.id}"


def _told_for_good(outcomes: Sequence[intake.Taken | BaseException]) -> list[str]:
    """The sessions of an answer that may be repeated; none while something in it is worth another try."""
    if any(isinstance(each, ProblemError) and each.status >= 500 for each in outcomes):
        return []
    return [each.session.id for each in outcomes if isinstance(each, intake.Taken)]


def _fingerprint(upload: Upload, metadata: Sequence[intake.Metadata]) -> str:
    """What makes two uploads the same: the bytes and what was said of them, not a form's boundaries."""
    digest = hashlib.sha256()
    for one, each in zip(upload.recordings, metadata, strict=True):
        digest.update(one.incoming.digest + (each.sidecar or b""))
    return digest.hexdigest()
