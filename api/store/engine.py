"""One database, SQLite or PostgreSQL: connections, transactions, and what differs between the two."""

from __future__ import annotations

import contextlib
import functools
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, Executable, RowMapping, Select, Table, create_engine, event
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import DataError, DBAPIError, OperationalError

from api.problems import DiskFullError, InvalidError, NotReadyError

_BLOCK = 500
_POOL = {"pool_size": 16, "max_overflow": 32, "pool_timeout": 10}


class Store:
    """The database. `read()` and `write()` give a connection inside one transaction.

    SQLite: write-ahead log, every commit on the disk before it returns, writers queued by a lock of this process and by
    BEGIN IMMEDIATE against others. Its checkpoint has a fault with several writing processes (3.7.0 to 3.51.2), so only
    the serving process checkpoints: the operator's commands open with `owns_checkpoints=False`.
    """

    def __init__(self, url: str, *, owns_checkpoints: bool = True) -> None:
        self.url: URL = make_url(url)
        self.is_sqlite = self.url.get_backend_name() == "sqlite"
        self._writing = threading.Lock() if self.is_sqlite else contextlib.nullcontext()
        self.engine = self._sqlite(owns_checkpoints) if self.is_sqlite else self._postgresql()

    def _sqlite(self, owns_checkpoints: bool) -> Engine:
        if self.url.database is None:
            raise NotReadyError("SQLite needs a file.")
        Path(self.url.database).parent.mkdir(parents=True, exist_ok=True)
        engine = create_engine(
            self.url,
            connect_args={"isolation_level": None, "check_same_thread": False, "timeout": 15},
            hide_parameters=True,  # an error's text may reach the log; what is known of a patient must not
            **_POOL,
        )

        @event.listens_for(engine, "connect")
        def prepare(connection: Any, _record: object) -> None:  # the driver's own object
            for pragma in (
                "journal_mode=WAL",
                "synchronous=FULL",
                "foreign_keys=ON",
                "secure_delete=ON",  # what is erased is overwritten, not only unlinked
                "cache_size=-16000",
                f"wal_autocheckpoint={1000 if owns_checkpoints else 0}",
            ):
                connection.execute(f"PRAGMA {pragma}").close()

        @event.listens_for(engine, "begin")
        def begin(connection: Connection) -> None:
            writes = connection.get_execution_options().get("writes", False)
            connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

        return engine

    def _postgresql(self) -> Engine:
        return create_engine(self.url, pool_pre_ping=True, hide_parameters=True, **_POOL)

    def is_there(self) -> bool:
        """Whether there is a database; connecting to a missing one of SQLite would make it."""
        return not self.is_sqlite or Path(str(self.url.database)).is_file()

    @contextlib.contextmanager
    def read(self) -> Iterator[Connection]:
        """A connection that sees one state and writes nothing."""
        with _told_as_problems(), self.engine.connect() as connection:
            yield connection

    @contextlib.contextmanager
    def write(self) -> Iterator[Connection]:
        """A connection whose work is committed at the end, or not at all when an error leaves the block."""
        with (
            _told_as_problems(),
            self._writing,
            self.engine.connect().execution_options(writes=True) as connection,
            connection.begin(),
        ):
            yield connection

    def close(self) -> None:
        """Close every connection; the serving process of a SQLite database first folds the log into the file."""
        self.engine.dispose()


@contextlib.contextmanager
def _told_as_problems() -> Iterator[None]:
    try:
        yield
    except DBAPIError as error:
        told = str(error.orig).lower()
        if "full" in told or "no space" in told:
            raise DiskFullError from error
        if isinstance(error, DataError):  # such as a NUL, which PostgreSQL cannot keep in a text
            raise InvalidError("A value holds characters that cannot be kept; send it without them.") from error
        if isinstance(error, OperationalError):
            raise NotReadyError("The database does not answer; try again in a moment.") from error
        raise


def insert_new(connection: Connection, table: Table, row: Mapping[str, object]) -> bool:
    """Insert `row` unless one with the same key is there. Returns whether it was inserted."""
    return connection.execute(_insert_new(connection.dialect.name, table), row).first() is not None


@functools.cache
def _insert_new(dialect: str, table: Table) -> Executable:
    insert = sqlite.insert if dialect == "sqlite" else postgresql.insert
    return insert(table).on_conflict_do_nothing().returning(*table.primary_key)


def insert_or_replace(connection: Connection, table: Table, row: Mapping[str, object], key: Sequence[str]) -> None:
    """Insert `row`, or set its other columns where one with the same key is there."""
    insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
    others = {name: value for name, value in row.items() if name not in key}
    statement = insert(table).values(**row).on_conflict_do_update(index_elements=list(key), set_=others)
    connection.execute(statement)


def streamed(connection: Connection, statement: Select[Any]) -> Iterator[RowMapping]:
    """The rows one by one, read in blocks; the cursor is closed with the iterator."""
    with connection.execute(statement.execution_options(yield_per=_BLOCK)) as result:
        yield from result.mappings()
