"""Elect one process for work that need be done only once: each process is a candidate, and the leader holds a term.

The term is a row of the record, renewed as long as its holder lives. Nothing depends on there being only one leader:
one that was paused may still do its work while the next one does.

The others look at the row now and then. The more candidates there are, the less often each looks, so that all of them
together ask the record about as often as twenty do.
"""

from __future__ import annotations

import random
import secrets
from datetime import datetime
from typing import Any

import sqlalchemy as sa

from meshdeform.record.database import Database
from meshdeform.record.schema import UtcDateTime, leaders

__all__ = ["Candidate"]

_LOOKS_PER_S = 4.0
"""Looks of all followers together."""
_LONGEST_S = 60.0
"""Longest pause of a follower: how long nobody leads if nearly all candidates end at once."""
_JITTER = 0.25


class Candidate:
    """One process in one election.

    Parameters
    ----------
    database : Database
    name : str
        The election: its candidates do the same work.
    every_s : float
        Seconds between two looks of the leader, and at least between two of a follower. A term lasts twice as long.
    crowd : select, optional
        A query for the number of candidates, sent by the leader only. Default: there are few.

    Attributes
    ----------
    name : str
    leads : bool
        Whether the newest look found or made this process the leader.
    took_over : bool
        Whether that look made it the leader.
    watched : tuple of datetime, optional
        After taking over: the last look of the former leader, and since when both it and this process watched the
        leases, its process by looking at the term. None if the former leader tells nothing about this process's life.
    """

    def __init__(
        self, database: Database, name: str, every_s: float, crowd: sa.ScalarSelect[Any] | None = None
    ) -> None:
        self._database, self.name, self._every_s = database, name, every_s
        self._crowd: Any = sa.literal(1) if crowd is None else crowd
        self._holder = secrets.token_hex(8)
        self._candidates = 1
        self._first_look: datetime | None = None
        self.leads = self.took_over = False
        self.watched: tuple[datetime, datetime] | None = None

    def look(self, since: datetime | None = None) -> bool:
        """Renew the term, take over one that has expired, or see that another process leads; return whether this leads.

        Parameters
        ----------
        since : datetime, optional
            Since when the leader has watched the leases without a gap (`Watch.since`), for its successor.

        Raises
        ------
        UnavailableError
            The record does not answer.
        """
        watched = None
        if not self.leads:
            found = self._read()
            if found is not None and found.held and found.holder != self._holder:
                self._candidates, self.took_over = found.candidates, False
                return False
            if found is not None and found.watching_since is not None and self._first_look is not None:
                # The leader vouches for the time between two looks of this process, and for no time before the first.
                watched = (found.looked_at, max(found.watching_since, self._first_look))
        leads = self._write(since)
        self.leads, self.took_over, self.watched = leads, leads and not self.leads, watched
        return leads

    def pause_s(self) -> float:
        """Return the seconds until the next look."""
        if self.leads:
            return self._every_s
        pause_s = max(self._every_s, min(self._candidates / _LOOKS_PER_S, _LONGEST_S))
        return pause_s * random.uniform(1.0 - _JITTER, 1.0 + _JITTER)  # noqa: S311 - no secret

    def resign(self) -> None:
        """End the term, so that the next look of another process takes over."""
        mine = sa.and_(leaders.c.name == self.name, leaders.c.holder == self._holder)
        over = sa.update(leaders).where(mine).values(expires_at=self._database.now(-1.0))
        with self._database.write_once() as connection:
            connection.execute(over)
        self.leads = False

    def _held(self) -> sa.ColumnElement[bool]:
        # A term that ends later than any that could be granted now comes from a clock that has been set back.
        return leaders.c.expires_at.between(self._database.now(), self._database.now(4 * self._every_s))

    def _read(self) -> sa.Row[Any] | None:
        now = self._database.now()
        clock = now if isinstance(now, sa.ColumnElement) else sa.literal(now, UtcDateTime())
        query = sa.select(leaders, self._held().label("held"), clock.label("now"))
        with self._database.read() as connection:
            found = connection.execute(query.where(leaders.c.name == self.name)).one_or_none()
        if found is not None and self._first_look is None:
            self._first_look = found.now
        return found

    def _write(self, since: datetime | None) -> bool:
        now = self._database.now()
        values = {
            "name": self.name,
            "holder": self._holder,
            "expires_at": self._database.now(2 * self._every_s),
            "looked_at": now,
            "watching_since": since,
            "candidates": self._crowd,
        }
        mine = sa.or_(leaders.c.holder == self._holder, ~self._held())
        insert = self._database.upsert(leaders).values(values)
        insert = insert.on_conflict_do_update(index_elements=["name"], set_=values, where=mine)
        with self._database.write_once() as connection:
            row = connection.execute(insert.returning(leaders.c.candidates)).one_or_none()
        if row is not None:
            self._candidates = row.candidates
        return row is not None
