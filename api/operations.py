"""What an operator does by hand: clinics, people and keys."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from api import auth
from api.intake import metadata_of, store
from api.principal import Role, Scope
from api.problems import ConfigurationError, InvalidError
from api.service import Service
from api.settings import ServiceSettings
from api.store import people, schema
from api.uploads import SUFFIXES, Received, Upload

ACTOR = "operator"
FIRST_CLINIC = "home"
FIRST_USER = "admin"


@contextlib.contextmanager
def opened(settings: ServiceSettings) -> Iterator[Service]:
    """The service's parts for one command, beside a server that may be running."""
    service = Service(settings, owns_checkpoints=False)
    try:
        schema.migrate(service.store)
        yield service
    finally:
        service.close()


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
