"""Logging in with one's organisation, against a provider that signs real tokens on this machine."""

from __future__ import annotations

import base64
import hashlib
import json
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

import jwt
import pytest
from cryptography.hazmat.primitives.asymmetric import rsa
from running import serving, settings_for

from api import auth, operations
from api.principal import Role

KEY = rsa.generate_private_key(public_exponent=65537, key_size=2048)
OTHER_KEY = rsa.generate_private_key(public_exponent=65537, key_size=2048)
CLIENT = ("inhalemon", "a secret of the provider's making")


class Provider:
    """Discovery, keys and token endpoint; `answer` is what the next token says."""

    def __init__(self):
        provider = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                if self.path == "/.well-known/openid-configuration":
                    self.tell(
                        {
                            "issuer": provider.url,
                            "authorization_endpoint": f"{provider.url}/authorize",
                            "token_endpoint": f"{provider.url}/token",
                            "jwks_uri": f"{provider.url}/keys",
                        }
                    )
                else:
                    public = json.loads(jwt.algorithms.RSAAlgorithm.to_jwk(KEY.public_key()))
                    self.tell({"keys": [public | {"kid": "1", "use": "sig", "alg": "RS256"}]})

            def do_POST(self):
                form = parse_qs(self.rfile.read(int(self.headers["content-length"])).decode())
                given = base64.b64decode(self.headers["authorization"].removeprefix("Basic ")).decode()
                challenge = base64.urlsafe_b64encode(hashlib.sha256(form["code_verifier"][0].encode()).digest())
                is_right = given == ":".join(CLIENT) and challenge.rstrip(b"=").decode() == provider.challenge
                self.tell(
                    {"id_token": provider.token} if is_right else {"error": "invalid_grant"}, 200 if is_right else 400
                )

            def tell(self, content, status=200):
                body = json.dumps(content).encode()
                self.send_response(status)
                self.send_header("content-length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"
        self.challenge = self.token = ""
        self.thread = threading.Thread(target=self.server.serve_forever)
        self.thread.start()

    def sign(self, key=KEY, algorithm="RS256", **claims):
        now = int(time.time())
        usual = {"iss": self.url, "aud": CLIENT[0], "iat": now, "exp": now + 60, "email_verified": True}
        self.token = jwt.encode(usual | claims, key, algorithm=algorithm, headers={"kid": "1"})

    def close(self):
        self.server.shutdown()
        self.server.server_close()
        self.thread.join()


@pytest.fixture(scope="module")
def organisation(tmp_path_factory):
    """A provider, and a service that trusts it."""
    provider = Provider()
    settings = settings_for(
        tmp_path_factory.mktemp("data"),
        None,
        workers=0,
        oidc_issuer=provider.url,
        oidc_client_id=CLIENT[0],
        oidc_client_secret=CLIENT[1],
    )
    with serving(settings) as server:
        operations.add_user(server.service, "ito@clinic.example", Role.CLINICIAN, ["north"])
        yield provider, server
    provider.close()


def come_back(organisation, client, **claims):
    """Begin a login, let the provider sign `claims`, and come back with its code."""
    provider, _ = organisation
    out = client.get("/login/oidc", params={"next": "/queue"})
    assert out.status_code == 303
    asked = {name: values[0] for name, values in parse_qs(urlsplit(out.headers["location"]).query).items()}
    provider.challenge = asked["code_challenge"]
    provider.sign(**{"email": "ito@clinic.example", "nonce": asked["nonce"], **claims})
    return asked, client.get("/login/oidc/callback", params={"code": "c", "state": asked["state"]})


def test_who_the_organisation_vouches_for_is_let_in(organisation):
    with organisation[1].client() as client:
        asked, answer = come_back(organisation, client)
        assert asked["code_challenge_method"] == "S256"
        assert (answer.status_code, answer.headers["location"]) == (303, "/queue")
        assert client.get("/v1/me").json()["name"] == "ito@clinic.example"
        assert client.get("/queue").status_code == 200
        assert client.get("/v1/sessions").status_code == 200


def test_who_was_made_in_the_settings_is_not_sent_to_a_form_for_passwords(organisation):
    """Nor does the one-time password that was shown go on opening the door."""
    _, server = organisation
    boss = operations.add_key(server.service, "north", Role.ADMINISTRATOR).key
    with server.client(boss) as client:
        made = client.post("/v1/users", json={"name": "abe@clinic.example", "role": "clinician"}).json()
    with server.client() as client:
        _, answer = come_back(organisation, client, email="abe@clinic.example")
        assert (answer.status_code, answer.headers["location"]) == (303, "/queue")
        assert client.get("/queue").status_code == 200
    assert auth.check_password(server.service.store, "abe@clinic.example", made["one_time_password"]) is None


@pytest.mark.parametrize(
    "claims",
    [
        {"email": "stranger@clinic.example"},
        {"email_verified": False},
        {"nonce": "of another login"},
        {"aud": "another service"},
        {"iss": "https://another.example"},
        {"exp": 1_000_000_000},
        {"key": OTHER_KEY},
        {"key": "0" * 64, "algorithm": "HS256"},
        {"key": None, "algorithm": "none"},
    ],
    ids=lambda claims: next(iter(claims)),
)
def test_nobody_else_is(organisation, claims):
    with organisation[1].client() as client:
        _, answer = come_back(organisation, client, **claims)
        assert answer.status_code == 403
        assert client.get("/v1/me").status_code == 401


def test_an_answer_to_another_attempt_is_refused(organisation):
    """Somebody else's link with their code must not log a victim into their account."""
    with organisation[1].client() as client, organisation[1].client() as victim:
        asked, _ = come_back(organisation, client)
        victim.get("/login/oidc")
        for state in (asked["state"], ""):
            answer = victim.get("/login/oidc/callback", params={"code": "c", "state": state})
            assert answer.status_code == 403


def test_without_the_settings_there_is_no_such_login(server):
    with server.client() as client:
        assert client.get("/login/oidc").status_code == 404
