"""Compare the record with leases and Redis, and repair differences, so that no accepted job is lost.

One process is elected for this, as it need be done only once: each process is a candidate, and the leader holds a term.
The term is a row of the record, renewed as long as its holder lives. Nothing depends on there being only one leader:
one that was paused may still do its work while the next one does.

The others look at the row now and then. The more candidates there are, the less often each looks, so that all of them
together ask the record about as often as twenty do.

The reconciler also removes from the object store what the record no longer refers to.
"""

from __future__ import annotations

import logging
import random
import secrets
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from datetime import datetime
from types import TracebackType
from typing import Any, Self

import sqlalchemy as sa

from meshdeform.errors import MeshdeformError, NotFoundError
from meshdeform.record.columns import UtcDateTime
from meshdeform.record.database import Database
from meshdeform.record.queue import JobQueue
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import leaders
from meshdeform.record.upkeep import Watch
from meshdeform.storage import ObjectStore
from meshdeform.storage.readings import remove_old_readings
from meshdeform.support.failpoints import failpoint

_LOOKS_PER_S = 4.0
"""Looks of all followers together."""

_LONGEST_S = 60.0
"""Longest pause of a follower: how long nobody leads if nearly all candidates end at once."""

_JITTER = 0.25
_log = logging.getLogger(__name__)
RECONCILE_EVERY_S = 5.0
_READINGS_EVERY_S = 3600.0
"""Seconds between two looks at kept readings, which lists them all."""
_LONGEST_ROUNDS = 12
"""Rounds after which a lost message is repeated at the latest."""
_ENOUGH = 2_000
"""Messages that all workers together do not read between two runs."""
_RECHECK_S = (0.1, 0.5)
"""Seconds before missing messages are counted again: much longer than a worker takes from its message to its claim."""


def remove_unreachable(record: JobRecord, store: ObjectStore) -> None:
    """Remove from the store what the record no longer refers to. Safe to interrupt, repeat, and run concurrently.

    If the record or the store does not answer (`UnavailableError`), the remaining work stays recorded.
    """
    for prefix in record.upkeep.discarded_prefixes():
        _remove_prefix(record, store, prefix)
    for upload_id in record.upkeep.expired_uploads():
        remove_upload(store, upload_id)
        with suppress(NotFoundError):
            record.uploads.delete(upload_id)
    for key in record.files.unused():
        record.files.remove_unused(key, store.delete)


def remove_job(record: JobRecord, store: ObjectStore, job_id: str, files: Iterable[str]) -> None:
    """Remove the objects of one deleted job, and nothing else, so that the duration depends on no other job.

    `files` are the keys that `JobRecord.delete` returned; files in use elsewhere stay. If the record or the store does
    not answer (`UnavailableError`), `remove_unreachable` does the rest.
    """
    _remove_prefix(record, store, f"jobs/{job_id}/")
    for key in files:
        record.files.remove_unused(key, store.delete)


def remove_upload(store: ObjectStore, upload_id: str) -> None:
    """Remove the received bytes of an upload; the file stored from a complete upload is not affected."""
    if store.appends:
        store.discard_append(upload_id)
    store.delete_prefix(f"uploads/{upload_id}/")


def _remove_prefix(record: JobRecord, store: ObjectStore, prefix: str) -> None:
    store.delete_prefix(prefix)
    record.upkeep.forget_discarded(prefix)


class LeaderCandidate:
    """One process in one election.

    `name`: the election: its candidates do the same work. `every_s`: seconds between two looks of the leader, and at
    least between two of a follower. A term lasts twice as long. `crowd`: a query for the number of candidates, sent by
    the leader only. Default: there are few. `leads`: whether the newest look found or made this process the leader;
    `took_over`: whether that look made it the leader. `watched`: after taking over: the last look of the former leader,
    and since when both it and this process watched the leases, its process by looking at the term. None if the former
    leader tells nothing about this process's life.
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

        `since` is when the leader began to watch the leases without a gap (`Watch.since`), for its successor.
        """
        watched = None
        if not self.leads:
            lease = self._read()
            if lease is not None and lease.held and lease.holder != self._holder:
                self._candidates, self.took_over = lease.candidates, False
                return False
            if lease is not None and lease.watching_since is not None and self._first_look is not None:
                # The leader vouches for the time between two looks of this process, and for no time before the first.
                watched = (lease.looked_at, max(lease.watching_since, self._first_look))
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
        with self._database.write() as connection:
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
            row = connection.execute(query.where(leaders.c.name == self.name)).one_or_none()
        if row is not None and self._first_look is None:
            self._first_look = row.now
        return row

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
        with self._database.write() as connection:
            row = connection.execute(insert.returning(leaders.c.candidates)).one_or_none()
        if row is not None:
            self._candidates = row.candidates
        return row is not None


class Reconciler:
    """A periodic task that takes back jobs of silent workers, repeats lost messages, and removes expired data.

    Any number may run at once: every change is guarded by the state that it starts from, and a job announced twice is
    claimed once. As context managers they elect a leader, which does the work; the others only look whether it lives.
    `max_attempts`: number of lost workers after which a job fails. `lease_s`: duration of a lease. A lease that ends
    much later was given before the clock was set back, and is shortened. `store`: if given, expired jobs and requests
    are deleted, and unreachable objects are removed from it. `every_s`: seconds between two runs as a context manager.
    Default: 5, or a sixth of a shorter lease.
    """

    def __init__(
        self,
        record: JobRecord,
        queue: JobQueue,
        max_attempts: int,
        lease_s: float,
        *,
        store: ObjectStore | None = None,
        max_running: int = 0,
        every_s: float | None = None,
    ) -> None:
        self._record, self._queue, self._max_attempts, self._lease_s = record, queue, max_attempts, lease_s
        self._store, self._max_running = store, max_running
        self._every_s = min(RECONCILE_EVERY_S, lease_s / 6) if every_s is None else every_s
        self._watch = Watch(lease_s, self._every_s)
        self._announced: list[str] = []
        self._repeated: dict[str, tuple[int, int]] = {}
        self._round = 0
        self._readings_looked_at: float | None = None
        self._done = threading.Event()
        workers = record.leases.alive_query(queue.name)
        self._repairing = LeaderCandidate(record.database, f"repair {queue.name}", self._every_s, workers)
        self._cleaning = LeaderCandidate(record.database, "cleanup", self._every_s)
        elections = {"reconciler": (self._repairing, self._repair)}
        if store is not None:
            # On its own, so that a slow store does not delay the recovery of jobs.
            elections["cleanup"] = (self._cleaning, self._clean)
        self._threads = [
            threading.Thread(target=self._run, args=election, name=name, daemon=True)
            for name, election in elections.items()
        ]

    def run_once(self) -> list[str]:
        """Run all tasks once, and return the jobs announced to Redis. If one fails, the next run does the rest."""
        self._repair()
        if self._store is not None:
            self._clean()
        return self._announced

    def _repair(self) -> None:
        self._announced = []
        fail = self._record.upkeep.fail_retired, self._record.fetching.fail_abandoned
        self._each(self._take_back, self._expire, *fail, self._announce)

    def _clean(self) -> None:
        self._each(self._delete, self._remove, self._forget_readings)

    def _each(self, *duties: Callable[[], None]) -> None:
        for duty in duties:
            try:
                duty()
            except MeshdeformError as error:
                _log.warning("the reconciler will retry: %s", error)
            except Exception:
                # Without this thread no jobs are taken back from dead workers: it must survive any error.
                _log.exception("unexpected error in the reconciler")

    def _take_back(self) -> None:
        if cut := self._record.upkeep.shorten_leases(self._lease_s):
            _log.warning("%d leases were given before the clock was set back; they are shortened", cut)
        self._watch.look(self._record.upkeep.clock())
        for job_id in self._record.upkeep.reclaim_expired(self._max_attempts, self._watch):
            _log.warning("job %s: its worker is silent; it is queued again", job_id)
            failpoint("reconciler.reclaimed")

    def _expire(self) -> None:
        for job_id in self._record.upkeep.expire_deadlines():
            _log.info("job %s: its deadline has passed", job_id)
            # The worker's next write is refused; with this message it stops at once.
            self._queue.publish_cancel(job_id)

    def _announce(self) -> None:
        """Ensure that Redis has a message for every queued job that may start, or as many as last until the next run.

        Workers claim the next job, whichever message they read. So as long as there are enough messages, no job is
        forgotten, and they need not be compared one by one.
        """
        if self._missing() > 0:
            # A worker between reading its message and its claim looks the same, as does a job whose request is just
            # announcing it. Other reconcilers see it too: at different moments, so that one of them announces the jobs.
            self._done.wait(random.uniform(*_RECHECK_S))  # noqa: S311 - no secret
            self._announce_missing(self._missing())

    def _missing(self) -> int:
        """Return how many messages there are too few."""
        return self._record.upkeep.queued_count(_ENOUGH, self._max_running) - self._queue.length()

    def _announce_missing(self, count: int) -> None:
        """Repeat so many lost messages; ever less often those of a job that nobody claims, which no worker can read."""
        self._round += 1
        if count <= 0:
            return
        announced = self._queue.announced()
        first = self._record.upkeep.queued_ids(2 * _ENOUGH, self._max_running)
        lost = [each for each in first if each not in announced]
        repeated = self._repeated = {each: self._repeated.get(each, (0, 0)) for each in lost}
        due = [each for each in lost if repeated[each][1] <= self._round]
        for job_id in due[: max(0, count - (len(lost) - len(due)))]:
            self._queue.enqueue(job_id)
            self._announced.append(job_id)
            times = repeated[job_id][0]
            repeated[job_id] = (times + 1, self._round + min(2**times, _LONGEST_ROUNDS))
            failpoint("reconciler.told")

    def _delete(self) -> None:
        if deleted := self._record.upkeep.delete_retained():
            _log.info("%d jobs are past their retention and deleted", len(deleted))
        self._record.upkeep.delete_stale_requests()

    def _remove(self) -> None:
        if self._store is not None:
            remove_unreachable(self._record, self._store)

    def _forget_readings(self) -> None:
        now = time.monotonic()
        due = self._readings_looked_at is None or now >= self._readings_looked_at + _READINGS_EVERY_S
        if self._store is not None and due:
            remove_old_readings(self._store)
            self._readings_looked_at = now

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        for thread in self._threads:
            thread.join()

    def _run(self, candidate: LeaderCandidate, duties: Callable[[], None]) -> None:
        while not self._done.is_set():
            self._turn(candidate, duties)
            self._done.wait(candidate.pause_s())
        if candidate.leads:
            self._each(candidate.resign)

    def _turn(self, candidate: LeaderCandidate, duties: Callable[[], None]) -> None:
        self._each(lambda: self._look(candidate))
        if candidate.leads:
            duties()
        else:
            self._record.database.let_go()

    def _look(self, candidate: LeaderCandidate) -> None:
        watching = candidate is self._repairing
        candidate.look(self._watch.since if watching else None)
        if candidate.took_over:
            _log.info("this process now leads: %s", candidate.name)
            if watching:
                # The former leader's sightings count for as long as this process lived too.
                self._watch.now, self._watch.since = candidate.watched or (None, None)
