"""Count the bytes that an owner's jobs keep in the object store, and hold new jobs to a limit."""

from __future__ import annotations

from collections.abc import Mapping

import sqlalchemy as sa

from meshdeform.errors import TooMuchStoredError
from meshdeform.record.schema import artifacts, checkpoints, job_files, jobs

__all__ = ["check_room", "measure"]

_RETRY_AFTER_S = 3600


def measure(connection: sa.Connection, job_id: str) -> None:
    """Update the bytes of a job's artifacts and checkpoints in its row, after any of them has changed."""
    results = sa.select(_total(artifacts.c.size)).where(artifacts.c.job_id == job_id).scalar_subquery()
    size = checkpoints.c.size + sa.func.coalesce(checkpoints.c.mesh_size, 0)
    saved = sa.select(_total(size)).where(checkpoints.c.job_id == job_id).scalar_subquery()
    connection.execute(sa.update(jobs).where(jobs.c.id == job_id).values(stored_bytes=results + saved))


def check_room(connection: sa.Connection, owner_id: str, files: Mapping[str, int], limit: int) -> None:
    """Refuse a job if its owner would keep more bytes than allowed.

    A file that several jobs of the owner use counts once. Every number comes from an index.

    Parameters
    ----------
    connection : Connection
    owner_id : str
    files : mapping of str to int
        Sizes of the job's stored files in bytes, by key.
    limit : int
        0: unlimited.

    Raises
    ------
    TooMuchStoredError
        There is no room for the job.
    """
    if not limit:
        return
    mine = job_files.c.owner_id == owner_id
    each = sa.select(sa.func.max(job_files.c.size).label("size")).where(mine).group_by(job_files.c.key).subquery()
    inputs = sa.select(_total(each.c.size)).scalar_subquery()
    outputs = sa.select(_total(jobs.c.stored_bytes)).where(jobs.c.owner_id == owner_id).scalar_subquery()
    stored = int(connection.execute(sa.select(inputs + outputs)).scalar_one())
    known = set(connection.scalars(sa.select(job_files.c.key).where(mine, job_files.c.key.in_(sorted(files)))))
    added = sum(size for key, size in files.items() if key not in known)
    if stored >= limit or stored + added > limit:
        raise TooMuchStoredError(
            f"The jobs of this owner keep {stored} bytes, and this one would add {added}; the limit is {limit}.",
            limit=limit,
            stored=stored,
            retry_after_s=_RETRY_AFTER_S,
        )


def _total(size: sa.ColumnElement[int]) -> sa.ColumnElement[int]:
    return sa.func.coalesce(sa.func.sum(size), 0)
