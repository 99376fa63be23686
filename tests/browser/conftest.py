"""The real service, started as an operator starts it, and Debian's Chromium to look at it with."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, Request

import inhalemon as im
from api import operations
from api.principal import Role
from api.settings import load
from inhalemon.recording import write_recording

ROOT = Path(__file__).parents[2]
PASSWORD = "correct-horse-7"
_START_S = 60.0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.browser)


@dataclass
class Site:
    """A running service of its own folder, with its people."""

    url: str
    data_dir: Path
    one_time_password: str

    def add_user(self, name: str, role: Role, clinic: str) -> None:
        with operations.opened(load(data_dir=self.data_dir)) as service:
            operations.add_user(service, name, role, [clinic], PASSWORD)

    def key(self, role: Role, clinic: str) -> str:
        with operations.opened(load(data_dir=self.data_dir)) as service:
            return operations.add_key(service, clinic, role).key

    def upload(self, clinic: str, path: Path, **metadata: str) -> str:
        """The session's id."""
        headers = {"authorization": f"Bearer {self.key(Role.CLINICIAN, clinic)}", "content-type": "text/csv"}
        answer = httpx.post(
            f"{self.url}/v1/sessions",
            content=path.read_bytes(),
            params={"device": "pmdi", "file_name": path.name, "session_id": path.stem, **metadata},
            headers=headers,
            timeout=60.0,
        )
        assert answer.status_code == 201, answer.text
        made: str = answer.json()["id"]
        return made


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    data_dir = tmp_path_factory.mktemp("site") / "data"
    log = data_dir.parent / "log"
    environment = os.environ | {"INHALEMON_DATA_DIR": str(data_dir), "PYTHONPATH": str(ROOT), "INHALEMON_WORKERS": "1"}
    with log.open("w") as written:
        command = [sys.executable, "-m", "api", "serve", "--port", "0"]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=written, text=True, env=environment, cwd=data_dir.parent
        )
        try:
            assert process.stdout is not None
            url = re.search(r"http://[\d.:]+", process.stdout.readline())
            password = re.search(r"password: (\S+)", process.stdout.readline())
            assert url is not None, log.read_text()
            assert password is not None, log.read_text()
            _wait_until_ready(url[0], process)
            yield Site(url[0], data_dir, password[1])
        finally:
            process.terminate()
            process.communicate(timeout=30)


def _wait_until_ready(url: str, process: subprocess.Popen[str]) -> None:
    deadline_s = time.monotonic() + _START_S
    while time.monotonic() < deadline_s and process.poll() is None:
        try:
            if httpx.get(f"{url}/readyz").status_code == 200:
                return
        except httpx.TransportError:
            time.sleep(0.05)
    pytest.fail("the service did not become ready")


@dataclass
class Visitor:
    """One person at a browser; everything that should not happen in it is kept."""

    page: Page
    context: BrowserContext
    site: Site
    wrong: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.page.on("pageerror", lambda error: self.wrong.append(f"script: {error}"))
        self.page.on("console", lambda message: self._note(message.type, message.text))
        self.page.on("request", self._check_request)

    def _note(self, kind: str, text: str) -> None:
        # A refused request is told here too; tests that provoke one look at the page.
        if kind in {"error", "warning"} and "Failed to load resource" not in text:
            self.wrong.append(f"{kind}: {text}")

    def _check_request(self, request: Request) -> None:
        if not request.url.startswith((self.site.url, "data:", "blob:")):
            self.wrong.append(f"left the machine: {request.url}")

    def log_in(self, name: str, password: str = PASSWORD) -> None:
        self.page.goto(f"{self.site.url}/login")
        self.page.fill("input[name=name]", name)
        self.page.fill("input[name=password]", password)
        self.page.click("form.fields button")
        self.page.wait_for_url(re.compile(r"^(?!.*/login)"))

    def go(self, path: str) -> None:
        self.page.goto(f"{self.site.url}{path}")

    def see_curves(self) -> None:
        self.page.wait_for_selector("#curves[data-drawn-ms]", state="attached")


@pytest.fixture
def visit(chromium: Browser, site: Site) -> Iterator[Callable[..., Visitor]]:
    """Opens a browser of its own: `visit(color_scheme="dark", viewport=..., locale="ja")`."""
    opened: list[Visitor] = []

    def open_one(**options: object) -> Visitor:
        context = chromium.new_context(**options)  # type: ignore[arg-type]  # the browser's own options
        context.set_default_timeout(20_000)
        opened.append(Visitor(context.new_page(), context, site))
        return opened[-1]

    yield open_one
    for each in opened:
        each.context.close()
    assert [wrong for each in opened for wrong in each.wrong] == []


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Simulated sessions as files; another seed gives other bytes."""
    folder = tmp_path_factory.mktemp("recordings")

    def make(name: str, mistakes: tuple[str, ...] = (), *, seed: int, rate_hz: float = 50.0, n_doses: int = 1) -> Path:
        recording, _ = im.simulate_session("pmdi", mistakes, seed=seed, rate_hz=rate_hz, n_doses=n_doses)
        path = folder / f"{name}.csv"
        write_recording(recording, path)
        path.with_suffix(".json").unlink(missing_ok=True)
        return path

    return make


@pytest.fixture
def broken(recordings: Callable[..., Path]) -> Path:
    """A recording whose line 100 has a text where a number belongs."""
    path = recordings("broken", seed=90)
    lines = path.read_text().splitlines()
    cells = lines[99].split(",")
    cells[5] = "oops"
    lines[99] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")
    return path
