"""What the format of an artifact cannot hold."""

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"


def upgrade() -> None:
    """Add the column, which is null for artifacts that hold everything."""
    op.add_column("artifacts", sa.Column("warnings", sa.JSON(none_as_null=True)))
