"""What the service does by itself: webhooks, retention."""

from __future__ import annotations

import hashlib
import hmac
import json
import re
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from running import serving, settings_for

from api import background
from api.moments import DAY_US, now_us, to_iso


class Receiver:
    """Takes deliveries; answers with the statuses it is given, then 200."""

    def __init__(self, *statuses):
        self.taken = []
        left = list(statuses)
        taken = self.taken

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                body = self.rfile.read(int(self.headers["content-length"]))
                taken.append((dict(self.headers), body))
                self.send_response(left.pop(0) if left else 200)
                self.send_header("content-length", "0")
                self.end_headers()

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/hook"
        self.thread = threading.Thread(target=self.server.serve_forever)
        self.thread.start()

    def close(self):
        self.server.shutdown()
        self.server.server_close()
        self.thread.join()

    def wait_for(self, n, seconds=30):
        deadline_s = time.monotonic() + seconds
        while len(self.taken) < n:
            assert time.monotonic() < deadline_s, f"{len(self.taken)} of {n} came"
            time.sleep(0.05)


@pytest.fixture(scope="module")
def told_server(tmp_path_factory, database):
    settings = settings_for(tmp_path_factory.mktemp("data"), database(), workers=1, webhook_hosts="127.0.0.1")
    with serving(settings) as server:
        yield server


@pytest.fixture
def told_clinic(told_server):
    clinic = told_server.clinic()
    yield clinic
    clinic.close()


@pytest.mark.slow
def test_a_webhook_is_told_signed_and_again_until_it_listens(told_clinic, upload):
    receiver = Receiver(500)
    try:
        boss = told_clinic.client("administrator")
        made = boss.post("/v1/webhooks", json={"url": receiver.url, "events": ["session.scored"]})
        assert made.status_code == 201, made.text
        secret = made.json()["secret"]
        assert secret not in boss.get("/v1/webhooks").text, "shown once"
        session = upload(told_clinic, seed=140, patient_ref="P-404")
        receiver.wait_for(2)  # refused once, sent again some seconds later
        (first, body), (again, same) = receiver.taken
        assert body == same
        assert first["inhalemon-delivery"] == again["inhalemon-delivery"]
        told = json.loads(body)
        assert (told["event"], told["session"], told["grade"]) == ("session.scored", session["id"], session["grade"])
        assert b"P-404" not in body
        at_s, mark = re.fullmatch(r"t=(\d+),v1=([0-9a-f]{64})", again["inhalemon-signature"]).groups()
        wanted = hmac.new(secret.encode(), f"{at_s}.".encode() + body, hashlib.sha256).hexdigest()
        assert hmac.compare_digest(mark, wanted)
        assert abs(time.time() - int(at_s)) < 60
    finally:
        receiver.close()


@pytest.mark.parametrize(
    "url",
    [
        "http://169.254.169.254/latest",
        "https://elsewhere.example/hook",
        "file:///etc/passwd",
        "http://127.0.0.1@elsewhere.example/",
        "https://user:secret@127.0.0.1/",
        "not a url",
    ],
)
def test_a_webhook_to_a_host_that_nobody_allowed_is_refused(told_clinic, url):
    made = told_clinic.client("administrator").post("/v1/webhooks", json={"url": url, "events": ["session.scored"]})
    assert made.status_code == 422


def test_what_is_older_than_the_retention_goes(tmp_path, database, upload):
    with serving(settings_for(tmp_path / "data", database(), workers=1, retention_days=30)) as server:
        clinic = server.clinic()
        try:
            old = upload(clinic, seed=141, recorded_at=to_iso(now_us() - 31 * DAY_US))
            young = upload(clinic, seed=142, recorded_at=to_iso(now_us() - 29 * DAY_US))
            background.tidy(server.service)
            listed = [each["id"] for each in clinic.client("clinician").get("/v1/sessions").json()["items"]]
            assert listed == [young["id"]]
            assert not list((server.settings.data_dir / "raw").rglob(f"{old['sha256']}.zst"))
            audit = clinic.client("administrator").get("/v1/audit").json()["items"]
            entry = next(each for each in audit if each["action"] == "session.erased")
            assert (entry["subject"], entry["detail"]["reason"]) == (old["id"], "retention")
        finally:
            clinic.close()
