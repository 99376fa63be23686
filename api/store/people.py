"""Clinics, people, their logins, and programs' keys."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from sqlalchemy import Connection, bindparam, delete, func, select, union_all, update

from api.moments import SECOND_US, new_id, now_us
from api.problems import ConflictError, NotFoundError
from api.store import audit
from api.store.engine import insert_new
from api.store.tables import api_keys, clinics, user_clinics, users, web_sessions

_LAST_USED_STEP_US = 60 * SECOND_US  # a key's last use is written at most once a minute


@dataclass(frozen=True, slots=True)
class User:
    id: str
    name: str
    role: str
    password_hash: str | None
    must_change_password: bool
    is_active: bool
    created_at_us: int
    last_login_us: int | None
    clinics: dict[str, str]  # slug -> identifier


@dataclass(frozen=True, slots=True)
class ApiKey:
    id: str
    clinic_id: str
    clinic: str  # slug
    prefix: str
    mac: bytes
    role: str
    scopes: str
    label: str
    created_at_us: int
    created_by: str
    expires_at_us: int | None
    last_used_us: int | None
    revoked_at_us: int | None


# ------------------------------------------------------------------------------------------ clinics


def ensure_clinic(connection: Connection, slug: str) -> tuple[str, bool]:
    """The clinic's identifier, and whether it was made now."""
    made = {"id": new_id(), "slug": slug, "created_at_us": now_us()}
    if insert_new(connection, clinics, made):
        audit.begin(connection, str(made["id"]))
        return str(made["id"]), True
    return connection.scalars(select(clinics.c.id).where(clinics.c.slug == slug)).one(), False


def clinic_slugs(connection: Connection, ids: Iterable[str] | None = None) -> dict[str, str]:
    """Slug to identifier, of all clinics or of those named."""
    statement = select(clinics.c.slug, clinics.c.id).order_by(clinics.c.slug)
    if ids is not None:
        statement = statement.where(clinics.c.id.in_(list(ids)))
    return {row.slug: row.id for row in connection.execute(statement)}


def require_clinic(connection: Connection, slug: str) -> str:
    """The clinic's identifier. Raises `NotFoundError`."""
    found = connection.scalar(select(clinics.c.id).where(clinics.c.slug == slug))
    if found is None:
        raise NotFoundError(f"There is no clinic {slug!r}.")
    return str(found)


# ------------------------------------------------------------------------------------------ people


def add_user(
    connection: Connection,
    name: str,
    role: str,
    clinic_ids: Sequence[str],
    *,
    password_hash: str | None,
    must_change_password: bool,
) -> str:
    """The new person's identifier. Raises `ConflictError` when the name is taken."""
    row = {
        "id": new_id(),
        "name": name.lower(),
        "role": role,
        "password_hash": password_hash,
        "must_change_password": must_change_password,
        "is_active": True,
        "created_at_us": now_us(),
    }
    if not insert_new(connection, users, row):
        raise ConflictError(f"There is already somebody named {name!r}; choose another name.")
    connection.execute(user_clinics.insert(), [{"user_id": row["id"], "clinic_id": each} for each in clinic_ids])
    return str(row["id"])


def count_users(connection: Connection) -> int:
    return connection.scalar(select(func.count()).select_from(users)) or 0


def _user(connection: Connection, condition: object) -> User | None:
    row = connection.execute(select(users).where(condition)).mappings().one_or_none()  # type: ignore[arg-type]  # built here from columns
    return None if row is None else User(**row, clinics=_clinics_of(connection, row["id"]))


def _clinics_of(connection: Connection, user_id: str) -> dict[str, str]:
    statement = select(clinics.c.slug, clinics.c.id).join(user_clinics).where(user_clinics.c.user_id == user_id)
    return {row.slug: row.id for row in connection.execute(statement.order_by(clinics.c.slug))}


def user_named(connection: Connection, name: str) -> User | None:
    return _user(connection, users.c.name == name.lower())


def require_user(connection: Connection, name: str) -> User:
    """The person of this name. Raises `NotFoundError`."""
    user = user_named(connection, name)
    if user is None:
        raise NotFoundError(f"There is nobody named {name!r}.")
    return user


def users_of(connection: Connection, clinic_ids: Sequence[str]) -> list[User]:
    """The people of these clinics, by name."""
    member = select(user_clinics.c.user_id).where(user_clinics.c.clinic_id.in_(clinic_ids))
    rows = connection.execute(select(users).where(users.c.id.in_(member)).order_by(users.c.name)).mappings()
    return [User(**row, clinics=_clinics_of(connection, row["id"])) for row in rows]


def set_password(connection: Connection, user_id: str, password_hash: str, *, must_change: bool) -> None:
    """Store a new password and end every login that the old one opened."""
    connection.execute(
        update(users).where(users.c.id == user_id).values(password_hash=password_hash, must_change_password=must_change)
    )
    connection.execute(delete(web_sessions).where(web_sessions.c.user_id == user_id))


def drop_password(connection: Connection, user_id: str) -> None:
    """Whoever is vouched for by somebody else needs no password, and a one-time password must not stay open."""
    connection.execute(
        update(users).where(users.c.id == user_id).values(password_hash=None, must_change_password=False)
    )


def set_active(connection: Connection, user_id: str, *, is_active: bool) -> None:
    connection.execute(update(users).where(users.c.id == user_id).values(is_active=is_active))
    if not is_active:
        connection.execute(delete(web_sessions).where(web_sessions.c.user_id == user_id))


def add_to_clinic(connection: Connection, user_id: str, clinic_id: str) -> None:
    insert_new(connection, user_clinics, {"user_id": user_id, "clinic_id": clinic_id})


def drop_from_clinic(connection: Connection, user_id: str, clinic_id: str) -> None:
    its_own = (user_clinics.c.user_id == user_id) & (user_clinics.c.clinic_id == clinic_id)
    connection.execute(delete(user_clinics).where(its_own))


# ------------------------------------------------------------------------------------------ logins


def open_login(connection: Connection, user_id: str, token_hash: str, expires_at_us: int) -> None:
    now = now_us()
    connection.execute(
        web_sessions.insert().values(
            token_hash=token_hash, user_id=user_id, created_at_us=now, expires_at_us=expires_at_us
        )
    )
    connection.execute(update(users).where(users.c.id == user_id).values(last_login_us=now))


def user_of_login(connection: Connection, token_hash: str) -> User | None:
    """The active person whose login has not run out."""
    owner = select(web_sessions.c.user_id).where(
        web_sessions.c.token_hash == token_hash, web_sessions.c.expires_at_us > now_us()
    )
    return _user(connection, users.c.id.in_(owner) & users.c.is_active)


def close_login(connection: Connection, token_hash: str) -> None:
    connection.execute(delete(web_sessions).where(web_sessions.c.token_hash == token_hash))


def drop_old_logins(connection: Connection) -> None:
    connection.execute(delete(web_sessions).where(web_sessions.c.expires_at_us <= now_us()))


# ------------------------------------------------------------------------------------------ keys


def add_key(
    connection: Connection,
    clinic_id: str,
    *,
    prefix: str,
    mac: bytes,
    role: str,
    scopes: str,
    label: str,
    created_by: str,
    expires_at_us: int | None,
) -> str:
    """The new key's identifier; only its prefix and HMAC are kept."""
    key_id = new_id()
    connection.execute(
        api_keys.insert().values(
            id=key_id,
            clinic_id=clinic_id,
            prefix=prefix,
            mac=mac,
            role=role,
            scopes=scopes,
            label=label,
            created_at_us=now_us(),
            created_by=created_by,
            expires_at_us=expires_at_us,
        )
    )
    return key_id


_KEYS = select(api_keys, clinics.c.slug.label("clinic")).join(clinics)
_KEY = _KEYS.where(api_keys.c.prefix == bindparam("with_prefix"))  # built once: it runs with every request


def key_with_prefix(connection: Connection, prefix: str) -> ApiKey | None:
    row = connection.execute(_KEY, {"with_prefix": prefix}).mappings().one_or_none()
    return None if row is None else ApiKey(**row)


def keys_of(connection: Connection, clinic_ids: Sequence[str]) -> list[ApiKey]:
    """The keys of these clinics, newest first."""
    statement = _KEYS.where(api_keys.c.clinic_id.in_(clinic_ids)).order_by(api_keys.c.created_at_us.desc())
    return [ApiKey(**row) for row in connection.execute(statement).mappings()]


def is_use_worth_writing(key: ApiKey) -> bool:
    return key.last_used_us is None or now_us() - key.last_used_us > _LAST_USED_STEP_US


def note_use(connection: Connection, key_id: str) -> None:
    connection.execute(update(api_keys).where(api_keys.c.id == key_id).values(last_used_us=now_us()))


def revoke_key(connection: Connection, clinic_ids: Sequence[str], key_id: str) -> ApiKey:
    """Revoke a key of these clinics. Raises `NotFoundError`."""
    statement = _KEYS.where(api_keys.c.id == key_id, api_keys.c.clinic_id.in_(clinic_ids))
    row = connection.execute(statement).mappings().one_or_none()
    if row is None:
        raise NotFoundError("There is no such key here.")
    if row["revoked_at_us"] is None:
        connection.execute(update(api_keys).where(api_keys.c.id == key_id).values(revoked_at_us=now_us()))
    return ApiKey(**row)


def roles_of(connection: Connection, ids: Iterable[str]) -> dict[str, str]:
    """The role of each of these people and keys that is still here."""
    wanted = list(ids)
    rows = connection.execute(
        union_all(*(select(table.c.id, table.c.role).where(table.c.id.in_(wanted)) for table in (users, api_keys)))
    )
    return {row.id: row.role for row in rows}
