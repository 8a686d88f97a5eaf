"""What a newer version of Meshdeform may do to the record while this one is still running: add."""

from __future__ import annotations

import sqlalchemy as sa

from meshdeform.record.database import Database
from meshdeform.record.schema import HEAD

__all__ = ["NEWER", "upgrade_record"]

NEWER = f"{HEAD[:2]}99"
_ADDED = (
    "ALTER TABLE jobs ADD COLUMN something TEXT",
    "ALTER TABLE jobs ADD COLUMN counted INTEGER NOT NULL DEFAULT 0",
    "ALTER TABLE checkpoints ADD COLUMN something TEXT",
    "ALTER TABLE events ADD COLUMN counted INTEGER NOT NULL DEFAULT 0",
    "CREATE TABLE things (job_id VARCHAR(64) PRIMARY KEY, name TEXT NOT NULL)",
    "CREATE INDEX ix_jobs_counted ON jobs (counted)",
)


def upgrade_record(database: Database) -> None:
    """Migrate the record as a newer version would."""
    with database.write() as connection:
        for statement in _ADDED:
            connection.execute(sa.text(statement))
        connection.execute(sa.text("UPDATE alembic_version SET version_num = :version"), {"version": NEWER})
