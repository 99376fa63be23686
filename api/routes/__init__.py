"""The endpoints, thin: check access, call one thing, answer."""

from fastapi import APIRouter

from api.routes import (
    audit,
    fhir,
    following,
    health,
    keys,
    login,
    oidc,
    people,
    reference,
    reviews,
    sessions,
    uploads,
)

ROUTERS: tuple[APIRouter, ...] = (
    health.router,
    uploads.router,
    sessions.router,
    reviews.router,
    following.router,
    fhir.router,
    reference.router,
    people.router,
    keys.router,
    audit.router,
    login.router,
    oidc.router,
)
