"""All tables but later ones. A migration that changes one begins with a copy here of what `schema.py` says of it."""

import logging

import sqlalchemy as sa
from alembic import op

from meshdeform.record.columns import UtcDateTime
from meshdeform.record.schema import metadata, trigrams

revision = "0010"
down_revision = None

_ID = sa.String(64).with_variant(sa.String(64, collation="C"), "postgresql")
_LATER = frozenset({"words", "usage"})
_log = logging.getLogger("meshdeform.record.migrations")
_REFUSED = frozenset({"42501", "58P01", "0A000", "42704"})
"""PostgreSQL's codes where this user may not create the extension, or the server lacks it or has it out of reach."""


def upgrade() -> None:
    """Create the tables, and the index of trigrams where the database can have it: PostgreSQL with pg_trgm."""
    connection = op.get_bind()
    for table in metadata.sorted_tables:
        if table.name not in (*_LATER, "artifacts"):
            table.create(connection)
    op.create_table(
        "artifacts",
        sa.Column("job_id", _ID, sa.ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True),
        sa.Column("name", sa.String(128), primary_key=True),
        sa.Column("attempt", sa.Integer, nullable=False),
        sa.Column("content_type", sa.String(128), nullable=False),
        sa.Column("size", sa.BigInteger, nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False),
        sa.Column("key", sa.String(255), nullable=False),
        sa.Column("created_at", UtcDateTime, nullable=False),
    )
    if connection.dialect.name != "postgresql":
        return
    # The choice between the index and a walk over the newest jobs depends on how rare a word is. With the default, 100,
    # PostgreSQL takes a word that one text in a hundred has for one that hardly any has.
    op.execute("ALTER TABLE job_texts ALTER COLUMN text SET STATISTICS 1000")
    try:
        with connection.begin_nested():
            connection.exec_driver_sql("CREATE EXTENSION IF NOT EXISTS pg_trgm")
            connection.execute(sa.schema.CreateIndex(trigrams))
    except sa.exc.DBAPIError as error:
        if _code(error) not in _REFUSED:
            raise
        _log.warning(
            "searches for words stay slow in a large record: the extension pg_trgm cannot be created here. "
            "docs/operations.md#search has the commands for an administrator. PostgreSQL says: %s",
            error.orig,
        )


def _code(error: sa.exc.DBAPIError) -> str:
    code = error.orig.args[0] if error.orig is not None and error.orig.args else None
    return str(code.get("C", "")) if isinstance(code, dict) else ""
