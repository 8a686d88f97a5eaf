"""The bytes that each job keeps, for the limit on those of an owner."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"

_FILL = """
    UPDATE jobs SET stored_bytes =
    (SELECT coalesce(sum(size), 0) FROM artifacts WHERE artifacts.job_id = jobs.id)
    + (SELECT coalesce(sum(size + coalesce(mesh_size, 0)), 0) FROM checkpoints WHERE checkpoints.job_id = jobs.id)
"""


def upgrade() -> None:
    """Add the column, filled for all jobs, and its index."""
    op.add_column("jobs", sa.Column("stored_bytes", sa.BigInteger, nullable=False, server_default="0"))
    op.execute(_FILL)
    op.create_index("ix_jobs_owner_id_stored_bytes", "jobs", ["owner_id", "stored_bytes"])
