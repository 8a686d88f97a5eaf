"""The versions that computed checkpoints and results."""

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"


def upgrade() -> None:
    """Add the columns, unless the first migration has made the tables of today."""
    for table in ("jobs", "checkpoints"):
        columns = {column["name"] for column in sa.inspect(op.get_bind()).get_columns(table)}
        if "made_by" not in columns:
            op.add_column(table, sa.Column("made_by", sa.String(200)))
