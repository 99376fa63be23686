"""The pages for people. They show and change through the same functions as the routes for programs do."""

from fastapi import APIRouter

from api.pages import agreement, audit, home, patients, queue, reference, session, sessions, settings, upload

ROUTERS: tuple[APIRouter, ...] = (
    home.router,
    queue.router,
    sessions.router,
    session.router,
    patients.router,
    agreement.router,
    upload.router,
    settings.router,
    audit.router,
    reference.router,
)
