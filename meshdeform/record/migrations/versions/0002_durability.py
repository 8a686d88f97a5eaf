"""Owners, events, the outbox, idempotency keys, uploads, API keys, webhooks and what metrics need."""

import json
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"

_ID = sa.String(64).with_variant(sa.String(64, collation="C"), "postgresql")
_INSTANT = sa.DateTime(timezone=True)
_TERMINAL = ("succeeded", "failed", "canceled", "expired")
_EPOCH = "1970-01-01 00:00:00+00:00"


def upgrade() -> None:
    """Add the columns and tables, and give the jobs that are there what new ones are made with."""
    for column in (
        sa.Column("owner_id", sa.String(64), nullable=False, server_default=""),
        sa.Column("workload", sa.String(600), nullable=False, server_default=""),
        sa.Column("origin_key", sa.String(255)),
        sa.Column("origin", sa.JSON),
        sa.Column("priority", sa.Integer, nullable=False, server_default="0"),
        sa.Column("deadline_at", _INSTANT),
        sa.Column("retention_s", sa.Double),
        sa.Column("retain_until", _INSTANT),
        sa.Column("request_id", sa.String(128)),
        sa.Column("traceparent", sa.String(64)),
        sa.Column("oom_attempts", sa.Integer, nullable=False, server_default="0"),
        sa.Column("event_seq", sa.Integer, nullable=False, server_default="0"),
        sa.Column("step_s", sa.Double),
    ):
        op.add_column("jobs", column)
    for name, columns in {
        "owner_id_id": ["owner_id", "id"],
        "owner_id_state_id": ["owner_id", "state", "id"],
        "origin_key": ["origin_key"],
        "workload_state_id": ["workload", "state", "id"],
        "deadline_at": ["deadline_at"],
        "retain_until": ["retain_until"],
        "worker_id": ["worker_id"],
    }.items():
        op.create_index(f"ix_jobs_{name}", "jobs", columns)
    op.create_index("ix_jobs_urgency", "jobs", ["state", sa.text("priority DESC"), "id"])
    for column in (
        sa.Column("size", sa.BigInteger, nullable=False, server_default="0"),
        sa.Column("mesh_key", sa.String(255)),
        sa.Column("mesh_sha256", sa.String(64)),
        sa.Column("mesh_size", sa.BigInteger),
        sa.Column("created_at", _INSTANT, nullable=False, server_default=_EPOCH),
    ):
        op.add_column("checkpoints", column)
    _tables_of_a_job()
    _tables_of_owners()
    _tables_of_webhooks()
    _tables_of_the_deployment()
    _fill_in()


def _tables_of_a_job() -> None:
    op.create_table(
        "labels",
        sa.Column("job_id", _ID, nullable=False),
        sa.Column("name", sa.String(64), nullable=False),
        sa.Column("value", sa.String(500), nullable=False),
        sa.PrimaryKeyConstraint("job_id", "name", name="pk_labels"),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name="fk_labels_job_id", ondelete="CASCADE"),
    )
    op.create_index("ix_labels_name_value_job_id", "labels", ["name", "value", "job_id"])
    op.create_table(
        "events",
        sa.Column("job_id", _ID, nullable=False),
        sa.Column("seq", sa.Integer, nullable=False),
        sa.Column("type", sa.String(32), nullable=False),
        sa.Column("at", _INSTANT, nullable=False),
        sa.Column("attempt", sa.Integer, nullable=False),
        sa.Column("data", sa.JSON, nullable=False),
        sa.PrimaryKeyConstraint("job_id", "seq", name="pk_events"),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name="fk_events_job_id", ondelete="CASCADE"),
    )
    op.create_table(
        "outbox",
        sa.Column("job_id", _ID, nullable=False),
        sa.Column("created_at", _INSTANT, nullable=False),
        sa.PrimaryKeyConstraint("job_id", name="pk_outbox"),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name="fk_outbox_job_id", ondelete="CASCADE"),
    )


def _tables_of_owners() -> None:
    op.create_table(
        "idempotency",
        sa.Column("owner_id", sa.String(64), nullable=False),
        sa.Column("key", sa.String(255), nullable=False),
        sa.Column("request_hash", sa.String(64), nullable=False),
        sa.Column("token", sa.String(32), nullable=False),
        sa.Column("locked_until", _INSTANT, nullable=False),
        sa.Column("response", sa.JSON),
        sa.Column("created_at", _INSTANT, nullable=False),
        sa.PrimaryKeyConstraint("owner_id", "key", name="pk_idempotency"),
    )
    op.create_index("ix_idempotency_created_at", "idempotency", ["created_at"])
    op.create_table(
        "uploads",
        sa.Column("id", _ID, nullable=False),
        sa.Column("owner_id", sa.String(64), nullable=False),
        sa.Column("filename", sa.String(200), nullable=False),
        sa.Column("size", sa.BigInteger, nullable=False),
        sa.Column("sha256", sa.String(64)),
        sa.Column("key", sa.String(255)),
        sa.Column("created_at", _INSTANT, nullable=False),
        sa.Column("expires_at", _INSTANT, nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_uploads"),
    )
    op.create_index("ix_uploads_key", "uploads", ["key"])
    op.create_index("ix_uploads_expires_at", "uploads", ["expires_at"])
    op.create_table(
        "api_keys",
        sa.Column("id", _ID, nullable=False),
        sa.Column("owner_id", sa.String(64), nullable=False),
        sa.Column("name", sa.String(100), nullable=False),
        sa.Column("secret_hash", sa.String(64), nullable=False),
        sa.Column("created_at", _INSTANT, nullable=False),
        sa.Column("last_used_at", _INSTANT),
        sa.Column("revoked_at", _INSTANT),
        sa.Column("requests_per_minute", sa.Integer),
        sa.Column("max_active_jobs", sa.Integer),
        sa.PrimaryKeyConstraint("id", name="pk_api_keys"),
    )


def _tables_of_webhooks() -> None:
    op.create_table(
        "webhooks",
        sa.Column("id", _ID, nullable=False),
        sa.Column("owner_id", sa.String(64), nullable=False),
        sa.Column("url", sa.String(2000), nullable=False),
        sa.Column("events", sa.JSON, nullable=False),
        sa.Column("secret", sa.String(128), nullable=False),
        sa.Column("previous_secret", sa.String(128)),
        sa.Column("previous_until", _INSTANT),
        sa.Column("disabled_at", _INSTANT),
        sa.Column("disabled_reason", sa.String(255)),
        sa.Column("created_at", _INSTANT, nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_webhooks"),
    )
    op.create_index("ix_webhooks_owner_id_id", "webhooks", ["owner_id", "id"])
    op.create_table(
        "deliveries",
        sa.Column("id", _ID, nullable=False),
        sa.Column("webhook_id", _ID, nullable=False),
        sa.Column("job_id", _ID, nullable=False),
        sa.Column("replay_of", _ID),
        sa.Column("type", sa.String(64), nullable=False),
        sa.Column("payload", sa.JSON, nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("attempts", sa.Integer, nullable=False),
        sa.Column("next_at", _INSTANT),
        sa.Column("created_at", _INSTANT, nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_deliveries"),
        sa.ForeignKeyConstraint(["webhook_id"], ["webhooks.id"], name="fk_deliveries_webhook_id", ondelete="CASCADE"),
    )
    op.create_index("ix_deliveries_state_next_at", "deliveries", ["state", "next_at"])
    op.create_index("ix_deliveries_webhook_id_id", "deliveries", ["webhook_id", "id"])
    op.create_index("ix_deliveries_created_at_state", "deliveries", ["created_at", "state"])
    op.create_table(
        "delivery_attempts",
        sa.Column("delivery_id", _ID, nullable=False),
        sa.Column("number", sa.Integer, nullable=False),
        sa.Column("at", _INSTANT, nullable=False),
        sa.Column("status", sa.Integer),
        sa.Column("error", sa.String(500)),
        sa.Column("seconds", sa.Double, nullable=False),
        sa.PrimaryKeyConstraint("delivery_id", "number", name="pk_delivery_attempts"),
        sa.ForeignKeyConstraint(
            ["delivery_id"], ["deliveries.id"], name="fk_delivery_attempts_delivery_id", ondelete="CASCADE"
        ),
    )


def _tables_of_the_deployment() -> None:
    op.create_table(
        "workers",
        sa.Column("id", sa.String(255), nullable=False),
        sa.Column("queue", sa.String(255), nullable=False),
        sa.Column("device", sa.String(32), nullable=False),
        sa.Column("started_at", _INSTANT, nullable=False),
        sa.Column("seen_at", _INSTANT, nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_workers"),
    )
    op.create_table(
        "tallies",
        sa.Column("name", sa.String(64), nullable=False),
        sa.Column("label", sa.String(64), nullable=False),
        sa.Column("value", sa.Double, nullable=False),
        sa.PrimaryKeyConstraint("name", "label", name="pk_tallies"),
    )
    op.create_table(
        "secrets",
        sa.Column("name", sa.String(64), nullable=False),
        sa.Column("value", sa.String(128), nullable=False),
        sa.PrimaryKeyConstraint("name", name="pk_secrets"),
    )


def _fill_in() -> None:
    """Every job has its labels, and events that begin with `queued` and end with how it ended."""
    connection = op.get_bind()
    tables = sa.MetaData()
    tables.reflect(connection, only=["jobs", "labels", "events", "outbox", "checkpoints"])
    jobs, checkpoints = tables.tables["jobs"], tables.tables["checkpoints"]
    made = sa.select(jobs.c.created_at).where(jobs.c.id == checkpoints.c.job_id).scalar_subquery()
    connection.execute(sa.update(checkpoints).values(created_at=made))
    for row in connection.execute(sa.select(jobs)).all():
        request = row.request if isinstance(row.request, dict) else json.loads(row.request)
        for name, value in request.get("metadata", {}).items():
            connection.execute(sa.insert(tables.tables["labels"]).values(job_id=row.id, name=name, value=value))
        past: list[dict[str, Any]] = [{"type": "queued", "at": row.created_at, "attempt": 0, "data": {}}]
        if row.attempt and row.started_at:
            past.append({"type": "started", "at": row.started_at, "attempt": row.attempt, "data": {}})
        if row.state == "canceling":
            past.append({"type": row.state, "at": row.started_at or row.created_at, "attempt": row.attempt, "data": {}})
        if row.state in _TERMINAL:
            data = {"error": row.error} if row.error else {}
            at = row.finished_at or row.created_at
            past.append({"type": row.state, "at": at, "attempt": row.attempt, "data": data})
        elif row.state == "queued":
            connection.execute(sa.insert(tables.tables["outbox"]).values(job_id=row.id, created_at=row.created_at))
        for seq, event in enumerate(past, 1):
            connection.execute(sa.insert(tables.tables["events"]).values(job_id=row.id, seq=seq, **event))
        connection.execute(sa.update(jobs).where(jobs.c.id == row.id).values(event_seq=len(past)))
