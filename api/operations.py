"""What an operator does by hand: clinics, people and keys."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from api import auth, pairing
from api.intake import metadata_of, store
from api.principal import Role, Scope
from api.problems import ConfigurationError, InvalidError
from api.service import Service
from api.settings import ServiceSettings
from api.store import Connection, people
from api.uploads import SUFFIXES, Received, Upload

ACTOR = "operator"
FIRST_CLINIC = "home"
FIRST_USER = "admin"


@contextlib.contextmanager
def opened(settings: ServiceSettings) -> Iterator[Service]:
    """The service's parts for a command beside a server that may be running; what is missing is made."""
    service = Service(settings, owns_checkpoints=False)
    with contextlib.closing(service):
        pairing.make_ready(service)
        yield service


@contextlib.contextmanager
def existing(settings: ServiceSettings, *, at_any_schema: bool = False) -> Iterator[Service]:
    """The same for a command that makes nothing. Raises `ConfigurationError` when the data are not there."""
    pairing.require_there(settings)
    service = Service(settings, owns_checkpoints=False)
    with contextlib.closing(service):
        pairing.require_database(service, at_any_schema=at_any_schema)
        yield service


@contextlib.contextmanager
def serving_alone(data_dir: Path) -> Iterator[None]:
    """Hold the data folder for one serving process. Raises `ConfigurationError` when another one has it."""
    data_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
    handle = os.open(data_dir / "serving.lock", os.O_RDWR | os.O_CREAT, 0o600)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise ConfigurationError(
                f"{data_dir} is in use by another server; stop it, or set another folder"
            ) from error
        yield
    finally:
        os.close(handle)


def add_clinic(service: Service, slug: str) -> bool:
    """Whether the clinic is new."""
    with service.store.write() as connection:
        clinic_id, is_new = people.ensure_clinic(connection, slug)
        if is_new:
            service.audit.record(connection, clinic_id, ACTOR, "clinic.added")
    return is_new


def add_user(
    service: Service, name: str, role: Role, clinics: Sequence[str], password: str | None = None
) -> str | None:
    """A one-time password, unless one was given. Clinics are made when they are new. Raises `ConflictError`."""
    clinics = list(dict.fromkeys(clinics))
    if role != Role.PHARMACIST and len(clinics) != 1:
        raise InvalidError("Only a pharmacist can have several clinics.")
    one_time = auth.one_time_password() if password is None else None
    password_hash = auth.hash_password(one_time or password or "")
    for slug in clinics:
        add_clinic(service, slug)
    with service.store.write() as connection:
        ids = [people.ensure_clinic(connection, slug)[0] for slug in clinics]
        people.add_user(
            connection, name, role, ids, password_hash=password_hash, must_change_password=one_time is not None
        )
        for clinic_id in ids:
            service.audit.record(connection, clinic_id, ACTOR, "user.added", f"user:{name.lower()}", role=role)
    return one_time


def every_user(service: Service) -> list[people.User]:
    """Everybody, by name."""
    with service.store.read() as connection:
        return people.users_of(connection, list(people.clinic_slugs(connection).values()))


def set_active(service: Service, name: str, *, is_active: bool) -> None:
    """Lock somebody out of everything, or let them in again. Raises `NotFoundError`."""
    with service.store.write() as connection:
        user = people.require_user(connection, name)
        people.set_active(connection, user.id, is_active=is_active)
        _note_change(service, connection, user, is_active=is_active)


def reset_password(service: Service, name: str) -> str:
    """A new one-time password of somebody, whose logins end. Raises `NotFoundError`."""
    one_time = auth.one_time_password()
    password_hash = auth.hash_password(one_time)
    with service.store.write() as connection:
        user = people.require_user(connection, name)
        people.set_password(connection, user.id, password_hash, must_change=True)
        _note_change(service, connection, user, password_reset=True)
    return one_time


def assign_clinic(service: Service, name: str, slug: str) -> None:
    """Give a pharmacist one more clinic. Raises `NotFoundError`, and `InvalidError` for any other role."""
    with service.store.write() as connection:
        user, clinic_id = people.require_user(connection, name), people.require_clinic(connection, slug)
        if user.role != Role.PHARMACIST:
            raise InvalidError("Only a pharmacist can have several clinics.")
        people.add_to_clinic(connection, user.id, clinic_id)
        service.audit.record(connection, clinic_id, ACTOR, "user.assigned", f"user:{user.name}")


def withdraw_clinic(service: Service, name: str, slug: str) -> None:
    """Take one of several clinics from a pharmacist. Raises `NotFoundError`, `InvalidError`."""
    with service.store.write() as connection:
        user, clinic_id = people.require_user(connection, name), people.require_clinic(connection, slug)
        if set(user.clinics) <= {slug}:
            raise InvalidError(f"{slug} is the only clinic of {user.name}; lock the person out instead.")
        people.drop_from_clinic(connection, user.id, clinic_id)
        service.audit.record(connection, clinic_id, ACTOR, "user.withdrawn", f"user:{user.name}")


def _note_change(service: Service, connection: Connection, user: people.User, **detail: object) -> None:
    for clinic_id in user.clinics.values():
        service.audit.record(connection, clinic_id, ACTOR, "user.changed", f"user:{user.name}", **detail)


def add_key(
    service: Service,
    clinic: str,
    role: Role,
    *,
    scopes: frozenset[Scope] | None = None,
    label: str = "",
    days: float | None = None,
) -> auth.NewKey:
    """A key of a clinic, which is made when it is new."""
    add_clinic(service, clinic)
    with service.store.write() as connection:
        clinic_id, _ = people.ensure_clinic(connection, clinic)
        made = auth.make_key(
            connection, service.secret, clinic_id, role, scopes=scopes, label=label, created_by=ACTOR, days=days
        )
        service.audit.record(connection, clinic_id, ACTOR, "key.made", f"key:{made.prefix}", role=role)
    return made


def first_password(service: Service) -> str | None:
    """The one-time password of the first administrator, when there is nobody yet."""
    with service.store.read() as connection:
        if people.count_users(connection):
            return None
    return add_user(service, FIRST_USER, Role.ADMINISTRATOR, [FIRST_CLINIC])


def add_samples(service: Service, folder: Path) -> int:
    """Store the sample recordings in the first clinic, to be scored as soon as the service runs; how many are new."""
    add_clinic(service, FIRST_CLINIC)
    with service.store.read() as connection:
        clinic_id = people.clinic_slugs(connection)[FIRST_CLINIC]
    n_new = 0
    for path in sorted(each for each in folder.rglob("*") if each.name.endswith(SUFFIXES)):
        stem = path.name.split(".", 1)[0]
        sidecar = path.with_name(f"{stem}.json")
        with service.files.receive() as incoming:
            incoming.write(path.read_bytes())
            suffix = next(each for each in SUFFIXES if path.name.endswith(each))
            one = Received(incoming, path.name, "", None, suffix)
            upload = Upload([one], {"metadata": [sidecar.read_bytes()]} if sidecar.is_file() else {})
            (metadata,) = metadata_of(upload, {}, service.settings)
            n_new += store(service, ACTOR, clinic_id, one, metadata, first_try_s=0.0)[1]
    return n_new
