"""Backup, restore, verify, doctor: what keeps a clinic's recordings safe over the years."""

from __future__ import annotations

import contextlib
import io
import shutil
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import orjson

import inhalemon
from api import pairing
from api.moments import now_us, to_iso
from api.problems import ConfigurationError
from api.service import Service
from api.settings import ServiceSettings
from api.store import audit, copying, people, schema, sessions

FORMAT = "inhalemon-backup/1"
_MANIFEST = "manifest.json"
_DATABASE = "database"
_SECRET = "secret.key"
_BESIDE = (_SECRET, pairing.NAME)


# ------------------------------------------------------------------------------------------ backup and restore


def back_up(service: Service, target: Path) -> int:
    """Write one archive with database, recordings and secret, while the service may run; how many recordings it holds.

    The database is copied first, at one moment: every recording that the copy mentions is on the disk by then, and no
    other belongs into the archive, which is as confidential as the service itself.
    """
    if target.exists():
        raise ConfigurationError(f"{target} is there already; choose another name")
    fresh = target.with_name(f"{target.name}.part")
    n_recordings = 0
    with tempfile.TemporaryDirectory(dir=target.parent) as folder, contextlib.ExitStack() as stack:
        stack.callback(fresh.unlink, missing_ok=True)
        database = Path(folder) / _DATABASE
        mentioned = copying.dump(service.store, database)
        fresh.touch(mode=0o600)
        with tarfile.open(fresh, "w") as archive:
            manifest = {
                "format": FORMAT,
                "version": inhalemon.__version__,
                "schema": schema.present(service.store),
                "database": service.store.url.get_backend_name(),
                "at": to_iso(now_us()),
            }
            _add_bytes(archive, _MANIFEST, orjson.dumps(manifest))
            archive.add(database, _DATABASE)
            for name in _BESIDE:
                with contextlib.suppress(FileNotFoundError):  # the secret may be in the settings
                    archive.add(service.settings.data_dir / name, name)
            for clinic_id, sha256 in mentioned:
                path = service.files.path(clinic_id, sha256)
                with contextlib.suppress(FileNotFoundError):  # erased since the copy
                    archive.add(path, f"raw/{clinic_id}/{sha256[:2]}/{path.name}")
                    n_recordings += 1
        fresh.replace(target)
    return n_recordings


def _add_bytes(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    info = tarfile.TarInfo(name)
    info.size = len(content)
    archive.addfile(info, io.BytesIO(content))


def restore(settings: ServiceSettings, source: Path) -> None:
    """Bring an archive back into an empty data folder and an empty database. Raises `ConfigurationError`."""
    data_dir = settings.data_dir
    if data_dir.exists() and any(data_dir.iterdir()):
        raise ConfigurationError(f"{data_dir} is not empty; restore into a new folder, then look before you replace")
    with tarfile.open(source) as archive:
        manifest = orjson.loads(_member(archive, _MANIFEST).read())
        if manifest.get("format") != FORMAT:
            raise ConfigurationError(f"{source} is not a backup of this service")
        data_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
        members = [each for each in archive.getmembers() if each.name in _BESIDE or each.name.startswith("raw/")]
        archive.extractall(data_dir, members=members, filter="data")
        (data_dir / "raw").mkdir(exist_ok=True)
        if (data_dir / _SECRET).is_file():
            (data_dir / _SECRET).chmod(0o600)
        with tempfile.TemporaryDirectory(dir=data_dir) as folder:
            copy = Path(folder) / _DATABASE
            with copy.open("wb") as file:
                shutil.copyfileobj(_member(archive, _DATABASE), file)
            copying.load(settings.database, copy, backend=manifest["database"])


def _member(archive: tarfile.TarFile, name: str) -> IO[bytes]:
    try:
        file = archive.extractfile(name)
    except KeyError as error:
        raise ConfigurationError(f"the archive has no {name}: it is no backup, or not whole") from error
    if file is None:
        raise ConfigurationError(f"the archive's {name} is no file")
    return file


# ------------------------------------------------------------------------------------------ verify and doctor


def faults(service: Service) -> Iterator[str]:
    """What is wrong: recordings that are missing or changed, audit chains that are broken, files of nobody."""
    with service.store.read() as connection:
        slugs = {clinic_id: slug for slug, clinic_id in people.clinic_slugs(connection).items()}
        kept = set(sessions.contents(connection))
        for clinic_id in audit.chains(connection):
            for fault in service.audit.faults(connection, clinic_id):
                yield f"audit of {slugs.get(clinic_id, clinic_id)}: {fault}"
    for clinic_id, sha256 in sorted(kept):
        if not service.files.is_whole(clinic_id, sha256):
            yield f"recording {sha256} of {slugs[clinic_id]} is missing or changed"
    for clinic_id, sha256, _ in service.files.kept():
        if (clinic_id, sha256) not in kept:
            yield f"file {sha256} of {slugs.get(clinic_id, clinic_id)} belongs to no session"


def advice(service: Service) -> Iterator[tuple[bool, str]]:
    """Whether each thing that a running service needs is well, in words."""
    settings = service.settings
    present, newest = schema.present(service.store), schema.newest()
    yield present == newest, f"database {service.store.url.get_backend_name()}, schema {present} (newest {newest})"
    free = shutil.disk_usage(settings.data_dir).free
    reserve = settings.min_free_bytes
    yield free > 10 * reserve, f"{free // 2**20} MiB free on the disk; uploads stop below {reserve // 2**20} MiB"
    mode = settings.data_dir.stat().st_mode & 0o077
    yield mode == 0, f"{settings.data_dir} is {'readable by its owner only' if mode == 0 else 'readable by others'}"
    is_local = settings.host in {"127.0.0.1", "::1", "localhost"}
    yield (
        is_local or settings.is_secure,
        (f"listens at {settings.host}" + ("" if is_local or settings.is_secure else " without TLS: set public_url")),
    )
    with service.store.read() as connection:
        yield people.count_users(connection) > 0, f"{people.count_users(connection)} people can log in"
        states = sessions.count_by_state(connection)
    yield True, "sessions: " + (", ".join(f"{count} {state}" for state, count in sorted(states.items())) or "none yet")
