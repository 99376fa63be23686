"""Who may do what: every role with every route, every clinic against every other."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from collections import Counter

import pytest
from running import serving, settings_for

from api import auth, operations
from api.principal import SCOPES, Role, Scope
from api.store import people

# What each route takes. A route that is not here fails the test below: access is decided, never forgotten.
NEEDS = {
    "POST /v1/sessions": Scope.UPLOAD,
    "GET /v1/sessions": Scope.READ,
    "GET /v1/sessions/{session_id}": Scope.READ,
    "PATCH /v1/sessions/{session_id}": Scope.CORRECT,
    "DELETE /v1/sessions/{session_id}": Scope.ADMIN,
    "GET /v1/sessions/{session_id}/report": Scope.READ,
    "GET /v1/sessions/{session_id}/reports": Scope.READ,
    "POST /v1/sessions/{session_id}/reports": Scope.CORRECT,
    "GET /v1/sessions/{session_id}/report.html": Scope.READ,
    "GET /v1/sessions/{session_id}/recording": Scope.READ,
    "GET /v1/sessions/{session_id}/series": Scope.READ,
    "GET /v1/sessions/{session_id}/reviews": Scope.READ,
    "POST /v1/sessions/{session_id}/reviews": Scope.REVIEW,
    "PUT /v1/sessions/{session_id}/lease": Scope.REVIEW,
    "DELETE /v1/sessions/{session_id}/lease": Scope.REVIEW,
    "GET /v1/review-queue": Scope.REVIEW,
    "POST /v1/review-queue/next": Scope.REVIEW,
    "GET /v1/patients/{ref}/progress": Scope.READ,
    "GET /v1/agreement": Scope.READ,
    "GET /v1/export": Scope.EXPORT,
    "GET /v1/sessions/{session_id}/fhir": Scope.READ,
    "GET /v1/fhir/code-systems": None,
    "GET /v1/rules": None,
    "GET /v1/devices": None,
    "GET /v1/me": None,
    "GET /v1/users": Scope.ADMIN,
    "POST /v1/users": Scope.ADMIN,
    "PATCH /v1/users/{name}": Scope.ADMIN,
    "GET /v1/keys": Scope.ADMIN,
    "POST /v1/keys": Scope.ADMIN,
    "DELETE /v1/keys/{key_id}": Scope.ADMIN,
    "GET /v1/webhooks": Scope.ADMIN,
    "POST /v1/webhooks": Scope.ADMIN,
    "DELETE /v1/webhooks/{webhook_id}": Scope.ADMIN,
    "GET /v1/audit": Scope.ADMIN,
    "GET /v1/audit/verify": Scope.ADMIN,
}
OPEN = {"GET /livez", "GET /readyz", "GET /metrics", "GET /version"}
NOTHING = "a" * 26


def _routes(server):
    with server.client() as client:
        paths = client.get("/openapi.json").json()["paths"]
    return {f"{method.upper()} {path}" for path, operations in paths.items() for method in operations}


def test_every_route_has_its_access_decided(server):
    assert _routes(server) == set(NEEDS) | OPEN


def _call(client, route):
    method, path = route.split()
    content = {} if method in {"GET", "DELETE", "PUT"} else {"content": b"{}"}
    path = re.sub(r"{\w+}", NOTHING, path)
    return client.request(method, path, headers={"content-type": "application/json"}, **content)


@pytest.mark.parametrize("role", list(Role))
def test_every_role_meets_every_route_as_the_table_says(clinic, role):
    for route, scope in NEEDS.items():
        status = _call(clinic.client(role), route).status_code
        may = scope is None or scope in SCOPES[role]
        assert (status != 403) == may, f"{role} got {status} from {route}"
        assert status != 401, route


def test_nobody_without_a_key_gets_in(server):
    with server.client() as client:
        for route in NEEDS:
            answer = _call(client, route)
            assert answer.status_code == 401, route
            assert answer.headers["content-type"] == "application/problem+json"
            assert "Bearer" in answer.headers["www-authenticate"]


def test_a_key_may_have_fewer_scopes_than_its_role(clinic):
    with clinic.server.client(clinic.key("clinician", scopes=[Scope.READ])) as client:
        assert client.get("/v1/sessions").status_code == 200
        assert client.get("/v1/review-queue").status_code == 403


@pytest.mark.parametrize("how", ["GET", "PATCH", "DELETE", "GET report", "GET recording", "GET series", "GET reviews"])
def test_another_clinics_session_is_not_found(clinic, other_clinic, upload, how):
    """Exactly as one that does not exist: nothing tells that it is there."""
    session = upload(clinic, seed=20)["id"]
    method, _, what = how.partition(" ")
    answers = [
        other_clinic.client("administrator").request(
            method,
            f"/v1/sessions/{each}{'/' if what else ''}{what}",
            json={"patient_ref": None} if method == "PATCH" else None,
        )
        for each in (session, NOTHING)
    ]
    assert [each.status_code for each in answers] == [404, 404]
    assert {**answers[0].json(), "instance": ""} == {**answers[1].json(), "instance": ""}


def test_a_pharmacist_sees_the_clinics_assigned_and_no_other(server, new_clinic, upload):
    ours, also_ours, theirs = (new_clinic() for _ in range(3))
    ids = [upload(each, seed=21)["id"] for each in (ours, also_ours, theirs)]
    name = f"pharmacist-{ours.slug}"
    operations.add_user(server.service, name, Role.PHARMACIST, [ours.slug, also_ours.slug], "correct horse battery")
    with logged_in(server, name, "correct horse battery") as client:
        listed = {each["id"] for each in client.get("/v1/sessions").json()["items"]}
        assert listed == set(ids[:2])
        assert client.get("/v1/sessions", params={"clinic": also_ours.slug}).json()["items"][0]["id"] == ids[1]
        assert client.get("/v1/sessions", params={"clinic": theirs.slug}).status_code == 404
        assert [client.get(f"/v1/sessions/{each}").status_code for each in ids] == [200, 200, 404]


def test_the_audit_tells_each_clinic_of_its_own_sessions_and_of_no_others(server, new_clinic, upload):
    """A pharmacist's look at several clinics must not carry identifiers or counts from one into another's chain."""
    ours, theirs = new_clinic(), new_clinic()
    own = [upload(ours, seed=seed, patient_ref="P-31")["id"] for seed in (23, 24)]
    other = upload(theirs, seed=25, patient_ref="P-31")["id"]
    name = f"pharmacist-{ours.slug}"
    operations.add_user(server.service, name, Role.PHARMACIST, [ours.slug, theirs.slug], "correct horse battery")
    with logged_in(server, name, "correct horse battery") as client:
        for clinic in (ours, theirs):
            assert client.get("/v1/patients/P-31/progress", params={"clinic": clinic.slug}).status_code == 200
        assert client.get("/v1/sessions").status_code == 200
        assert client.get("/v1/review-queue").status_code == 200
    for clinic, ids in ((ours, own), (theirs, [other])):
        told = clinic.client("administrator").get("/v1/audit").json()["items"]
        entries = {each["action"]: each["detail"] for each in told if each["actor"] == f"user:{name}"}
        assert sorted(entries["patient.read"]["sessions"]) == sorted(ids)
        assert entries["sessions.listed"]["count"] == entries["queue.read"]["count"] == len(ids)
        assert not any(each in str(told) for each in (own if clinic is theirs else [other]))


# ------------------------------------------------------------------------------------------ keys


def test_a_revoked_or_expired_or_altered_key_opens_nothing(clinic):
    key = clinic.key("clinician")
    with (
        clinic.server.client(key) as client,
        clinic.server.client(key[:-1] + ("A" if key[-1] != "A" else "B")) as wrong,
    ):
        assert client.get("/v1/me").status_code == 200
        assert wrong.get("/v1/me").status_code == 401
        (listed,) = (
            each
            for each in clinic.client("administrator").get("/v1/keys").json()
            if each["prefix"] == key.split("_")[1]
        )
        assert listed["last_used_at"] is not None
        assert clinic.client("administrator").delete(f"/v1/keys/{listed['id']}").status_code == 204
        assert client.get("/v1/me").status_code == 401
    with clinic.server.client(clinic.key("clinician", days=1e-9)) as client:
        assert client.get("/v1/me").status_code == 401


def test_a_key_is_shown_once_and_stored_as_a_digest(clinic):
    made = clinic.client("administrator").post("/v1/keys", json={"role": "uploader", "label": "door", "days": 30})
    assert made.status_code == 201
    key = made.json()["key"]
    assert key not in clinic.client("administrator").get("/v1/keys").text
    with clinic.server.service.store.read() as connection:
        stored = people.key_with_prefix(connection, key.split("_")[1])
    assert key.encode() not in repr(stored).encode()
    with clinic.server.client(key) as client:
        assert client.get("/v1/me").json()["role"] == "uploader"


def test_a_key_cannot_be_given_more_than_its_role(clinic):
    made = clinic.client("administrator").post("/v1/keys", json={"role": "uploader", "scopes": ["admin"]})
    assert made.status_code == 422


# ------------------------------------------------------------------------------------------ people


class logged_in:  # noqa: N801  # reads as a statement
    """A browser's client after the login form, as a person fills it in."""

    def __init__(self, server, name, password):
        self.client = server.client()
        self.answer = _log_in(self.client, name, password)

    def __enter__(self):
        assert self.answer.status_code == 303, self.answer.text
        token = self.client.get("/v1/me").json()["csrf_token"]
        self.client.headers["x-csrf-token"] = token
        return self.client

    def __exit__(self, *_):
        self.client.close()


def _token(page):
    return re.search(r'name="csrf_token" value="([0-9a-f]+)"', page.text)[1]


def _log_in(client, name, password):
    token = _token(client.get("/login"))
    return client.post("/login", data={"name": name, "password": password, "csrf_token": token, "next": "/queue"})


@pytest.fixture
def person(clinic):
    name = f"kimura-{clinic.slug}"
    operations.add_user(clinic.server.service, name, Role.CLINICIAN, [clinic.slug], "correct horse battery")
    return name


def test_a_person_logs_in_and_out(server, person):
    with logged_in(server, person, "correct horse battery") as client:
        cookie = next(each for each in client.cookies.jar if each.name == "inhalemon_session")
        assert cookie.has_nonstandard_attr("HttpOnly")
        assert cookie.get_nonstandard_attr("SameSite") == "lax"
        assert not cookie.secure  # plain http here; over TLS see below
        assert client.get("/v1/me").json()["name"] == person
        copied = dict(client.cookies)
        assert client.post("/logout").status_code == 303
        with server.client(cookies=copied) as thief:
            assert thief.get("/v1/me").status_code == 401, "a cookie is dead after the logout"


def test_behind_tls_the_cookie_is_secure_and_the_browser_stays_on_tls(server, person):
    with server.client(headers={"x-forwarded-proto": "https"}) as client:
        page = client.get("/login")
        visitor = page.headers["set-cookie"].partition(";")[0]  # Secure too: over http the client would keep it back
        data = {"name": person, "password": "correct horse battery", "csrf_token": _token(page)}
        answer = client.post("/login", data=data, headers={"cookie": visitor})
    cookies = answer.headers.get_list("set-cookie")
    assert any("inhalemon_session" in each and "Secure" in each for each in cookies)
    assert "max-age" in answer.headers["strict-transport-security"]


def test_without_the_token_nothing_changes(server, person, clinic, upload):
    session = upload(clinic, seed=22)["id"]
    with logged_in(server, person, "correct horse battery") as client:
        del client.headers["x-csrf-token"]
        for headers in ({}, {"x-csrf-token": "0" * 64}):
            answer = client.post(f"/v1/sessions/{session}/reviews", json={"kind": "sign_off"}, headers=headers)
            assert (answer.status_code, answer.json()["type"]) == (403, "urn:inhalemon:problem:csrf")
        assert client.post("/logout", data={"csrf_token": "wrong"}).status_code == 403
        assert client.get("/v1/me").status_code == 200


def test_another_site_cannot_log_somebody_in(server, person):
    with server.client() as client:
        answer = client.post("/login", data={"name": person, "password": "correct horse battery", "csrf_token": "x"})
        assert answer.status_code == 403
        assert "inhalemon_session" not in client.cookies


def test_a_wrong_name_and_a_wrong_password_look_the_same(server, person):
    with server.client() as client:
        answers = [_log_in(client, name, "wrong password") for name in (person, "nobody-at-all")]
    assert [each.status_code for each in answers] == [401, 401]
    strip = re.compile(r'value="[^"]*"')
    assert strip.sub("", answers[0].text) == strip.sub("", answers[1].text)


def test_too_many_wrong_passwords_are_slowed_down(server, person):
    with server.client() as client:
        statuses = [_log_in(client, person, "wrong password").status_code for _ in range(11)]
        assert statuses == [401] * 10 + [429]
        last = _log_in(client, person, "correct horse battery")
    assert last.status_code == 429
    assert int(last.headers["retry-after"]) >= 1


def test_a_crowd_of_logins_holds_up_nobody_else(tmp_path):
    """80 at once, each under another name: most are told to come again, and the service goes on answering."""
    settings = settings_for(tmp_path / "data", None, workers=0)
    with serving(settings) as server, contextlib.closing(server.clinic()) as clinic:
        operations.add_user(server.service, "kimura", Role.CLINICIAN, [clinic.slug], "correct horse battery")
        answers = []

        def log_in(n):
            with server.client() as client:
                answers.append(_log_in(client, f"nobody{n}", "wrong password"))

        with server.client() as client:
            token = _token(client.get("/login"))
            threads = [threading.Thread(target=log_in, args=(n,)) for n in range(80)]
            for each in threads:
                each.start()
            slowest_s = 0.0
            while any(each.is_alive() for each in threads):
                started_s = time.monotonic()
                assert clinic.client("clinician").get("/v1/sessions").status_code == 200
                slowest_s = max(slowest_s, time.monotonic() - started_s)
            for each in threads:
                each.join()
            statuses = Counter(each.status_code for each in answers)
            assert set(statuses) == {401, 503}, statuses
            assert all(int(each.headers["retry-after"]) >= 1 for each in answers if each.status_code == 503)
            assert slowest_s < 2.0
            data = {"name": "kimura", "password": "correct horse battery", "csrf_token": token}
            assert client.post("/login", data=data).status_code == 303


def test_an_address_that_tries_many_names_is_slowed_down(tmp_path):
    with serving(settings_for(tmp_path / "data", None, workers=0, login_attempts=1)) as server:
        with server.client() as client:
            statuses = [_log_in(client, f"nobody{n}", "wrong password").status_code for n in range(11)]
        assert statuses == [401] * 10 + [429]


def test_wrong_keys_do_not_shut_out_the_good_one_beside_them(tmp_path):
    with (
        serving(settings_for(tmp_path / "data", None, workers=0)) as server,
        contextlib.closing(server.clinic()) as clinic,
    ):
        with server.client("inh_000000000000_wrong") as client:
            statuses = [client.get("/v1/me").status_code for _ in range(31)]
        assert statuses == [401] * 30 + [429]
        assert clinic.client("clinician").get("/v1/me").status_code == 200


def test_a_login_leads_only_to_pages_here(server, person):
    for target in ("//evil.example", "https://evil.example", "/\\evil.example"):
        with server.client() as client:
            token = _token(client.get("/login"))
            data = {"name": person, "password": "correct horse battery", "csrf_token": token, "next": target}
            assert client.post("/login", data=data).headers["location"] == "/"


def test_a_one_time_password_opens_only_the_change_of_it(server, clinic):
    one_time = operations.add_user(server.service, f"new-{clinic.slug}", Role.CLINICIAN, [clinic.slug])
    with logged_in(server, f"new-{clinic.slug}", one_time) as client:
        assert client.get("/v1/sessions").json()["type"] == "urn:inhalemon:problem:password-change-needed"
        page = client.get("/password")
        data = {"csrf_token": _token(page), "old": one_time}
        assert client.post("/password", data=data | {"new": "short"}).status_code == 422
        assert client.post("/password", data=data | {"new": "a long enough phrase"}).status_code == 303
        assert client.get("/v1/sessions").status_code == 200
    with server.client() as client:
        assert _log_in(client, f"new-{clinic.slug}", one_time).status_code == 401


def test_an_administrator_adds_and_locks_out_people_of_the_own_clinic_only(server, clinic, other_clinic):
    boss, stranger = clinic.client("administrator"), other_clinic.client("administrator")
    made = boss.post("/v1/users", json={"name": f"Sato-{clinic.slug}", "role": "clinician"})
    assert made.status_code == 201, made.text
    assert made.json()["clinics"] == [clinic.slug]
    name = f"sato-{clinic.slug}"
    assert boss.post("/v1/users", json={"name": name, "role": "clinician"}).status_code == 409
    assert stranger.patch(f"/v1/users/{name}", json={"is_active": False}).status_code == 404
    with logged_in(server, name, made.json()["one_time_password"]) as client:
        assert boss.patch(f"/v1/users/{name}", json={"is_active": False}).status_code == 200
        assert client.get("/v1/me").status_code == 401


def test_whom_an_administrator_may_not_change_the_page_does_not_offer(server, new_clinic):
    ours, theirs = new_clinic(), new_clinic()
    name = f"mori-{ours.slug}"
    operations.add_user(server.service, name, Role.PHARMACIST, [ours.slug, theirs.slug], "correct horse battery")
    boss = ours.client("administrator")
    (listed,) = boss.get("/v1/users").json()
    assert (listed["name"], listed["clinics"], listed["is_yours_alone"]) == (name, [ours.slug], False)
    assert boss.patch(f"/v1/users/{name}", json={"is_active": False}).status_code == 404
    admin = f"boss-{ours.slug}"
    operations.add_user(server.service, admin, Role.ADMINISTRATOR, [ours.slug], "correct horse battery")
    with logged_in(server, admin, "correct horse battery") as client:
        page = client.get("/settings").text
    assert name in page
    assert f"/settings/users/{name}" not in page


def test_a_clinic_named_twice_is_one(clinic):
    boss = clinic.client("administrator")
    made = boss.post(
        "/v1/users", json={"name": f"abe-{clinic.slug}", "role": "clinician", "clinics": [clinic.slug] * 2}
    )
    assert (made.status_code, made.json()["clinics"]) == (201, [clinic.slug])


def test_passwords_are_kept_as_argon2id(server, person):
    with server.service.store.read() as connection:
        user = people.user_named(connection, person)
    assert user.password_hash.startswith("$argon2id$")
    assert auth.check_password(server.service.store, person, "correct horse battery") is not None


@pytest.mark.parametrize("password", ["short", "password1234", "aaaaaaaaaaaa", "inhalemon2026"])
def test_an_easy_password_is_refused(password):
    with pytest.raises(auth.InvalidError):
        auth.hash_password(password)
