"""Shares of owners: the index by which workers find the next job of an owner, and the highest priority of a key."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Add the index and the column; existing keys have the deployment's limit."""
    op.create_index("ix_jobs_share", "jobs", ["state", "priority", "owner_id", "id"])
    op.add_column("api_keys", sa.Column("max_priority", sa.Integer))
