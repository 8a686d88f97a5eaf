"""The writes of workers: `record.leases`.

A worker renews its own row while it runs, and with it the lease of its job. It owns that job by the lease and by the
attempt number, which every write names.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import DeviceMemoryError, UnreadableJobError
from meshdeform.record import rows
from meshdeform.record.changes import JobChange, Row, changing, hold, stale, with_progress_event
from meshdeform.record.database import Database
from meshdeform.record.files import measure
from meshdeform.record.models import Artifact, CheckpointRef, EventType, Job, JobError, JobState, Progress
from meshdeform.record.schema import artifacts, checkpoints, events, jobs, workers
from meshdeform.record.turns import USUAL, Ids, Turns, choices, hold_claims, waits_longer
from meshdeform.requests.document import PARAMS_OF_KIND

_log = logging.getLogger(__name__)
_queued = jobs.c.state == JobState.QUEUED

_ALIVE_S = 30.0
"""Seconds without a renewal after which a worker counts as silent: three times the renewal interval."""
_KEPT_S = 86_400.0
_LONGEST_WAIT_S = 600.0
HANDED_OVER, HANDED_BACK, OUTAGE = "handed_over", "handed_back", "outage"
"""The reasons in the event of a job that its worker gives back: it makes room for another one, the worker stops, or the
store or the record was away for too long."""
_LEFT_S = 900.0
"""Seconds for which a worker leaves a job to others that may have what it lacks."""


@dataclass(frozen=True)
class WorkerIdentity:
    """A worker process: its id, unique among all processes, past and future, its queue and its device."""

    id: str
    queue: str
    device: str


class Leases:
    """Claims of queued jobs, and writes that are refused once the attempt no longer has the job.

    Jobs that only another version can read are left to its workers.
    Every method with an attempt raises `StaleAttemptError` if another attempt has the job or the job is over, and
    `NotFoundError` if it was deleted.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._served: str | None = None
        self._unreadable: set[str] = set()
        self._left: dict[str, float] = {}

    def claim_next(self, worker_id: str, lease_s: float, turns: Turns = USUAL) -> Job | None:
        """Claim a queued job of the highest priority; return None if there is none that this process may start.

        Owners with jobs of that priority take turns, each with its oldest job, so that a job waits for one job of every
        other owner and not for all that were queued before (`turns.choices`).
        """

        def next_one(readable: Ids) -> tuple[Ids, ...]:
            return choices(self._database, readable, turns, self._last_served())

        job = self._claim(next_one, worker_id, lease_s, turns)
        if job is not None:
            self._served = job.owner_id
        return job

    def hand_over(self, job: Job, turns: Turns) -> bool:
        """Return whether a running job is to be handed over to one that has waited; it is marked, so that no more are.

        It must then be released soon with `handed_over`.
        """
        waiting = waits_longer(self._database, self._readable(), turns, job)
        stays = sa.and_(rows.fenced(job.id, job.attempt), jobs.c.yielded_at.is_(None))
        mark = sa.update(jobs).where(stays, waiting.exists()).values(yielded_at=self._database.now())
        with self._database.write() as connection:
            return connection.execute(mark.returning(jobs.c.id)).first() is not None

    def fruitless(self, job: Job) -> int:
        """Return how often a job was handed over since its last checkpoint: all that it did in these turns is lost."""
        mine, after = events.c.job_id == job.id, events.alias("after")
        saved = sa.select(sa.func.max(after.c.seq)).where(
            after.c.job_id == job.id, after.c.type == EventType.CHECKPOINT
        )
        since = events.c.seq > sa.func.coalesce(saved.scalar_subquery(), 0)
        queued = sa.and_(events.c.type == EventType.QUEUED, events.c.data["reason"].as_string() == HANDED_OVER)
        with self._database.read() as connection:
            return connection.execute(sa.select(sa.func.count()).where(mine, since, queued)).scalar_one()

    def _last_served(self) -> Any:
        """Return the owner whom this process served last, else the one whom any worker did."""
        if self._served is not None:
            return self._served
        running = sa.select(jobs.c.owner_id).where(jobs.c.state == JobState.RUNNING)
        newest = running.order_by(jobs.c.started_at.desc()).limit(1).scalar_subquery()
        return sa.func.coalesce(newest, "")

    def _claim(
        self, choose: Callable[[Ids], tuple[Ids, ...]], worker_id: str, lease_s: float, turns: Turns
    ) -> Job | None:
        """Claim the first job of the first choice that has one, passing over jobs that only other versions can read."""
        while True:
            job = None
            try:
                with changing(self._database) as change:
                    hold_claims(self._database, change.connection, turns)
                    job = self._take(change, choose(self._readable()), worker_id, lease_s)
                    if job is not None:
                        _ = job.request
                    return job
            except UnreadableJobError as error:
                # The transaction is rolled back. Requests never change, so that each job is tried once.
                assert job is not None
                _log.warning("job %s is left to workers that can read it: %s", job.id, error.detail)
                self._unreadable.add(job.id)

    def _readable(self) -> Ids:
        """Return the query for the queued jobs that this process can read, as far as it knows."""
        query = sa.select(jobs.c.id).where(_queued, jobs.c.kind.in_(sorted(PARAMS_OF_KIND)))
        now = time.monotonic()
        self._left = {job_id: until for job_id, until in self._left.items() if until > now}
        left = sorted(self._unreadable.union(self._left))
        if not left:
            return query
        # One parameter, however many they are.
        ids = sa.literal(left, sa.JSON)
        members = sa.func.json_each(ids) if self._database.is_sqlite else sa.func.json_array_elements_text(ids)
        return query.where(jobs.c.id.not_in(sa.select(members.table_valued("value").c.value)))

    def _take(self, change: JobChange, choices: Sequence[Ids], worker_id: str, lease_s: float) -> Job | None:
        now = self._database.now()
        values = {
            "state": JobState.RUNNING,
            "attempt": jobs.c.attempt + 1,
            "worker_id": worker_id,
            "lease_expires_at": self._database.now(lease_s),
            "started_at": sa.func.coalesce(jobs.c.started_at, now),
            "claimed_at": now,
            "yielded_at": None,
            "retry_at": None,
            "error": None,
            "phase": "loading",
        }
        for choice in choices:
            free = choice.limit(1).with_for_update(skip_locked=True).scalar_subquery()
            if claimed := change.update(sa.and_(jobs.c.id == free, _queued), values, EventType.STARTED):
                break
        else:
            return None
        row = claimed[0]
        if row.attempt == 1:
            change.counters.observe("queue_wait_seconds", (row.started_at - row.created_at).total_seconds())
        return rows.job(row)

    def heartbeat(self, job_id: str, attempt: int, lease_s: float, *, worker: WorkerIdentity | None = None) -> JobState:
        """Renew the lease of a job and the row of its worker; return the job's state, which may be `canceling`."""
        renew = sa.update(jobs).where(rows.fenced(job_id, attempt))
        renew = renew.values(lease_expires_at=self._database.now(lease_s))
        with self._database.write() as connection:
            state = connection.execute(renew.returning(jobs.c.state)).scalar_one_or_none()
            if state is None:
                raise stale(connection, job_id, attempt)
            if worker is not None:
                self._renew(connection, worker)
        return JobState(state)

    def idle(self, worker: WorkerIdentity) -> None:
        """Renew the row of a worker without a job."""
        with self._database.write() as connection:
            self._renew(connection, worker)

    def _renew(self, connection: sa.Connection, worker: WorkerIdentity) -> None:
        now = self._database.now()
        insert = self._database.upsert(workers).values(
            id=worker.id, queue=worker.queue, device=worker.device, started_at=now, seen_at=now
        )
        connection.execute(
            insert.on_conflict_do_update(index_elements=["id"], set_={"seen_at": now, "device": worker.device})
        )

    def alive(self, queue: str) -> int:
        """Return the number of workers of a queue that have renewed their rows recently."""
        with self._database.read() as connection:
            return connection.execute(sa.select(self.alive_query(queue))).scalar_one()

    def alive_query(self, queue: str) -> sa.ScalarSelect[int]:
        """Return the query of `alive`, for use in a statement."""
        seen = sa.and_(workers.c.queue == queue, workers.c.seen_at > self._database.now(-_ALIVE_S))
        return sa.select(sa.func.count()).select_from(workers).where(seen).scalar_subquery()

    def save_progress(
        self, job_id: str, attempt: int, progress: Progress, *, as_event: bool = True, lease_s: float | None = None
    ) -> JobState:
        """Store progress, and write an event if `as_event`; return the job's state, which may be `canceling`.

        The fraction never decreases, even across attempts. With `lease_s`, the lease is renewed for so many seconds.
        `progress` says which stage runs; the attempt is the one given.
        """
        # The databases have no common function: SQLite has max(), PostgreSQL greatest().
        furthest = sa.case((jobs.c.fraction > progress.fraction, jobs.c.fraction), else_=progress.fraction)
        values = {
            "step": progress.step,
            "total_steps": progress.total_steps,
            "fraction": furthest,
            "phase": progress.phase,
            "losses": progress.losses,
            "eta_s": progress.eta_s,
        }
        if lease_s is not None:
            values["lease_expires_at"] = self._database.now(lease_s)
        if as_event and self._database.is_sqlite:

            def data(row: Row) -> dict[str, Any]:
                return rows.job(row).progress.model_dump(mode="json")

            return JobState(self._write(job_id, attempt, values, EventType.PROGRESS, data).state)
        # Workers do this most often, and so it is one statement.
        change = sa.update(jobs).where(rows.fenced(job_id, attempt)).values(version=jobs.c.version + 1, **values)
        statement = (
            with_progress_event(self._database, change, progress.model_copy(update={"attempt": attempt}))
            if as_event
            else change.returning(jobs.c.state)
        )
        with self._database.write() as connection:
            state = connection.execute(statement).scalar_one_or_none()
            if state is None:
                raise stale(connection, job_id, attempt)
        return JobState(state)

    def set_checkpoint(
        self,
        job_id: str,
        attempt: int,
        key: str,
        step: int,
        sha256: str,
        *,
        size: int = 0,
        mesh: Artifact | None = None,
        made_by: str | None = None,
    ) -> None:
        """Record a stored checkpoint and the mesh of that step. New progress: forget lost and failed attempts."""
        values = {
            "job_id": job_id,
            "attempt": attempt,
            "step": step,
            "key": key,
            "sha256": sha256,
            "size": size,
            "mesh_key": mesh.key if mesh else None,
            "mesh_sha256": mesh.sha256 if mesh else None,
            "mesh_size": mesh.size if mesh else None,
            "created_at": self._database.now(),
            "made_by": made_by,
        }
        insert = self._database.upsert(checkpoints).values(values)
        insert = insert.on_conflict_do_update(index_elements=["job_id", "attempt", "step"], set_=values)
        with changing(self._database) as change:
            where = rows.fenced(job_id, attempt)
            changed = change.update(where, {}, EventType.CHECKPOINT, {"step": step})
            if not changed:
                raise stale(change.connection, job_id, attempt)
            change.connection.execute(insert)
            measure(change.connection, job_id)
            unlucky = changed[0].lost_attempts or changed[0].failures
            if unlucky and not self._reached_before(change.connection, job_id, attempt, step):
                fresh = sa.update(jobs).where(jobs.c.id == job_id).values(lost_attempts=0, failures=0)
                change.connection.execute(fresh)

    def _reached_before(self, connection: sa.Connection, job_id: str, attempt: int, step: int) -> bool:
        """Return whether an earlier attempt stored a checkpoint of this step or a later one, deleted or not."""
        earlier = sa.and_(events.c.job_id == job_id, events.c.attempt < attempt, events.c.type == EventType.CHECKPOINT)
        reached = sa.select(sa.func.max(events.c.data["step"].as_integer())).where(earlier)
        return (connection.execute(reached).scalar() or 0) >= step

    def forget_checkpoint(self, job_id: str, attempt: int, key: str) -> None:
        """Remove a checkpoint from the record, so that its objects can be deleted."""
        with self._database.write() as connection:
            hold(connection, job_id, attempt)
            connection.execute(sa.delete(checkpoints).where(checkpoints.c.job_id == job_id, checkpoints.c.key == key))
            measure(connection, job_id)

    def checkpoints(self, job_id: str) -> list[CheckpointRef]:
        """Return the checkpoints of all attempts, newest first."""
        query = (
            sa.select(checkpoints)
            .where(checkpoints.c.job_id == job_id)
            .order_by(checkpoints.c.attempt.desc(), checkpoints.c.step.desc())
        )
        with self._database.read() as connection:
            return [rows.read(CheckpointRef, row) for row in connection.execute(query)]

    def finish(
        self,
        job_id: str,
        attempt: int,
        state: JobState,
        error: JobError | None = None,
        *,
        results: Sequence[Artifact] = (),
        step_s: float | None = None,
        made_by: str | None = None,
    ) -> JobState:
        """End the job permanently (`succeeded`, `failed`, `canceled` or `expired`), and return its final state.

        A cancellation recorded before wins over success, because it has already been confirmed to the user. The results
        are published in the same transaction, and only if the job succeeds. `step_s` is the mean of seconds per step,
        `made_by` the versions that computed the results.
        """
        if not state.terminal:
            raise ValueError(f"{state} is not terminal")
        cancel_requested = jobs.c.state == JobState.CANCELING
        may_lose = state is JobState.SUCCEEDED
        values = {
            **released(self._database),
            **ended(self._database, sa.case((cancel_requested, JobState.CANCELED), else_=state) if may_lose else state),
            "fraction": sa.case((cancel_requested, jobs.c.fraction), else_=1.0) if may_lose else jobs.c.fraction,
            "error": error.model_dump() if error else None,
            "step_s": step_s,
            "made_by": made_by,
        }

        def data(row: Row) -> dict[str, Any]:
            if row.state == JobState.SUCCEEDED:
                return {"artifacts": sorted(result.name for result in results)}
            return {"error": row.error} if row.error else {}

        with changing(self._database) as change:
            changed = change.update(rows.fenced(job_id, attempt), values, lambda row: EventType(row.state), data)
            if not changed:
                raise stale(change.connection, job_id, attempt)
            if changed[0].state == JobState.SUCCEEDED:
                self._publish(change, job_id, attempt, results)
                change.usage.add(changed[0].owner_id, size=sum(result.size for result in results))
            if step_s:
                change.counters.observe("step_seconds", step_s)
        return JobState(changed[0].state)

    def _publish(self, change: JobChange, job_id: str, attempt: int, results: Sequence[Artifact]) -> None:
        names = [result.name for result in results]
        shown = sa.and_(artifacts.c.job_id == job_id, artifacts.c.name.in_(names))
        change.connection.execute(sa.delete(artifacts).where(shown))
        for result in results:
            values = {**result.model_dump(), "job_id": job_id, "attempt": attempt}
            change.connection.execute(sa.insert(artifacts).values(values))
        measure(change.connection, job_id)

    def release(self, job_id: str, attempt: int, reason: str = HANDED_BACK) -> None:
        """Hand a job back to the queue, with its checkpoints; cancel it if a cancellation was requested.

        If it is handed over, it makes room for others (`hand_over`), and waits as if it had been queued now.
        """
        over = reason == HANDED_OVER
        values = {"yielded_at": self._database.now()} if over else {}
        counter = "hand_overs" if over else ""
        self._write(job_id, attempt, self._back(values), _queued_or_canceled, _why(reason), counter=counter)

    def leave_to_others(self, job_id: str) -> None:
        """Let this process take a job no more for a while, longer than others wait before they try it again."""
        self._left[job_id] = time.monotonic() + _LEFT_S

    def out_of_memory(self, job_id: str, attempt: int, max_attempts: int) -> JobState:
        """Hand back a job that ran out of device memory; after `max_attempts` such attempts it fails (`gpu_oom`)."""
        error = DeviceMemoryError(f"The device ran out of memory in {max_attempts} attempts.")
        with changing(self._database) as change:
            where = rows.fenced(job_id, attempt)
            last = sa.and_(jobs.c.state == JobState.RUNNING, jobs.c.oom_attempts + 1 >= max_attempts)
            over = {
                **released(self._database),
                **ended(self._database, JobState.FAILED, JobError.of(error)),
                "oom_attempts": jobs.c.oom_attempts + 1,
            }
            changed = change.update(sa.and_(where, last), over, EventType.FAILED, lambda row: {"error": row.error})
            if not changed:
                back = self._back({"oom_attempts": jobs.c.oom_attempts + 1})
                changed = change.update(where, back, _queued_or_canceled, _why("out_of_memory"))
            if not changed:
                raise stale(change.connection, job_id, attempt)
        return JobState(changed[0].state)

    def postpone(self, job_id: str, attempt: int, error: JobError, max_attempts: int, delay_s: float) -> JobState:
        """Hand back a job after a failure that may pass; after `max_attempts` in a row it fails with that error.

        It is tried again after `delay_s` seconds, four times as many after each further failure, at most ten minutes.
        """
        with changing(self._database) as change:
            where = rows.fenced(job_id, attempt)
            before = change.connection.scalar(sa.select(jobs.c.failures).where(where).with_for_update())
            if before is None:
                raise stale(change.connection, job_id, attempt)
            document = error.model_dump()
            if before + 1 >= max_attempts:
                over = {**released(self._database), **ended(self._database, JobState.FAILED, error)}
                over["failures"] = before + 1
                running = sa.and_(where, jobs.c.state == JobState.RUNNING)
                if changed := change.update(running, over, EventType.FAILED, {"error": document}):
                    return JobState(changed[0].state)
            cancel_requested = jobs.c.state == JobState.CANCELING
            wait_s = min(delay_s * 4.0**before, _LONGEST_WAIT_S)
            back = {
                "failures": before + 1,
                "error": sa.case((cancel_requested, None), else_=sa.literal(document, jobs.c.error.type)),
                "retry_at": self._database.now(wait_s),
            }

            def why(row: Row) -> dict[str, Any]:
                if row.state != JobState.QUEUED:
                    return {}
                return {"reason": "failure", "error": document, "retry_at": row.retry_at.isoformat()}

            changed = change.update(where, self._back(back), _queued_or_canceled, why)
        return JobState(changed[0].state)

    def worker_ended(self, worker_id: str) -> bool:
        """Remove a dead worker and end the lease that it holds; return whether it held one.

        The job is then taken back like that of any silent worker (`Upkeep.reclaim_expired`), but without the wait.
        Rows of workers that have been silent for a day are removed too.
        """
        held = sa.and_(jobs.c.worker_id == worker_id, jobs.c.state.in_(rows.OWNED))
        # Without `worker_id` a heartbeat still in flight cannot renew the lease. One second in the past is expired at
        # any clock's resolution.
        change = sa.update(jobs).where(held).values(worker_id=None, lease_expires_at=self._database.now(-1.0))
        silent = sa.or_(workers.c.id == worker_id, workers.c.seen_at < self._database.now(-_KEPT_S))
        with self._database.write() as connection:
            # Lock the job first, as `heartbeat` does, so that the two cannot deadlock.
            held_one = connection.execute(change.returning(jobs.c.id)).first() is not None
            connection.execute(sa.delete(workers).where(silent))
        return held_one

    def _back(self, more: dict[str, Any]) -> dict[str, Any]:
        cancel_requested = jobs.c.state == JobState.CANCELING
        return {
            **released(self._database),
            "state": sa.case((cancel_requested, JobState.CANCELED), else_=JobState.QUEUED),
            "finished_at": sa.case((cancel_requested, self._database.now()), else_=None),
            "phase": sa.case((cancel_requested, "done"), else_="queued"),
            **more,
        }

    def _write(
        self, job_id: str, attempt: int, values: dict[str, Any], happened: Any, data: Any, *, counter: str = ""
    ) -> Row:
        with changing(self._database) as change:
            changed = change.update(rows.fenced(job_id, attempt), values, happened, data)
            if not changed:
                raise stale(change.connection, job_id, attempt)
            if counter:
                change.counters.add(counter)
        return changed[0]


def released(database: Database, until: Any = None) -> dict[str, Any]:
    """Return the values of a job that its worker no longer has; `until` is when it last had it, by default now."""
    ran_s = database.seconds(jobs.c.claimed_at, database.now() if until is None else until)
    # An earlier version that claims it next does not say when.
    more = {"ran_s": jobs.c.ran_s + ran_s, "claimed_at": None}
    return {"worker_id": None, "lease_expires_at": None, "eta_s": None, **more}


def ended(database: Database, state: Any, error: JobError | None = None) -> dict[str, Any]:
    """Return the values of a job that is over, in a state, with the error that ended it if it failed."""
    document = {} if error is None else {"error": error.model_dump()}
    return {"state": state, "finished_at": database.now(), "phase": "done", **document}


def _why(reason: str) -> Callable[[Row], dict[str, Any]]:
    return lambda row: {"reason": reason} if row.state == JobState.QUEUED else {}


def _queued_or_canceled(row: Row) -> EventType:
    return EventType(row.state)
