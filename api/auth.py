"""Keys and passwords: making them, checking them, and what is kept of them."""

from __future__ import annotations

import functools
import hashlib
import hmac
import secrets
import threading
from dataclasses import dataclass

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from api.moments import DAY_US, now_us
from api.principal import SCOPES, Principal, Role, Scope
from api.problems import InvalidError, NotLoggedInError
from api.secrets import Secret
from api.store import Connection, Store, people

_HASHER = PasswordHasher()  # argon2id, RFC 9106's low-memory profile
_ONE_AT_A_TIME = threading.Lock()  # each takes 64 MiB; a crowd of logins must not take the machine
MIN_PASSWORD_LENGTH = 10
_COMMON = ("password", "inhalemon", "12345", "qwerty", "letmein", "abcdef")


@dataclass(frozen=True, slots=True)
class NewKey:
    """A key as it is shown once."""

    id: str
    key: str
    prefix: str


# ------------------------------------------------------------------------------------------ programs


def make_key(
    connection: Connection,
    secret: Secret,
    clinic_id: str,
    role: Role,
    *,
    scopes: frozenset[Scope] | None = None,
    label: str = "",
    created_by: str,
    days: float | None = None,
) -> NewKey:
    """Make a key; only its prefix and HMAC-SHA256 are stored. Raises `InvalidError` for scopes beyond the role."""
    wanted = SCOPES[role] if scopes is None else scopes
    if not wanted <= SCOPES[role]:
        beyond = ", ".join(sorted(wanted - SCOPES[role]))
        raise InvalidError(f"A {role} cannot have the scope {beyond}; choose among {', '.join(sorted(SCOPES[role]))}.")
    prefix = secrets.token_hex(6)
    key = f"inh_{prefix}_{secrets.token_urlsafe(32)}"
    key_id = people.add_key(
        connection,
        clinic_id,
        prefix=prefix,
        mac=secret.mac("api-key", key),
        role=role,
        scopes=" ".join(sorted(wanted)),
        label=label,
        created_by=created_by,
        expires_at_us=None if days is None else now_us() + round(days * DAY_US),
    )
    return NewKey(key_id, key, prefix)


def principal_of_key(store: Store, secret: Secret, key: str) -> Principal:
    """Who holds this key. Raises `NotLoggedInError` when it is wrong, revoked or has run out."""
    parts = key.split("_", 2)
    with store.read() as connection:
        found = people.key_with_prefix(connection, parts[1]) if len(parts) == 3 and parts[0] == "inh" else None
    # The HMAC is made in any case, so that an unknown prefix takes as long as a wrong key.
    is_right = hmac.compare_digest(secret.mac("api-key", key), bytes(32) if found is None else found.mac)
    if found is None or not is_right:
        raise NotLoggedInError("The key is not known.")
    if found.revoked_at_us is not None:
        raise NotLoggedInError("The key was revoked.")
    if found.expires_at_us is not None and found.expires_at_us <= now_us():
        raise NotLoggedInError("The key has run out.")
    if people.is_use_worth_writing(found):
        with store.write() as connection:
            people.note_use(connection, found.id)
    return Principal(
        id=found.id,
        kind="key",
        name=found.prefix,
        role=Role(found.role),
        scopes=frozenset(Scope(each) for each in found.scopes.split()),
        clinics={found.clinic: found.clinic_id},
    )


# ------------------------------------------------------------------------------------------ people


def hash_password(password: str) -> str:
    """The argon2id hash of a password that is good enough. Raises `InvalidError`."""
    if len(password) < MIN_PASSWORD_LENGTH:
        raise InvalidError(f"The password has {len(password)} characters; at least {MIN_PASSWORD_LENGTH} are needed.")
    if len(set(password)) < 5 or any(password.lower().startswith(each) for each in _COMMON):
        raise InvalidError("The password is too easily guessed; choose another one.")
    with _ONE_AT_A_TIME:
        return _HASHER.hash(password)


def one_time_password() -> str:
    """A random password of 80 bits that can be read aloud."""
    alphabet = "abcdefghjkmnpqrstuvwxyz23456789"
    return "-".join("".join(secrets.choice(alphabet) for _ in range(4)) for _ in range(4))


def check_password(store: Store, name: str, password: str) -> people.User | None:
    """The active person with this name and password, or nobody; takes the same time for both."""
    with store.read() as connection:
        user = people.user_named(connection, name)
    stored = user.password_hash if user is not None and user.is_active else None
    with _ONE_AT_A_TIME:
        try:
            _HASHER.verify(stored or _nobody(), password)
        except (VerificationError, InvalidHashError):
            return None
    return user if stored is not None else None


@functools.cache
def _nobody() -> str:
    """What is checked for names that do not exist, so that time does not tell."""
    return _HASHER.hash(secrets.token_hex(16))


def token_hash(token: str) -> str:
    """What is kept of a login's token."""
    return hashlib.sha256(token.encode()).hexdigest()


def principal_of_user(user: people.User, csrf_token: str | None = None) -> Principal:
    role = Role(user.role)
    return Principal(
        id=user.id,
        kind="user",
        name=user.name,
        role=role,
        scopes=SCOPES[role],
        clinics=user.clinics,
        csrf_token=csrf_token,
        must_change_password=user.must_change_password,
    )
