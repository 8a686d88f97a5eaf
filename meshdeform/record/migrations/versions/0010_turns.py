"""What turns by time, repeated failures, estimates by mesh and webhooks of one job need."""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"

_ID = sa.String(64).with_variant(sa.String(64, collation="C"), "postgresql")

_YIELDED = "ix_jobs_state_yielded_at"

# An older version, which may use the record at the same time, writes none of them.
_JOBS = (
    ("claimed_at", sa.DateTime(timezone=True), None),
    ("ran_s", sa.Double, "0"),
    ("yielded_at", sa.DateTime(timezone=True), None),
    ("retry_at", sa.DateTime(timezone=True), None),
    ("failures", sa.Integer, "0"),
    ("faces", sa.Integer, None),
    ("parts", sa.Integer, None),
)


def upgrade() -> None:
    """Add the columns, and the indices of the jobs that were handed over and of those that may have a webhook."""
    for name, kind, default in _JOBS:
        op.add_column("jobs", sa.Column(name, kind, nullable=default is None, server_default=default))
    some = sa.text("yielded_at IS NOT NULL")
    op.create_index(_YIELDED, "jobs", ["state", "yielded_at"], sqlite_where=some, postgresql_where=some)
    op.add_column("webhooks", sa.Column("job_id", _ID))
    op.create_index("ix_webhooks_job_id", "webhooks", ["job_id"])
