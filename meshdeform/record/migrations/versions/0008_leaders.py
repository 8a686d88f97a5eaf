"""Who does the work that one process does for all."""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    """Add the table."""
    op.create_table(
        "leaders",
        sa.Column("name", sa.String(255), nullable=False),
        sa.Column("holder", sa.String(32), nullable=False),
        sa.Column("expires_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("looked_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("watching_since", sa.DateTime(timezone=True)),
        sa.Column("candidates", sa.Integer, nullable=False),
        sa.PrimaryKeyConstraint("name", name="pk_leaders"),
    )
