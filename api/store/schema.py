"""Brings a database to the present schema, and says which schema it has."""

from __future__ import annotations

from pathlib import Path

from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory

from api.store.engine import Store
from api.store.tables import metadata

_SCRIPTS = Path(__file__).parent.parent / "migrations"


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", str(_SCRIPTS).replace("%", "%%"))
    return config


def newest() -> str:
    """The revision that this program needs."""
    return ScriptDirectory.from_config(_config()).get_current_head() or ""


def present(store: Store) -> str | None:
    """The revision that the database has; `None` when it is empty."""
    with store.read() as connection:
        return MigrationContext.configure(connection).get_current_revision()


def migrate(store: Store) -> str:
    """Run the migrations that are missing, all in one transaction, and return the revision reached."""
    head = newest()
    if present(store) == head:
        return head
    config = _config()
    with store.write() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "head")
    return head


def differences(store: Store) -> list[str]:
    """What a migrated database lacks or has beyond `tables.py`; empty when they are equal."""
    with store.read() as connection:
        context = MigrationContext.configure(connection)
        return [repr(each) for each in compare_metadata(context, metadata)]
