"""The serving process: what is printed at the start, the web server, the sample sessions."""

from __future__ import annotations

import asyncio
import socket
import sys
from pathlib import Path

import typer
import uvicorn
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from api import logs, operations
from api.app import create_app
from api.problems import ConfigurationError
from api.settings import ServiceSettings

_MAX_HEAD_BYTES = 64 * 1024
_SAMPLES = Path(__file__).parent.parent / "sample_data"


class BoundedHttp(HttpToolsProtocol):
    """uvicorn's protocol with an end to headers: by itself it waits for them, and collects them, for ever."""

    head_deadline_s = 15.0
    _n_head_bytes = 0
    _deadline: asyncio.TimerHandle | None = None  # while the head of a request is awaited

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn has it
        super().connection_made(transport)
        self._await_head()

    def connection_lost(self, exc: Exception | None) -> None:
        self._has_head()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self._deadline is not None:
            self._n_head_bytes += len(data)
            if self._n_head_bytes > _MAX_HEAD_BYTES:
                self.send_400_response("The headers are too long.")

    def on_message_begin(self) -> None:
        super().on_message_begin()
        self._await_head()

    def on_headers_complete(self) -> None:
        self._has_head()
        super().on_headers_complete()

    def _await_head(self) -> None:
        self._has_head()
        self._n_head_bytes = 0
        self._deadline = self.loop.call_later(self.head_deadline_s, self.transport.close)

    def _has_head(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None


def run(settings: ServiceSettings, *, with_samples: bool = False) -> None:
    """Serve until told to stop."""
    logs.configure(settings.log_level)
    with operations.serving_alone(settings.data_dir), _listening(settings) as listener:
        with operations.opened(settings) as service:
            password = operations.first_password(service)
            if with_samples:
                operations.add_samples(service, _SAMPLES)
        host, port = listener.getsockname()[:2]
        address = settings.public_url or f"http://{f'[{host}]' if ':' in host else host}:{port}"
        _greet(address, settings, password)
        config = uvicorn.Config(
            create_app(settings),
            log_config=None,
            access_log=False,
            proxy_headers=True,
            forwarded_allow_ips=settings.forwarded_allow_ips,
            server_header=False,
            timeout_keep_alive=30,
            timeout_graceful_shutdown=10,
            http=BoundedHttp,
        )
        uvicorn.Server(config).run(sockets=[listener])


def _listening(settings: ServiceSettings) -> socket.socket:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((settings.host, settings.port))
    except OSError as error:
        listener.close()
        raise ConfigurationError(f"cannot listen at {settings.host}:{settings.port}: {error.strerror}") from error
    return listener


def _greet(address: str, settings: ServiceSettings, password: str | None) -> None:
    typer.echo(f"inhalemon serves {address}/ (programs: {address}/docs), data in {settings.data_dir}")
    if password is not None:
        typer.echo(f"Log in as {operations.FIRST_USER} with the one-time password: {password}")
    sys.stdout.flush()
