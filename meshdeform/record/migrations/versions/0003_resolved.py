"""The parameters that a job runs with, beside those that were written."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Add the column; jobs that are there have none, and their workers resolve the request as before."""
    op.add_column("jobs", sa.Column("resolved", sa.JSON))
