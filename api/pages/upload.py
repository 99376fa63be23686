"""Many files, each with its own progress and its own outcome; the script sends them to `POST /v1/sessions`."""

from __future__ import annotations

from typing import Final

from fastapi import APIRouter, Request, Response

from api.access import Uploader
from api.principal import Scope
from api.rendering import render, words_for
from inhalemon.values import DeviceKind

router = APIRouter(tags=["pages"], include_in_schema=False)

_SAID_BY_THE_SCRIPT: Final = {
    "waiting": "waiting",
    "sending": "sending",
    "scoring": "scoring",
    "done": "done",
    "known": "was here already",
    "differing": "described otherwise, and not changed",
    "kept": "kept; it will be scored later",
    "failed": "not accepted",
    "offline": "The connection broke.",
    "retry": "Try again",
    "open": "Open",
    "line": "line",
    "column": "column",
    "remove": "Remove",
    "lone": "This .json belongs to no recording here.",
    "progress": "{done} of {all} done, {failed} not accepted",
}


@router.get("/upload")
def upload_page(request: Request, who: Uploader) -> Response:
    words = words_for(request)
    said = {name: words(text) for name, text in _SAID_BY_THE_SCRIPT.items()}
    content = {
        "clinics": sorted(who.clinics),
        "devices": [str(each) for each in DeviceKind],
        "words": said | {"grades": words.names("grade"), "may_open": Scope.READ in who.scopes},
    }
    return render(request, "upload.html", content, who=who)
