"""One session: its curves, its findings, and the review beside them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import orjson
from fastapi import APIRouter, Form, Query, Request, Response
from pydantic import ValidationError
from starlette.concurrency import run_in_threadpool

from api import correcting, erasing, present, reviewing, viewing
from api.access import Administrator, Corrector, Reader, Reviewer, ServiceDep
from api.models import ReviewIn, SessionCorrection
from api.pages import findings
from api.pages.titles import rule_titles, rules_of
from api.principal import Principal, Scope
from api.problems import ChangedMeanwhileError, InvalidError, NotFoundError
from api.rendering import render, words_for
from api.routes.common import SessionId
from api.routes.reviews import IfMatch, version_of
from api.scoring import Scorer
from api.service import Service
from api.store import sessions
from api.store.reviews import ReviewKind
from api.store.sessions import State
from api.viewing import SessionView
from api.words import Words
from inhalemon.devices import load_device
from inhalemon.measures import MEASURES, unit_of
from inhalemon.report.panels import panel_kinds
from inhalemon.values import DeviceKind, Verdict

router = APIRouter(prefix="/sessions", tags=["pages"], include_in_schema=False)

ShortText = Annotated[str | None, Form(max_length=2000)]


@router.get("/{session_id}")
def session_page(
    request: Request,
    service: ServiceDep,
    who: Reader,
    session_id: SessionId,
    dose: Annotated[int | None, Query(ge=1)] = None,
) -> Response:
    """The session; with `dose`, the findings and measures of that dose alone."""
    found = viewing.session_view(service, who, session_id)
    words = words_for(request)
    report = None if found.report is None else orjson.loads(found.report.body)
    if dose is not None and (report is None or dose > len(report["doses"])):
        raise NotFoundError(f"There is no dose {dose} in this session.")
    is_held = found.lease is not None and found.lease.reviewer_id != who.id
    content: dict[str, Any] = {
        "session": present.summary(found.session, found.mistakes),
        "problem": None if found.session.failure is None else orjson.loads(found.session.failure),
        "report": report,
        "devices": [str(each) for each in DeviceKind],
        "holder": found.lease.reviewer if found.lease is not None and is_held else None,
    }
    if report is not None:
        content |= _review(request, service, who, found, dose)
        content["drawn"] = _drawn(session_id, report, words, dose)
        content["measures"] = _measures(report if dose is None else report["doses"][dose - 1], words)
    return render(request, "session.html", content, who=who)


@router.get("/{session_id}/state")
def wait(service: ServiceDep, who: Reader, session_id: SessionId) -> Response:
    """Nothing while a session waits to be scored; then the page is loaded again."""
    with service.store.read() as connection:
        is_waiting = sessions.find(connection, who.clinic_ids, session_id).state == State.UNSCORED
    return Response(status_code=204, headers={} if is_waiting else {"HX-Refresh": "true"})


@router.get("/{session_id}/review")
def review_part(request: Request, service: ServiceDep, who: Reader, session_id: SessionId) -> Response:
    """The review as it stands now."""
    return _review_part(request, service, who, viewing.session_view(service, who, session_id))


@router.post("/{session_id}/review")
def add_entry(
    request: Request,
    service: ServiceDep,
    who: Reviewer,
    session_id: SessionId,
    kind: Annotated[ReviewKind, Form()],
    rule: Annotated[str | None, Form(max_length=64)] = None,
    verdict: Annotated[str | None, Form(max_length=20)] = None,
    reason: ShortText = None,
    undoes: Annotated[str | None, Form(max_length=40)] = None,
    if_match: IfMatch = None,
) -> Response:
    """Append an entry and answer with the review; when somebody was first, with who that was."""
    try:
        given = ReviewIn.model_validate(
            {"kind": kind, "rule": rule, "verdict": verdict, "reason": reason or None, "undoes": undoes}
        )
    except ValidationError as error:
        raise InvalidError("; ".join(each["msg"] for each in error.errors())) from error
    expected = version_of(if_match)
    try:
        _, found = reviewing.append(service, who, session_id, given, expected, holds=True)
    except ChangedMeanwhileError:
        history = viewing.review_view(service, who, session_id)
        new = [entry for entry in history.entries if entry.version > (expected or 0)]
        content = {"new": new, "given": given, "session_id": session_id, "titles": rule_titles(service)}
        headers = {"HX-Retarget": "#conflict", "HX-Reswap": "innerHTML"}
        return render(request, "_conflict.html", content, who=who, status=412, headers=headers)
    return _review_part(request, service, who, found)


@router.post("/{session_id}/patient")
async def correct_patient(
    request: Request,
    service: ServiceDep,
    who: Corrector,
    session_id: SessionId,
    patient_ref: Annotated[str, Form(max_length=64)] = "",
) -> Response:
    given = SessionCorrection(patient_ref=patient_ref or None)
    await correcting.correct(service, request.app.state.scorer, who, session_id, given)
    return _reload()


@router.post("/{session_id}/device")
async def correct_device(
    request: Request, service: ServiceDep, who: Corrector, session_id: SessionId, device: Annotated[DeviceKind, Form()]
) -> Response:
    given = SessionCorrection(device=device)
    await correcting.correct(service, request.app.state.scorer, who, session_id, given)
    return _reload()


@router.post("/{session_id}/score")
async def score_again(request: Request, service: ServiceDep, who: Corrector, session_id: SessionId) -> Response:
    session = await run_in_threadpool(viewing.seen, service, who, session_id, "session.scored_again")
    scorer: Scorer = request.app.state.scorer
    await scorer.score(session, who.actor)
    return _reload()


@router.post("/{session_id}/erase")
def erase(service: ServiceDep, who: Administrator, session_id: SessionId) -> Response:
    erasing.erase_asked_for(service, who, session_id)
    return Response(status_code=204, headers={"HX-Redirect": "/sessions"})


def _reload() -> Response:
    return Response(status_code=204, headers={"HX-Refresh": "true"})


# ------------------------------------------------------------------------------------------ what the page shows


def _review_part(request: Request, service: Service, who: Principal, found: SessionView) -> Response:
    """The review alone, and beside it the result that it changed."""
    content = _review(request, service, who, found) | {"is_part": True}
    return render(request, "_review.html", content, who=who)


def _review(
    request: Request, service: Service, who: Principal, found: SessionView, dose: int | None = None
) -> dict[str, Any]:
    """The review; beside the findings of one dose nothing is said, since a review is of the whole session."""
    if found.report is None:
        raise NotFoundError(f"Session {found.session.id} is {found.session.state}.")
    report = orjson.loads(found.report.body)
    shown = report if dose is None else report["doses"][dose - 1]
    history = present.history(found.session, found.entries)
    words, titles = words_for(request), rule_titles(service)
    signed_off = [
        entry for entry in findings.standing(history) if entry.kind == ReviewKind.SIGN_OFF and not entry.is_outdated
    ]
    return {
        "session": present.summary(found.session, found.mistakes),
        "groups": findings.grouped(shown, history, words, titles, actor=who.actor),
        "history": history,
        "signed_off": signed_off,
        "has_signed": any(entry.reviewer == who.actor for entry in signed_off),
        "was_signed": any(entry.is_outdated for entry in history.entries),
        "titles": titles,
        "never_seen": findings.NEVER_SEEN,
        "missed": [rule for rule in rules_of(service, report["device"]) if _could_be_added(rule, report)],
        "may_review": Scope.REVIEW in who.scopes and dose is None,
        "dose": dose,
        "is_part": False,
    }


def _could_be_added(rule: str, report: Mapping[str, Any]) -> bool:
    return all(finding["verdict"] != Verdict.FAIL for finding in report["findings"] if finding["rule"] == rule)


def _drawn(session_id: str, report: Mapping[str, Any], words: Words, dose: int | None) -> dict[str, Any]:
    """What the script draws: phases and events with their names, and the words it needs."""
    phases, events = report["phases"], report["events"]
    times = [each[name] for each in (*phases, *events) for name in ("start_s", "end_s")]
    return {
        "url": f"/v1/sessions/{session_id}/series",
        "start_s": min(times, default=0.0),
        "end_s": max(times, default=report["duration_s"]),
        "phases": [phase | {"name": words.name("phase", phase["kind"])} for phase in phases],
        "events": [event | {"name": words.name("event", event["kind"])} for event in events],
        "dose": None if dose is None else {name: report["doses"][dose - 1][name] for name in ("start_s", "end_s")},
        "panels": _panels(report["device"], words),
        "words": {
            "failed": words("The curves could not be loaded."),
            "to": words("to"),
            "nowhere": words("This finding belongs to no one place in the curves."),
        },
    }


def _panels(device: str, words: Words) -> list[dict[str, Any]]:
    """The panels that the library draws too, but what only an engineer asks for (the filter's R)."""
    return [
        {
            "title": words(panel.title),
            "unit": panel.unit,
            "scale": 1 / panel.per_unit,
            "curves": [
                {"channel": curve.channel, "sd": curve.sd_channel, "name": words(curve.name)} for curve in panel.curves
            ],
        }
        for panel in panel_kinds(load_device(device).moving_part)
        if not panel.is_log
    ]


def _measures(report: Mapping[str, Any], words: Words) -> list[dict[str, str]]:
    rows = []
    for name, found in report["measures"].items():
        unit = unit_of(name)
        has_sd = found["value"] is not None and found["sd"] is not None
        rows.append(
            {
                "name": name,
                "meaning": words.name("measure", name, MEASURES.get(name)),
                "value": words.quantity(found["value"], unit),
                "sd": f"± {words.quantity(found['sd'], unit)}" if has_sd else "",
                "why": words.reason(found.get("reason")) if found["value"] is None else "",
            }
        )
    return rows
