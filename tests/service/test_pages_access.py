"""Pages keep to the same access as the routes for programs: roles, clinics, the token of a form."""

from __future__ import annotations

import re
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest

from api import operations
from api.principal import SCOPES, Role, Scope

PASSWORD = "correct-horse-7"
HTML = {"accept": "text/html"}
NEEDS = {
    "/queue": Scope.REVIEW,
    "/sessions": Scope.READ,
    "/agreement": Scope.READ,
    "/upload": Scope.UPLOAD,
    "/settings": Scope.ADMIN,
    "/audit": Scope.ADMIN,
}


@pytest.fixture
def log_in(server):
    """Gives somebody's client, after the form was filled in as a browser does."""
    opened = []

    def enter(clinic, role: Role, *others) -> httpx.Client:
        name = f"{role}-{clinic.slug}"
        operations.add_user(server.service, name, role, [clinic.slug, *(each.slug for each in others)], PASSWORD)
        client = server.client(headers=HTML)
        opened.append(client)
        form = {"name": name, "password": PASSWORD, "csrf_token": _token(client.get("/login").text), "next": "/"}
        assert client.post("/login", data=form).status_code == 303
        return client

    yield enter
    for client in opened:
        client.close()


def _token(page: str) -> str:
    found = re.search(r'name="csrf_token" value="(\w+)"', page)
    assert found is not None
    return found[1]


@pytest.mark.parametrize("role", list(Role))
def test_each_role_reaches_its_own_pages_and_no_others(clinic, log_in, role):
    client = log_in(clinic, role)
    for path, scope in NEEDS.items():
        status = client.get(path).status_code
        assert status == (200 if scope in SCOPES[role] else 403), (role, path)
    shown = client.get("/upload" if Scope.UPLOAD in SCOPES[role] else "/queue").text
    linked = {path for path in NEEDS if f'<a href="{path}"' in shown}
    assert linked == {path for path, scope in NEEDS.items() if scope in SCOPES[role]}


def test_visitor_is_led_to_the_login_and_back(server):
    with server.client(headers=HTML) as visitor:
        answer = visitor.get("/sessions")
    assert (answer.status_code, answer.headers["location"]) == (303, "/login?next=/sessions")
    with server.client(headers=HTML) as visitor:
        target = visitor.get("/sessions?grade=correct&rule=no_press").headers["location"]
    assert parse_qs(urlsplit(target).query)["next"] == ["/sessions?grade=correct&rule=no_press"]


def test_page_of_another_clinics_session_is_not_found(clinic, other_clinic, upload, log_in):
    session = upload(clinic)["id"]
    client = log_in(other_clinic, Role.ADMINISTRATOR)
    for path in (f"/sessions/{session}", f"/sessions/{session}/review", f"/sessions/{session}/state"):
        answer = client.get(path)
        assert answer.status_code == 404
        assert "<html" in answer.text, "told as a page"
    assert session not in client.get("/sessions").text


def test_entry_without_the_token_of_the_login_is_refused(clinic, upload, log_in):
    session = upload(clinic)["id"]
    client = log_in(clinic, Role.CLINICIAN)
    entry = {"kind": "sign_off"}
    assert client.post(f"/sessions/{session}/review", data=entry).status_code == 403
    token = client.get("/v1/me").json()["csrf_token"]
    answer = client.post(f"/sessions/{session}/review", data=entry, headers={"x-csrf-token": token, "if-match": '"0"'})
    assert answer.status_code == 200
    assert "Signed off by" in answer.text
    late = client.post(f"/sessions/{session}/review", data=entry, headers={"x-csrf-token": token, "if-match": '"0"'})
    assert late.status_code == 412
    assert late.headers["hx-retarget"] == "#conflict"


def test_pages_escape_what_people_wrote(clinic, upload, log_in):
    session = upload(clinic)["id"]
    client = log_in(clinic, Role.CLINICIAN)
    token = client.get("/v1/me").json()["csrf_token"]
    entry = {"kind": "comment", "reason": "<script>alert(1)</script>"}
    client.post(f"/sessions/{session}/review", data=entry, headers={"x-csrf-token": token})
    shown = client.get(f"/sessions/{session}").text
    assert "<script>alert" not in shown
    assert "&lt;script&gt;alert(1)" in shown


def test_language_is_kept_and_leads_nowhere_else(server):
    with server.client(headers=HTML) as visitor:
        answer = visitor.get("/language/ja", params={"next": "//elsewhere.example"})
        assert answer.headers["location"] == "/"
        assert 'lang="ja"' in visitor.get("/login").text
        assert visitor.get("/language/tlh").status_code == 404


def test_every_page_carries_the_strict_policy(server):
    with server.client(headers=HTML) as visitor:
        for path in ("/login", "/docs", "/nowhere", "/static/js/app.js", "/palette.css"):
            policy = visitor.get(path).headers["content-security-policy"]
            assert "script-src 'self';" in policy
            assert "unsafe" not in policy


def test_reference_names_every_route(server):
    with server.client(headers=HTML) as visitor:
        page = visitor.get("/docs").text
        for path in visitor.get("/openapi.json").json()["paths"]:
            assert f"</b> {path}</code>" in page


def test_pharmacist_of_two_clinics_reviews_them_together_or_apart(clinic, other_clinic, upload, log_in):
    one, other = upload(clinic, seed=1)["id"], upload(other_clinic, seed=2)["id"]
    client = log_in(clinic, Role.PHARMACIST, other_clinic)
    both = client.get("/queue").text
    assert f"/sessions/{one}" in both
    assert f"/sessions/{other}" in both
    apart = client.get("/queue", params={"clinic": other_clinic.slug}).text
    assert f"/sessions/{one}" not in apart
    token = client.get("/v1/me").json()["csrf_token"]
    taken = client.post("/queue/next", params={"clinic": other_clinic.slug}, headers={"x-csrf-token": token})
    assert taken.headers["hx-redirect"] == f"/sessions/{other}"


def test_patients_of_two_clinics_are_never_taken_for_one(clinic, other_clinic, upload, log_in):
    """A pseudonym belongs to its clinic: P-1 of the one and P-1 of the other are different people."""
    one, other = upload(clinic, seed=1, patient_ref="P-1")["id"], upload(other_clinic, seed=2, patient_ref="P-1")["id"]
    client = log_in(clinic, Role.PHARMACIST, other_clinic)
    told = client.get("/v1/patients/P-1/progress")
    assert told.status_code == 409
    assert sorted(told.json()["clinics"]) == sorted([clinic.slug, other_clinic.slug])
    page = client.get("/patients/P-1")
    assert page.status_code == 409
    for each, session in ((clinic, one), (other_clinic, other)):
        assert f'"/patients/P-1?clinic={each.slug}"' in page.text
        told = client.get("/v1/patients/P-1/progress", params={"clinic": each.slug}).json()
        assert [point["session"] for point in told["sessions"]] == [session]
        assert told["clinic"] == each.slug
        shown = client.get("/patients/P-1", params={"clinic": each.slug}).text
        assert session in shown
        assert ({one, other} - {session}).pop() not in shown
        listed = client.get("/sessions", params={"clinic": each.slug}).text
        assert f'href="/patients/P-1?clinic={each.slug}"' in listed
        assert ({one, other} - {session}).pop() not in listed
    own = clinic.client("clinician").get("/v1/patients/P-1/progress").json()
    assert [point["session"] for point in own["sessions"]] == [one], "who has one clinic need not name it"


def test_who_has_several_clinics_sees_which_one_a_session_is_of(clinic, other_clinic, upload, log_in):
    upload(clinic, seed=1)
    one, two = log_in(clinic, Role.CLINICIAN), log_in(clinic, Role.PHARMACIST, other_clinic)
    for path in ("/queue", "/sessions"):
        assert f">{clinic.slug}</td>" in two.get(path).text
        assert f">{clinic.slug}</td>" not in one.get(path).text


def test_pages_that_say_no_keep_the_way_to_all_others(clinic, log_in):
    client = log_in(clinic, Role.CLINICIAN)
    for path, status in (("/nowhere", 404), ("/settings", 403), ("/sessions?grade=splendid", 422)):
        answer = client.get(path)
        assert answer.status_code == status
        assert '<a href="/queue"' in answer.text


def test_each_look_and_each_deed_is_one_entry_of_the_audit(clinic, upload, log_in):
    """A page reads what it shows once: two entries would tell of two looks."""
    session = upload(clinic, patient_ref="P-3")["id"]
    client = log_in(clinic, Role.CLINICIAN)
    token = client.get("/v1/me").json()["csrf_token"]

    def entries():
        found = clinic.client("administrator").get("/v1/audit", params={"limit": 200}).json()["items"]
        return [each["action"] for each in reversed(found) if each["actor"] == f"user:clinician-{clinic.slug}"]

    def added(deed):
        before = entries()
        deed()
        return entries()[len(before) :]

    headers = {"x-csrf-token": token}
    comment = {"kind": "comment", "reason": "seen"}
    assert added(lambda: client.get(f"/sessions/{session}")) == ["session.read"]
    assert added(lambda: client.get("/sessions")) == ["sessions.listed"]
    assert added(lambda: client.get("/queue")) == ["queue.read"]
    assert added(lambda: client.get("/patients/P-3")) == ["patient.read"]
    assert added(lambda: client.post(f"/sessions/{session}/review", data=comment, headers=headers)) == [
        "session.reviewed"
    ]
    assert added(lambda: client.get(f"/v1/sessions/{session}/report.html")) == ["report.read"]
