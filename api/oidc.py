"""Logging in with one's organisation: OpenID Connect's authorization code flow with PKCE.

The provider says who somebody is; whether that person may do anything is decided here, by the user of that name. Nobody
is made by logging in.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import secrets
import time
from dataclasses import asdict, dataclass
from typing import Any
from urllib.parse import urlencode, urlsplit

import httpx
import jwt
import orjson

from api.problems import ConfigurationError, NotAllowedError, NotReadyError
from api.secrets import Secret
from api.settings import ServiceSettings

_ALGORITHMS = ["RS256", "RS384", "RS512", "PS256", "ES256", "ES384", "EdDSA"]  # never HMAC, never none
_LIFE_S = 600
_LEEWAY_S = 60
_TIMEOUT_S = 10.0


@dataclass(frozen=True, slots=True)
class Attempt:
    """One login under way: what must come back, and where to go then. Kept in a signed cookie."""

    state: str
    nonce: str
    verifier: str
    target: str
    at_s: int

    @classmethod
    def begin(cls, target: str) -> Attempt:
        state, nonce, verifier = (secrets.token_urlsafe(32) for _ in range(3))
        return cls(state, nonce, verifier, target, int(time.time()))

    def sealed(self, secret: Secret) -> str:
        content = base64.urlsafe_b64encode(orjson.dumps(asdict(self))).decode()
        return f"{content}.{secret.mac('oidc', content).hex()}"

    @classmethod
    def unsealed(cls, secret: Secret, cookie: str, state: str) -> Attempt:
        """Raises `NotAllowedError` when it is not ours, too old, or belongs to another attempt."""
        content, _, mark = cookie.partition(".")
        if hmac.compare_digest(secret.mac("oidc", content).hex().encode(), mark.encode()):
            found = cls(**orjson.loads(base64.urlsafe_b64decode(content)))
            is_same = hmac.compare_digest(found.state.encode(), state.encode())
            if is_same and time.time() - found.at_s < _LIFE_S:
                return found
        raise NotAllowedError("This login took too long, or was begun in another window. Log in again.")


class Provider:
    """The organisation's provider, as its discovery document describes it."""

    def __init__(self, settings: ServiceSettings) -> None:
        if not (settings.oidc_issuer and settings.oidc_client_id and settings.oidc_client_secret):
            raise ConfigurationError("OIDC needs oidc_issuer, oidc_client_id and oidc_client_secret together")
        parts = urlsplit(settings.oidc_issuer)
        if parts.scheme != "https" and parts.hostname not in {"localhost", "127.0.0.1", "::1"}:
            raise ConfigurationError("the OIDC issuer must be reached by https")
        self._issuer = settings.oidc_issuer
        self._client_id = settings.oidc_client_id
        self._client_secret = settings.oidc_client_secret
        self._claim = settings.oidc_claim
        self._discovered: dict[str, Any] | None = None

    async def login_url(self, attempt: Attempt, redirect_uri: str) -> str:
        """Where to send the person. Raises `NotReadyError` when the provider does not answer."""
        challenge = base64.urlsafe_b64encode(hashlib.sha256(attempt.verifier.encode()).digest()).rstrip(b"=").decode()
        async with _client() as client:
            endpoint = (await self._discover(client))["authorization_endpoint"]
        query = {
            "response_type": "code",
            "client_id": self._client_id,
            "redirect_uri": redirect_uri,
            "scope": "openid email profile",
            "state": attempt.state,
            "nonce": attempt.nonce,
            "code_challenge": challenge,
            "code_challenge_method": "S256",
        }
        return f"{endpoint}{'&' if '?' in endpoint else '?'}{urlencode(query)}"

    async def name_of(self, attempt: Attempt, code: str, redirect_uri: str) -> str:
        """The name, within the claim that the settings say, of the person who comes back with `code`.

        Raises `NotAllowedError` when the token is not for us, not for this attempt, or not signed by the provider.
        """
        form = {
            "grant_type": "authorization_code",
            "code": code,
            "redirect_uri": redirect_uri,
            "code_verifier": attempt.verifier,
        }
        async with _client() as client:
            discovered = await self._discover(client)
            identity = (self._client_id, self._client_secret.get_secret_value())
            answered = await _asked(client.post(discovered["token_endpoint"], data=form, auth=identity))
            keys = await _asked(client.get(discovered["jwks_uri"]))
        claims = self._verified(str(answered.get("id_token", "")), keys, attempt.nonce)
        name = claims.get(self._claim)
        if not isinstance(name, str) or (self._claim == "email" and claims.get("email_verified") is not True):
            raise NotAllowedError(f"Your organisation does not vouch for your {self._claim}; ask its administrator.")
        return name

    def _verified(self, token: str, keys: dict[str, Any], nonce: str) -> dict[str, Any]:
        try:
            wanted = jwt.get_unverified_header(token).get("kid")
            key = next(each for each in jwt.PyJWKSet.from_dict(keys).keys if wanted in {None, each.key_id})
            claims: dict[str, Any] = jwt.decode(
                token,
                key.key,
                algorithms=_ALGORITHMS,
                audience=self._client_id,
                issuer=self._issuer,
                leeway=_LEEWAY_S,
                options={"require": ["exp", "iat", "aud", "iss", "nonce"]},
            )
        except (jwt.PyJWTError, StopIteration) as error:
            raise NotAllowedError("What your organisation's login answered cannot be trusted.") from error
        if not hmac.compare_digest(str(claims["nonce"]).encode(), nonce.encode()):
            raise NotAllowedError("What your organisation's login answered belongs to another login.")
        return claims

    async def _discover(self, client: httpx.AsyncClient) -> dict[str, Any]:
        if self._discovered is None:
            url = f"{self._issuer.rstrip('/')}/.well-known/openid-configuration"
            found = await _asked(client.get(url))
            if found.get("issuer") != self._issuer:
                raise NotReadyError("The organisation's login calls itself by another name than the settings do.")
            self._discovered = found
        return self._discovered


def _client() -> httpx.AsyncClient:
    return httpx.AsyncClient(timeout=_TIMEOUT_S, follow_redirects=False)


async def _asked(request: Any) -> dict[str, Any]:  # httpx's coroutine
    try:
        answer = await request
        answer.raise_for_status()
        found = answer.json()
    except (httpx.HTTPError, ValueError) as error:
        raise NotReadyError("Your organisation's login does not answer as it should; try again.") from error
    if not isinstance(found, dict):
        raise NotReadyError("Your organisation's login does not answer as it should.")
    return found
