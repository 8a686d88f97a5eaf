"""The record's tables. `migrations/` makes them; a test compares the two."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa

__all__ = ["HEAD", "artifacts", "checkpoints", "discarded", "files", "jobs", "metadata"]

HEAD = "0001"
"""The newest migration: a record that says so needs no look at the scripts (and no Alembic in memory)."""


class UtcDateTime(sa.TypeDecorator[datetime]):
    """An instant, in UTC; SQLite would forget the zone."""

    impl = sa.DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: sa.Dialect) -> datetime | None:  # noqa: ARG002
        """Store instants only."""
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError("A datetime without a zone is no instant.")
        return value.astimezone(UTC)

    def process_result_value(self, value: Any, dialect: sa.Dialect) -> datetime | None:  # noqa: ARG002
        """Read what was stored as UTC."""
        if value is None:
            return None
        instant: datetime = value if value.tzinfo else value.replace(tzinfo=UTC)
        return instant.astimezone(UTC)


# Byte order, whatever the database's locale: ids sort by time.
_ID = sa.String(64).with_variant(sa.String(64, collation="C"), "postgresql")

metadata = sa.MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "pk": "pk_%(table_name)s",
    }
)

jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("id", _ID, primary_key=True),
    sa.Column("kind", sa.String(32), nullable=False),
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("request", sa.JSON, nullable=False),
    sa.Column("asset_key", sa.String(255), nullable=False),
    sa.Column("asset", sa.JSON, nullable=False),
    sa.Column("target_key", sa.String(255)),
    sa.Column("target", sa.JSON(none_as_null=True)),
    sa.Column("error", sa.JSON(none_as_null=True)),
    sa.Column("created_at", UtcDateTime, nullable=False),
    sa.Column("started_at", UtcDateTime),
    sa.Column("finished_at", UtcDateTime),
    sa.Column("version", sa.Integer, nullable=False),
    sa.Column("attempt", sa.Integer, nullable=False),
    # Attempts whose worker fell silent. One that was handed back in order does not count.
    sa.Column("lost_attempts", sa.Integer, nullable=False),
    sa.Column("worker_id", sa.String(255)),
    sa.Column("lease_expires_at", UtcDateTime),
    sa.Column("step", sa.Integer, nullable=False),
    sa.Column("total_steps", sa.Integer, nullable=False),
    sa.Column("fraction", sa.Double, nullable=False),
    sa.Column("phase", sa.String(64), nullable=False),
    sa.Column("losses", sa.JSON, nullable=False),
    sa.Column("eta_s", sa.Double),
    sa.Index(None, "state", "id"),
    sa.Index(None, "asset_key"),
    sa.Index(None, "target_key"),
)

artifacts = sa.Table(
    "artifacts",
    metadata,
    sa.Column("job_id", _ID, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("name", sa.String(128), primary_key=True),
    sa.Column("attempt", sa.Integer, nullable=False),
    sa.Column("content_type", sa.String(128), nullable=False),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.Column("sha256", sa.String(64), nullable=False),
    sa.Column("key", sa.String(255), nullable=False),
    sa.Column("created_at", UtcDateTime, nullable=False),
)

checkpoints = sa.Table(
    "checkpoints",
    metadata,
    sa.Column("job_id", _ID, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
    sa.Column("attempt", sa.Integer, primary_key=True),
    sa.Column("step", sa.Integer, primary_key=True),
    sa.Column("sha256", sa.String(64), nullable=False),
    sa.Column("key", sa.String(255), nullable=False),
)

files = sa.Table(
    "files",
    metadata,
    sa.Column("key", sa.String(255), primary_key=True),
    # Requests that are about to make a job of this file: it must not be removed under them.
    sa.Column("pins", sa.Integer, nullable=False),
    sa.Column("touched_at", UtcDateTime, nullable=False),
)

# Prefixes of objects whose job is deleted, until the store has forgotten them too.
discarded = sa.Table("discarded", metadata, sa.Column("prefix", sa.String(255), primary_key=True))
