"""Which uploaded files are in use: the same bytes are stored once, and removed with the last job that needs them.

A request pins its file before it stores it, and the job's row, when it commits, takes the pin's place. So between a
look and a removal no request can slip in that counts on the bytes being there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import sqlalchemy as sa

from meshdeform.jobs.database import Database
from meshdeform.jobs.tables import files, jobs

__all__ = ["FileLedger"]

_PIN_LASTS_S = 3600.0
"""A pin that is older belongs to a request whose process died."""


class FileLedger:
    """Pins and references of stored files, by key."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def pin(self, key: str) -> None:
        """Keep the file: a job that needs it is about to be made. Waits while it is just being removed."""
        now = self._database.now()
        insert = self._database.upsert(files).values(key=key, pins=1, touched_at=now)
        insert = insert.on_conflict_do_update(
            index_elements=["key"], set_={"pins": files.c.pins + 1, "touched_at": now}
        )
        with self._database.write() as connection:
            connection.execute(insert)

    def unpin(self, keys: Iterable[str], connection: sa.Connection | None = None) -> None:
        """Give the pins back, within a transaction if there is one. A file that nobody pinned is entered."""
        if connection is None:
            with self._database.write() as own:
                return self.unpin(keys, own)
        now = self._database.now()
        for key in keys:
            insert = self._database.upsert(files).values(key=key, pins=0, touched_at=now)
            fewer = sa.case((files.c.pins > 0, files.c.pins - 1), else_=0)
            connection.execute(
                insert.on_conflict_do_update(index_elements=["key"], set_={"pins": fewer, "touched_at": now})
            )
        return None

    def unused(self) -> list[str]:
        """Return the files that no job and no request needs."""
        with self._database.read() as connection:
            return list(connection.execute(sa.select(files.c.key).where(self._is_unused())).scalars())

    def remove_unused(self, key: str, remove: Callable[[str], None]) -> bool:
        """Call `remove` if nobody needs the file, while nobody can begin to.

        Returns
        -------
        bool
            Whether it was removed.
        """
        with self._database.write() as connection:
            # First the lock on the row, then the look: another transaction may just have committed.
            held = sa.select(files.c.key).where(files.c.key == key).with_for_update()
            if connection.execute(held).first() is None:
                return False
            unused = sa.select(files.c.key).where(files.c.key == key, self._is_unused())
            if connection.execute(unused).first() is None:
                return False
            remove(key)
            connection.execute(sa.delete(files).where(files.c.key == key))
        return True

    def _is_unused(self) -> sa.ColumnElement[bool]:
        needed = sa.or_(
            sa.exists().where(jobs.c.asset_key == files.c.key), sa.exists().where(jobs.c.target_key == files.c.key)
        )
        unpinned = sa.or_(files.c.pins == 0, files.c.touched_at < self._database.now(-_PIN_LASTS_S))
        return sa.and_(unpinned, sa.not_(needed))
