"""Who am I, and the people of a clinic."""

from __future__ import annotations

from fastapi import APIRouter

from api import auth, present
from api.access import Administrator, Anybody, ServiceDep
from api.models import Me, UserChange, UserIn, UserMade, UserOut
from api.principal import Role
from api.problems import InvalidError, NotFoundError
from api.routes.common import problems
from api.store import people

router = APIRouter(prefix="/v1", tags=["people"])


@router.get("/me", summary="Who the service takes you for", responses=dict(problems()))
def me(who: Anybody) -> Me:
    return Me(
        kind="user" if who.kind == "user" else "key",
        name=who.name,
        role=who.role,
        scopes=sorted(who.scopes),
        clinics=sorted(who.clinics),
        csrf_token=who.csrf_token,
    )


@router.get("/users", summary="The people of your clinic", responses=dict(problems()))
def list_users(service: ServiceDep, who: Administrator) -> list[UserOut]:
    with service.store.read() as connection:
        return [present.user(each, who.clinics) for each in people.users_of(connection, who.clinic_ids)]


@router.post("/users", status_code=201, summary="Add somebody", responses=dict(problems(404, 409)))
def add_user(service: ServiceDep, who: Administrator, given: UserIn) -> UserMade:
    named = dict.fromkeys(given.clinics or ())
    clinic_ids = [who.one_clinic(slug) for slug in named] or list(who.clinic_ids)
    if given.role != Role.PHARMACIST and len(clinic_ids) != 1:
        raise InvalidError("Only a pharmacist can have several clinics.")
    password = auth.one_time_password()
    password_hash = auth.hash_password(password)
    with service.store.write() as connection:
        people.add_user(
            connection, given.name, given.role, clinic_ids, password_hash=password_hash, must_change_password=True
        )
        for clinic_id in clinic_ids:
            service.audit.record(connection, clinic_id, who.actor, "user.added", f"user:{given.name}", role=given.role)
        made = _own(people.user_named(connection, given.name), who.clinic_ids)
    return UserMade(**present.user(made, who.clinics).model_dump(), one_time_password=password)


@router.patch("/users/{name}", summary="Lock somebody out or in, reset a password", responses=dict(problems(404)))
def change_user(service: ServiceDep, who: Administrator, name: str, given: UserChange) -> UserOut | UserMade:
    password = auth.one_time_password() if given.reset_password else None
    password_hash = None if password is None else auth.hash_password(password)
    with service.store.write() as connection:
        user = _own(people.user_named(connection, name), who.clinic_ids)
        if user.id == who.id:
            raise InvalidError("You cannot lock yourself out; ask another administrator, or the operator.")
        if given.is_active is not None:
            people.set_active(connection, user.id, is_active=given.is_active)
        if password_hash is not None:
            people.set_password(connection, user.id, password_hash, must_change=True)
        for clinic_id in user.clinics.values():
            service.audit.record(
                connection,
                clinic_id,
                who.actor,
                "user.changed",
                f"user:{user.name}",
                is_active=given.is_active,
                password_reset=given.reset_password,
            )
        changed = present.user(_own(people.user_named(connection, name), who.clinic_ids), who.clinics)
    return changed if password is None else UserMade(**changed.model_dump(), one_time_password=password)


def _own(user: people.User | None, clinic_ids: tuple[str, ...]) -> people.User:
    """Somebody who belongs to these clinics and to no other: an administrator rules over nobody else."""
    if user is None or not set(user.clinics.values()) <= set(clinic_ids):
        raise NotFoundError("There is nobody of that name here.")
    return user
