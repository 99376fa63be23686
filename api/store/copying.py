"""A whole database into a file and back, while others go on using it."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import subprocess
from pathlib import Path

from sqlalchemy import text
from sqlalchemy.engine import URL, make_url

from api.problems import ConfigurationError
from api.store import sessions
from api.store.engine import Store


def dump(store: Store, target: Path) -> list[tuple[str, str]]:
    """Copy the database at one moment: SQLite's own backup, or `pg_dump`. Raises `ConfigurationError`.

    Returns (clinic, SHA-256) of every session in the copy, which others may have left behind by now.
    """
    if store.is_sqlite:
        with (
            contextlib.closing(sqlite3.connect(str(store.url.database))) as source,
            contextlib.closing(sqlite3.connect(target)) as copy,
        ):
            source.backup(copy)
            return copy.execute("SELECT clinic_id, sha256 FROM sessions").fetchall()
    with store.engine.connect().execution_options(isolation_level="REPEATABLE READ") as connection:
        snapshot = connection.scalar(text("SELECT pg_export_snapshot()"))
        mentioned = list(sessions.contents(connection))
        options = ("--format=custom", "--no-owner", f"--snapshot={snapshot}", f"--file={target}")
        _run("pg_dump", store.url, *options)
    return mentioned


def load(url: str, source: Path, *, backend: str) -> None:
    """Bring a copy back into an empty database of the same kind. Raises `ConfigurationError`."""
    parsed = make_url(url)
    if parsed.get_backend_name() != backend:
        raise ConfigurationError(f"the backup is of {backend}, the settings name {parsed.get_backend_name()}")
    if backend == "sqlite":
        target = Path(str(parsed.database))
        if target.exists():
            raise ConfigurationError(f"{target} is there already; restore into a new folder")
        shutil.copyfile(source, target)
        target.chmod(0o600)
        return
    options = ("--no-owner", "--exit-on-error", "--single-transaction")
    _run("pg_restore", parsed, *options, f"--dbname={_dsn(parsed)}", str(source))


def _dsn(url: URL) -> str:
    return url.set(drivername="postgresql", password=None).render_as_string(hide_password=False)


def _run(program: str, url: URL, *arguments: str) -> None:
    found = shutil.which(program)
    if found is None:
        raise ConfigurationError(f"{program} is not installed: apt-get install postgresql-client")
    environment = os.environ | ({} if url.password is None else {"PGPASSWORD": str(url.password)})
    where = [] if program == "pg_restore" else [f"--dbname={_dsn(url)}"]
    done = subprocess.run([found, *where, *arguments], env=environment, check=False, capture_output=True, text=True)
    if done.returncode != 0:
        raise ConfigurationError(f"{program} failed: {done.stderr.strip()}")
