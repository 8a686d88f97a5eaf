"""The text of each job in which a search looks."""

from __future__ import annotations

import unicodedata
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"

_ID = sa.String(64).with_variant(sa.String(64, collation="C"), "postgresql")
_BATCH = 1000


def upgrade() -> None:
    """Add the table, filled for all jobs."""
    texts = op.create_table(
        "job_texts",
        sa.Column("job_id", _ID, nullable=False),
        sa.Column("text", sa.Text, nullable=False),
        sa.PrimaryKeyConstraint("job_id", name="pk_job_texts"),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name="fk_job_texts_job_id", ondelete="CASCADE"),
    )
    connection, last = op.get_bind(), ""
    jobs = sa.table("jobs", sa.column("id", _ID), sa.column("request", sa.JSON), sa.column("files", sa.JSON))
    query = sa.select(jobs).where(jobs.c.id > sa.bindparam("last")).order_by(jobs.c.id).limit(_BATCH)
    while rows := connection.execute(query, {"last": last}).all():
        values = [{"job_id": row.id, "text": _text(row.request, row.files)} for row in rows]
        connection.execute(sa.insert(texts), values)
        last = rows[-1].id


def _text(request: Any, files: Any) -> str:
    names = [file["filename"] for file in files.values()]
    text = "\n".join([request.get("prompt", ""), *names, *map(str, request.get("metadata", {}).values())])
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", text).casefold())
