"""What owners have used."""

from alembic import op

from meshdeform.record.schema import usage

revision = "0012"
down_revision = "0011"


def upgrade() -> None:
    """Create its table."""
    usage.create(op.get_bind())
