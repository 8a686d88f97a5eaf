"""The files of a job by part, for kinds of job that read other files than `asset` and `target`."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"

_ID = sa.String(64).with_variant(sa.String(64, collation="C"), "postgresql")

_UPGRADE = {
    "sqlite": (
        """
        UPDATE jobs SET files = CASE WHEN target_key IS NULL THEN json_object('asset', json(asset))
        ELSE json_object('asset', json(asset), 'target', json(target)) END
        """,
        """
        INSERT INTO job_files (job_id, part, owner_id, key, size)
        SELECT id, 'asset', owner_id, asset_key, json_extract(asset, '$.size') FROM jobs
        UNION ALL
        SELECT id, 'target', owner_id, target_key, json_extract(target, '$.size') FROM jobs
        WHERE target_key IS NOT NULL
        """,
    ),
    "postgresql": (
        """
        UPDATE jobs SET files = CASE WHEN target_key IS NULL THEN json_build_object('asset', asset)
        ELSE json_build_object('asset', asset, 'target', target) END
        """,
        """
        INSERT INTO job_files (job_id, part, owner_id, key, size)
        SELECT id, 'asset', owner_id, asset_key, CAST(asset->>'size' AS bigint) FROM jobs
        UNION ALL
        SELECT id, 'target', owner_id, target_key, CAST(target->>'size' AS bigint) FROM jobs
        WHERE target_key IS NOT NULL
        """,
    ),
}
_UPGRADE_ORIGINS = """
    INSERT INTO job_files (job_id, part, owner_id, key, size)
    SELECT id, '(origin)', owner_id, origin_key, 0 FROM jobs WHERE origin_key IS NOT NULL
"""


def upgrade() -> None:
    """Add the table and the column, carry the files of all jobs over, and drop the columns that held them."""
    op.create_table(
        "job_files",
        sa.Column("job_id", _ID, nullable=False),
        sa.Column("part", sa.String(64), nullable=False),
        sa.Column("owner_id", sa.String(64), nullable=False),
        sa.Column("key", sa.String(255), nullable=False),
        sa.Column("size", sa.BigInteger, nullable=False),
        sa.PrimaryKeyConstraint("job_id", "part", name="pk_job_files"),
        sa.ForeignKeyConstraint(["job_id"], ["jobs.id"], name="fk_job_files_job_id", ondelete="CASCADE"),
    )
    op.add_column("jobs", sa.Column("files", sa.JSON, nullable=False, server_default="{}"))
    for statement in (*_UPGRADE[op.get_bind().dialect.name], _UPGRADE_ORIGINS):
        op.execute(statement)
    op.create_index("ix_job_files_key", "job_files", ["key"])
    op.create_index("ix_job_files_owner_id_key_size", "job_files", ["owner_id", "key", "size"])
    for name in ("asset", "target", "origin"):
        op.drop_index(f"ix_jobs_{name}_key", "jobs")
    for column in ("asset_key", "asset", "target_key", "target", "origin_key"):
        op.drop_column("jobs", column)
