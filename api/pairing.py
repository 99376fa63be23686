"""A database and a data folder belong together: recordings lie in the one, what is known of them in the other.

Each folder has an identifier of its own, in `data.id`; its database holds the same. Two servers with one database and
two folders would each miss the other's recordings, so the second is refused.
"""

from __future__ import annotations

from api.files import write_once
from api.moments import new_id
from api.problems import ConfigurationError
from api.service import Service
from api.settings import ServiceSettings
from api.store import chores, schema

NAME = "data.id"


def make_ready(service: Service) -> None:
    """Bring the database up to date and bind it to the folder. Raises `ConfigurationError` when it is another's."""
    schema.migrate(service.store)
    path = service.settings.data_dir / NAME
    with service.store.read() as connection:
        is_bound = chores.bound_to(connection) is not None
    if not is_bound:
        write_once(path, new_id().encode())
        with service.store.write() as connection:
            chores.bind(connection, path.read_text())
    require_own(service)


def require_own(service: Service) -> None:
    """Raises `ConfigurationError` unless database and data folder belong together."""
    path = service.settings.data_dir / NAME
    with service.store.read() as connection:
        bound_to = chores.bound_to(connection)
    if bound_to != (path.read_text() if path.is_file() else None):
        raise ConfigurationError(
            f"the database belongs to another data folder than {service.settings.data_dir}; set INHALEMON_DATA_DIR and"
            " INHALEMON_DATABASE_URL to a pair that belongs together"
        )


def require_there(settings: ServiceSettings) -> None:
    """Raises `ConfigurationError` unless a data folder is there: a misspelt one must not be made, and found well."""
    if not (settings.data_dir / "raw").is_dir():
        raise ConfigurationError(
            f"{settings.data_dir} is no data folder of this service; set INHALEMON_DATA_DIR as the service has it"
        )


def require_database(service: Service, *, at_any_schema: bool) -> None:
    """Raises `ConfigurationError` unless the folder's database is there, and at the present schema if it has to be."""
    present = schema.present(service.store) if service.store.is_there() else None
    if present is None:
        raise ConfigurationError("the database holds nothing; set INHALEMON_DATABASE_URL as the service has it")
    if present == schema.newest():
        require_own(service)
    elif not at_any_schema:
        raise ConfigurationError(f"the database is at schema {present}; run `python -m api migrate` first")
