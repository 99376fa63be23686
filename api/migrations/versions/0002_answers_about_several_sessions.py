"""Answers to repeated requests may be about several sessions. What was remembered is forgotten; it lives a day."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make the table of remembered answers anew, and one of the sessions that they tell of."""
    op.drop_table("idempotency")
    op.create_table(
        "idempotency",
        sa.Column("actor_id", sa.Text(), nullable=False),
        sa.Column("key", sa.Text(), nullable=False),
        sa.Column("fingerprint", sa.Text(), nullable=False),
        sa.Column("created_at_us", sa.BigInteger(), nullable=False),
        sa.Column("status", sa.Integer(), nullable=True),
        sa.Column("headers", sa.LargeBinary(), nullable=True),
        sa.Column("body", sa.LargeBinary(), nullable=True),
        sa.PrimaryKeyConstraint("actor_id", "key", name=op.f("pk_idempotency")),
    )
    op.create_index(op.f("ix_idempotency_created_at_us"), "idempotency", ["created_at_us"], unique=False)
    op.create_table(
        "idempotency_sessions",
        sa.Column("actor_id", sa.Text(), nullable=False),
        sa.Column("key", sa.Text(), nullable=False),
        sa.Column("session_id", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(
            ["actor_id", "key"],
            ["idempotency.actor_id", "idempotency.key"],
            name=op.f("fk_idempotency_sessions_actor_id_idempotency"),
            ondelete="CASCADE",
        ),
        sa.ForeignKeyConstraint(
            ["session_id"],
            ["sessions.id"],
            name=op.f("fk_idempotency_sessions_session_id_sessions"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("actor_id", "key", "session_id", name=op.f("pk_idempotency_sessions")),
    )
    op.create_index(op.f("ix_idempotency_sessions_session_id"), "idempotency_sessions", ["session_id"], unique=False)
