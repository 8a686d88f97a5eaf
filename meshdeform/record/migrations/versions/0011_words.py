"""Words of owners' own."""

from alembic import op

from meshdeform.record.schema import words

revision = "0011"
down_revision = "0010"


def upgrade() -> None:
    """Create their table."""
    words.create(op.get_bind())
