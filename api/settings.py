"""The service's settings, from the environment (`INHALEMON_...`) and checked once, at the start.

Every field below is read from the variable of its name, in capitals and with the prefix: `data_dir` from
`INHALEMON_DATA_DIR`.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, SecretStr, ValidationError, field_validator, model_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from api.problems import ConfigurationError
from inhalemon.exceptions import RulesError, SettingsError
from inhalemon.rules import load_rules
from inhalemon.settings import Settings

_PREFIX = "INHALEMON_"
_SECRETS = {"secret", "oidc_client_secret", "database_url"}  # never repeated; a URL may hold a password
_MIB = 1024 * 1024


class ServiceSettings(BaseSettings):
    """Where data lives, how much is allowed, and who may log in."""

    model_config = SettingsConfigDict(env_prefix=_PREFIX, frozen=True, extra="ignore")

    # where
    data_dir: Path = Field(Path("inhalemon-data"), description="where recordings, secret and SQLite are kept")
    database_url: str | None = Field(None, description="sqlite:///... or postgresql://...; default: SQLite in data_dir")
    host: str = Field("127.0.0.1", description="the address to listen at")
    port: int = Field(8000, ge=0, le=65535, description="0 takes any free one")
    public_url: str | None = Field(None, description="as people reach it, e.g. https://inhalemon.example.org")
    forwarded_allow_ips: str = Field(
        "127.0.0.1", description="reverse proxies whose X-Forwarded-* headers are believed"
    )
    secret: SecretStr | None = Field(None, description="at least 32 characters; default: a file in data_dir")
    log_level: str = Field("info", description="debug, info, warning or error")

    # scoring
    workers: int = Field(
        default_factory=lambda: min(2, os.cpu_count() or 1),
        ge=0,
        le=64,
        description="processes that score; default: 2, or 1 on a single core; 0 keeps recordings and scores none",
    )
    max_waiting: int = Field(32, ge=0, description="sessions that may wait for a worker before uploads get 503")
    score_deadline_s: float = Field(30.0, gt=0, description="longest work on one session")
    worker_memory_bytes: int = Field(
        2048 * _MIB, ge=256 * _MIB, description="memory of one worker; a recording that needs more is refused"
    )
    score_attempts: int = Field(5, ge=1, description="tries before a session is left to a person")
    scoring_settings: Path | None = Field(None, description="a TOML file with the pipeline's settings")
    scoring_rules: str = Field("default", description="a profile (default, strict), or a TOML file with rules")

    # uploads
    max_upload_bytes: int = Field(128 * _MIB, ge=1024, description="of one request")
    max_files_per_upload: int = Field(50, ge=1, description="of one request")
    upload_stall_s: float = Field(15.0, gt=0, description="longest silence within an upload")
    upload_deadline_s: float = Field(600.0, gt=0, description="longest upload")
    min_free_bytes: int = Field(64 * _MIB, ge=0, description="free space below which uploads get 507")
    allow_names: bool = Field(False, description="accept a patient_ref that looks like a name or a birth date")

    # people and programs
    session_hours: float = Field(12.0, gt=0, description="how long a login lasts")
    login_attempts: int = Field(10, ge=1, description="failed logins per name and address in five minutes")
    key_requests_per_minute: int = Field(12_000, ge=1, description="of one key")
    lease_minutes: float = Field(15.0, gt=0, description="how long a reviewer holds a session")
    oidc_issuer: str | None = Field(None, description="lets people log in with their organisation: the provider's URL")
    oidc_client_id: str | None = Field(None, description="as the provider knows this service")
    oidc_client_secret: SecretStr | None = Field(None, description="as the provider gave it")
    oidc_claim: str = Field("email", description="the claim that holds the name under which the person is known here")

    # keeping
    retention_days: int | None = Field(None, ge=1, description="sessions older than this are erased; default: kept")
    cache_bytes: int = Field(2048 * _MIB, ge=0, description="disk given to cached time series")
    webhook_hosts: Annotated[tuple[str, ...], NoDecode] = Field(
        (), description="host names, separated by commas, that webhooks may be sent to"
    )

    @field_validator("webhook_hosts", mode="before")
    @classmethod
    def _split(cls, given: object) -> object:
        if isinstance(given, str):
            return tuple(part.strip().lower() for part in given.split(",") if part.strip())
        return given

    @field_validator("log_level")
    @classmethod
    def _known_level(cls, given: str) -> str:
        if given.lower() not in {"debug", "info", "warning", "error"}:
            raise ValueError("expected debug, info, warning or error")
        return given.lower()

    @field_validator("secret")
    @classmethod
    def _long_enough(cls, given: SecretStr | None) -> SecretStr | None:
        if given is not None and len(given.get_secret_value()) < 32:
            raise ValueError("expected at least 32 characters")
        return given

    @field_validator("database_url")
    @classmethod
    def _known_database(cls, given: str | None) -> str | None:
        if given is not None and not given.startswith(("sqlite:///", "postgresql://", "postgresql+psycopg://")):
            raise ValueError("expected sqlite:///PATH or postgresql://USER@HOST/DATABASE")
        return given

    @field_validator("scoring_settings")
    @classmethod
    def _good_settings(cls, given: Path | None) -> Path | None:
        try:
            if given is not None:
                Settings.from_toml(given)
        except SettingsError as error:  # now, not at every upload
            raise ValueError(str(error)) from error
        return given

    @field_validator("scoring_rules")
    @classmethod
    def _good_rules(cls, given: str) -> str:
        try:
            load_rules(given)
        except RulesError as error:
            raise ValueError(str(error)) from error
        return given

    @model_validator(mode="after")
    def _whole_oidc(self) -> Self:
        parts = (self.oidc_issuer, self.oidc_client_id, self.oidc_client_secret)
        if any(parts) and not all(parts):
            raise ValueError("OIDC needs oidc_issuer, oidc_client_id and oidc_client_secret together")
        return self

    @property
    def database(self) -> str:
        """The database's URL; `postgresql://` means psycopg 3."""
        if self.database_url is None:
            return f"sqlite:///{self.data_dir / 'inhalemon.sqlite3'}"
        return self.database_url.replace("postgresql://", "postgresql+psycopg://", 1)

    @property
    def is_secure(self) -> bool:
        """Whether people reach the service over TLS for certain."""
        return bool(self.public_url and self.public_url.startswith("https://"))


def load(**given: object) -> ServiceSettings:
    """Settings from the environment, with `given` on top. Raises `ConfigurationError`, one line per mistake."""
    try:
        return ServiceSettings(**given)  # type: ignore[arg-type]  # pydantic checks the values, that is its purpose
    except ValidationError as error:
        lines = [
            f"{_PREFIX}{'_'.join(str(part) for part in each['loc']).upper() or 'settings'}: {each['msg']}"
            + ("" if not each["loc"] or _SECRETS & set(each["loc"]) else f" (found {each['input']!r})")
            for each in error.errors(include_url=False)
        ]
        raise ConfigurationError("; ".join(lines)) from error


def unknown_variables() -> list[str]:
    """Variables that begin with the prefix and that nobody reads: most likely misspelt."""
    known = {_PREFIX + name.upper() for name in ServiceSettings.model_fields}
    return sorted(name for name in os.environ if name.startswith(_PREFIX) and name not in known)


def as_table() -> str:
    """Every setting with its default and meaning, as Markdown: what docs/deploy.md shows."""
    lines = ["| variable | default | what |", "|---|---|---|"]
    for name, field in ServiceSettings.model_fields.items():
        default = "" if field.is_required() or field.default_factory or field.default is None else f"`{field.default}`"
        lines.append(f"| `{_PREFIX}{name.upper()}` | {default} | {field.description or ''} |")
    return "\n".join(lines)
