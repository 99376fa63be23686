"""The tables. Moments are microseconds since 1970 (`..._us`); identifiers are random text.

The same source serves SQLite and PostgreSQL; `api/migrations` makes these tables, and a test holds the two equal.
"""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Float,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    Table,
    Text,
    UniqueConstraint,
)

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
        "pk": "pk_%(table_name)s",
    }
)


def _owned(
    name: str, target: str, *, primary_key: bool = False, nullable: bool = False, index: bool = False
) -> Column[str]:
    """A foreign key whose row goes when its owner goes."""
    owner = ForeignKey(target, ondelete="CASCADE")
    return Column(name, Text, owner, primary_key=primary_key, nullable=nullable, index=index)


# ------------------------------------------------------------------------------------------ clinics and people

clinics = Table(
    "clinics",
    metadata,
    Column("id", Text, primary_key=True),
    Column("slug", Text, nullable=False, unique=True),
    Column("created_at_us", BigInteger, nullable=False),
)

users = Table(
    "users",
    metadata,
    Column("id", Text, primary_key=True),
    Column("name", Text, nullable=False, unique=True),  # what the person types to log in, lower case
    Column("role", Text, nullable=False),
    Column("password_hash", Text),  # none: logs in by OIDC only
    Column("must_change_password", Boolean, nullable=False),
    Column("is_active", Boolean, nullable=False),
    Column("created_at_us", BigInteger, nullable=False),
    Column("last_login_us", BigInteger),
)

user_clinics = Table(
    "user_clinics",
    metadata,
    _owned("user_id", "users.id", primary_key=True),
    _owned("clinic_id", "clinics.id", primary_key=True),
)

web_sessions = Table(
    "web_sessions",
    metadata,
    Column("token_hash", Text, primary_key=True),
    _owned("user_id", "users.id", index=True),
    Column("created_at_us", BigInteger, nullable=False),
    Column("expires_at_us", BigInteger, nullable=False, index=True),
)

api_keys = Table(
    "api_keys",
    metadata,
    Column("id", Text, primary_key=True),
    _owned("clinic_id", "clinics.id", index=True),
    Column("prefix", Text, nullable=False, unique=True),
    Column("mac", LargeBinary, nullable=False),  # HMAC-SHA256 of the whole key
    Column("role", Text, nullable=False),
    Column("scopes", Text, nullable=False),  # separated by blanks
    Column("label", Text, nullable=False),
    Column("created_at_us", BigInteger, nullable=False),
    Column("created_by", Text, nullable=False),
    Column("expires_at_us", BigInteger),
    Column("last_used_us", BigInteger),
    Column("revoked_at_us", BigInteger),
)

# ------------------------------------------------------------------------------------------ sessions and reports

sessions = Table(
    "sessions",
    metadata,
    Column("id", Text, primary_key=True),
    _owned("clinic_id", "clinics.id"),
    Column("sha256", Text, nullable=False),  # of the bytes as they came
    Column("n_bytes", BigInteger, nullable=False),
    Column("suffix", Text, nullable=False),  # .csv, .csv.gz, ...; the file's name may tell who the patient is
    Column("session_ref", Text),  # the recording's own session_id, when it has one
    Column("device", Text),
    Column("patient_ref", Text),
    Column("sidecar", LargeBinary),  # the metadata that came with it, JSON
    Column("recorded_at_us", BigInteger),
    Column("happened_at_us", BigInteger, nullable=False),  # recorded, or else uploaded
    Column("uploaded_at_us", BigInteger, nullable=False),
    Column("uploaded_by", Text, nullable=False),
    Column("state", Text, nullable=False),  # unscored, scored, unusable
    Column("attempts", Integer, nullable=False, default=0),
    Column("next_try_us", BigInteger),  # set while another try is due
    Column("failure", LargeBinary),  # the last failure as a problem, JSON
    Column("report_id", Text),  # the newest report
    Column("duration_s", Float),
    Column("grade", Text),
    Column("merit", Integer, nullable=False),  # 0 the worst grade ... 4 correct, 5 not scored: what to look at first
    Column("points", Integer),
    Column("n_reviews", Integer, nullable=False, default=0),  # the reviews' version, for If-Match
    Column("reviewed_at_us", BigInteger),
    Column("signed_off_us", BigInteger),
    UniqueConstraint("clinic_id", "sha256"),
    Index("ix_sessions_by_time", "clinic_id", "happened_at_us", "id"),
    Index("ix_sessions_by_upload", "clinic_id", "uploaded_at_us", "id"),
    Index("ix_sessions_by_merit", "clinic_id", "merit", "happened_at_us", "id"),
    Index("ix_sessions_by_patient", "clinic_id", "patient_ref", "happened_at_us", "id"),
    Index("ix_sessions_queue", "clinic_id", "state", "signed_off_us", "merit", "happened_at_us", "id"),
    Index("ix_sessions_due", "state", "next_try_us"),
)

reports = Table(
    "reports",
    metadata,
    Column("id", Text, primary_key=True),
    _owned("session_id", "sessions.id"),
    Column("version", Integer, nullable=False),  # 1, 2, ... within the session
    Column("created_at_us", BigInteger, nullable=False),
    Column("pipeline_version", Text, nullable=False),
    Column("settings_digest", Text, nullable=False),
    Column("rules_digest", Text, nullable=False),
    Column("grade", Text, nullable=False),
    Column("points", Integer, nullable=False),
    Column("body", LargeBinary, nullable=False),  # inhalemon-report/1, JSON
    UniqueConstraint("session_id", "version"),
)

findings = Table(
    "findings",
    metadata,
    _owned("session_id", "sessions.id", primary_key=True),
    Column("rule", Text, primary_key=True),
    Column("verdict", Text, nullable=False),
    Column("severity", Text),
    _owned("clinic_id", "clinics.id"),
    Index("ix_findings_by_rule", "clinic_id", "rule", "verdict", "session_id"),
)

# ------------------------------------------------------------------------------------------ reviews

reviews = Table(
    "reviews",
    metadata,
    Column("id", Text, primary_key=True),
    _owned("session_id", "sessions.id"),
    Column("version", Integer, nullable=False),  # 1, 2, ... within the session
    Column("kind", Text, nullable=False),  # confirm, override, add, comment, sign_off, undo
    Column("rule", Text),
    Column("verdict", Text),
    Column("machine_verdict", Text),  # what the report said of the rule when this was written
    Column("reason", Text),
    Column("undoes", Text),
    Column("report_id", Text),
    Column("reviewer_id", Text, nullable=False),
    Column("reviewer", Text, nullable=False),
    Column("at_us", BigInteger, nullable=False),
    UniqueConstraint("session_id", "version"),
)

leases = Table(
    "leases",
    metadata,
    _owned("session_id", "sessions.id", primary_key=True),
    Column("reviewer_id", Text, nullable=False),
    Column("reviewer", Text, nullable=False),
    Column("expires_at_us", BigInteger, nullable=False),
)

# ------------------------------------------------------------------------------------------ records and chores

audit = Table(
    "audit",
    metadata,
    Column("clinic_id", Text, primary_key=True),
    Column("seq", BigInteger, primary_key=True, autoincrement=False),
    Column("at_us", BigInteger, nullable=False),
    Column("actor", Text, nullable=False),
    Column("action", Text, nullable=False),
    Column("subject", Text),
    Column("detail", Text, nullable=False),  # canonical JSON
    Column("hash", LargeBinary, nullable=False),
)

audit_heads = Table(
    "audit_heads",
    metadata,
    Column("clinic_id", Text, primary_key=True),
    Column("seq", BigInteger, nullable=False),
    Column("hash", LargeBinary, nullable=False),
)

idempotency = Table(
    "idempotency",
    metadata,
    Column("actor_id", Text, primary_key=True),
    Column("key", Text, primary_key=True),
    Column("fingerprint", Text, nullable=False),
    Column("created_at_us", BigInteger, nullable=False, index=True),
    Column("status", Integer),  # none while the first request is under way
    Column("headers", LargeBinary),
    Column("body", LargeBinary),
)

# An answer goes when one of the sessions that it tells of is erased or corrected.
idempotency_sessions = Table(
    "idempotency_sessions",
    metadata,
    Column("actor_id", Text, primary_key=True),
    Column("key", Text, primary_key=True),
    _owned("session_id", "sessions.id", primary_key=True, index=True),
    ForeignKeyConstraint(["actor_id", "key"], ["idempotency.actor_id", "idempotency.key"], ondelete="CASCADE"),
)

erasures = Table(
    "erasures",
    metadata,
    Column("clinic_id", Text, primary_key=True),
    Column("sha256", Text, primary_key=True),
    Column("session_id", Text, nullable=False),
    Column("at_us", BigInteger, nullable=False),
)

webhooks = Table(
    "webhooks",
    metadata,
    Column("id", Text, primary_key=True),
    _owned("clinic_id", "clinics.id", index=True),
    Column("url", Text, nullable=False),
    Column("secret", Text, nullable=False),
    Column("events", Text, nullable=False),  # separated by blanks
    Column("created_at_us", BigInteger, nullable=False),
)

deliveries = Table(
    "deliveries",
    metadata,
    Column("id", Text, primary_key=True),
    _owned("webhook_id", "webhooks.id", index=True),
    Column("event", Text, nullable=False),
    Column("body", LargeBinary, nullable=False),
    Column("created_at_us", BigInteger, nullable=False),
    Column("attempts", Integer, nullable=False),
    Column("next_try_us", BigInteger, index=True),  # none: delivered or given up
    Column("delivered_at_us", BigInteger),
    Column("last_answer", Text),
)

# The data folder that this database belongs to: one row.
origin = Table(
    "origin",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("data_id", Text, nullable=False),
)

heartbeat = Table(
    "heartbeat",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("at_us", BigInteger, nullable=False),
)
