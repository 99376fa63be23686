"""The real application behind a real web server, on a free port of this machine."""

from __future__ import annotations

import contextlib
import itertools
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import uvicorn

from api import operations
from api.app import create_app
from api.principal import Role, Scope
from api.service import Service
from api.serving import BoundedHttp
from api.settings import ServiceSettings, load
from api.store import people

_NAMES = itertools.count(1)


def next_name() -> int:
    """A number that nobody else in this run has."""
    return next(_NAMES)


@dataclass
class Server:
    """A running server and what a test needs to reach into it."""

    url: str
    service: Service
    settings: ServiceSettings

    def client(
        self,
        key: str | None = None,
        *,
        headers: dict[str, str] | None = None,
        cookies: dict[str, str] | None = None,
    ) -> httpx.Client:
        own = {} if key is None else {"Authorization": f"Bearer {key}"}
        headers = own | (headers or {})
        return httpx.Client(base_url=self.url, headers=headers, cookies=cookies, timeout=30.0, trust_env=False)

    def clinic(self) -> Clinic:
        return Clinic(self, f"clinic-{next_name()}")


@dataclass
class Clinic:
    """A clinic of one test."""

    server: Server
    slug: str
    _clients: dict[str, httpx.Client] = field(default_factory=dict)

    def __post_init__(self) -> None:
        operations.add_clinic(self.server.service, self.slug)

    def key(self, role: str, *, scopes: Sequence[Scope] | None = None, days: float | None = None) -> str:
        wanted = None if scopes is None else frozenset(scopes)
        return operations.add_key(self.server.service, self.slug, Role(role), scopes=wanted, days=days).key

    def client(self, role: str) -> httpx.Client:
        """A program of this role."""
        if role not in self._clients:
            self._clients[role] = self.server.client(self.key(role))
        return self._clients[role]

    @property
    def id(self) -> str:
        with self.server.service.store.read() as connection:
            return people.clinic_slugs(connection)[self.slug]

    def close(self) -> None:
        for client in self._clients.values():
            client.close()


@contextlib.contextmanager
def serving(settings: ServiceSettings) -> Iterator[Server]:
    """The real application behind a real web server, on a free port of this machine."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        app = create_app(settings)
        config = uvicorn.Config(
            app, log_config=None, access_log=False, http=BoundedHttp, lifespan="on", timeout_graceful_shutdown=5
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            deadline_s = time.monotonic() + 20
            while not server.started:
                assert thread.is_alive(), "the server did not start"
                assert time.monotonic() < deadline_s, "the server takes too long to start"
                time.sleep(0.01)
            yield Server(f"http://127.0.0.1:{listener.getsockname()[1]}", app.state.service, settings)
        finally:
            server.should_exit = True
            thread.join(20)
            assert not thread.is_alive(), "the server did not stop"


def settings_for(data_dir: Path, database_url: str | None, **more: object) -> ServiceSettings:
    return load(data_dir=data_dir, database_url=database_url, min_free_bytes=0, **more)
