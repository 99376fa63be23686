"""The service's secret and what is derived from it: keys for HMACs, signed tokens, cursors."""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import secrets
from collections.abc import Sequence

import orjson

from api.files import write_once
from api.problems import BadRequestError, ConfigurationError
from api.settings import ServiceSettings

_LENGTH = 32
_TAG = 12


class Secret:
    """One secret, from which a key for each purpose is derived."""

    def __init__(self, root: bytes) -> None:
        self._root = root

    def key(self, purpose: str) -> bytes:
        return hmac.new(self._root, purpose.encode(), hashlib.sha256).digest()

    def mac(self, purpose: str, message: str) -> bytes:
        return hmac.new(self.key(purpose), message.encode(), hashlib.sha256).digest()

    def sign_cursor(self, purpose: str, values: Sequence[int | str]) -> str:
        """An opaque cursor for a position within one listing."""
        content = orjson.dumps(list(values))
        tag = hmac.new(self.key("cursor:" + purpose), content, hashlib.sha256).digest()[:_TAG]
        return base64.urlsafe_b64encode(tag + content).decode("ascii").rstrip("=")

    def read_cursor(self, purpose: str, cursor: str) -> list[int | str]:
        """The position within a cursor made here for the same listing. Raises `BadRequestError`."""
        try:
            packed = base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True)
        except (ValueError, binascii.Error):
            packed = b""
        tag, content = packed[:_TAG], packed[_TAG:]
        wanted = hmac.new(self.key("cursor:" + purpose), content, hashlib.sha256).digest()[:_TAG]
        if not hmac.compare_digest(tag, wanted):
            raise BadRequestError("The cursor is not one that this listing gave; start again without it.")
        values: list[int | str] = orjson.loads(content)
        return values


def load(settings: ServiceSettings) -> Secret:
    """The secret from the settings, or from a file in the data folder that is made when missing."""
    if settings.secret is not None:
        return Secret(hashlib.sha256(settings.secret.get_secret_value().encode()).digest())
    path = settings.data_dir / "secret.key"
    if not path.exists():
        write_once(path, secrets.token_bytes(_LENGTH))
    content = path.read_bytes()
    if len(content) != _LENGTH:
        raise ConfigurationError(f"{path} holds {len(content)} bytes, expected {_LENGTH}; restore it from the backup")
    return Secret(content)
