"""The record of all jobs, in SQL: what it says is true, whatever Redis, a worker or the API believes.

A worker owns a job by a lease. `claim` gives the job a new attempt number, every later write of that worker carries it
in its WHERE clause, and a write for an attempt that is no longer the job's changes nothing.
"""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from meshdeform.config import JobRequest
from meshdeform.errors import ConflictError, NotFoundError, StaleAttemptError, WorkerLostError
from meshdeform.jobs import rows
from meshdeform.jobs.cursors import decode_cursor, encode_cursor
from meshdeform.jobs.database import Database
from meshdeform.jobs.files import FileLedger
from meshdeform.jobs.ids import new_job_id
from meshdeform.jobs.models import (
    TERMINAL_STATES,
    Artifact,
    CheckpointRef,
    Job,
    JobError,
    JobState,
    Page,
    Progress,
    StoredFile,
)
from meshdeform.jobs.tables import artifacts, checkpoints, discarded, jobs

__all__ = ["JobRecord"]

_RELEASED: dict[str, Any] = {"worker_id": None, "lease_expires_at": None, "eta_s": None}


class JobRecord:
    """Every job, from 202 to its deletion. Safe to share between threads.

    Parameters
    ----------
    url : str
        The database; its tables are made and migrated here.

    Attributes
    ----------
    files : FileLedger
        Which stored files are in use.

    Raises
    ------
    UnavailableError
        From here and from every method: the database does not answer.
    """

    def __init__(self, url: str) -> None:
        self._database = Database(url)
        self.files = FileLedger(self._database)

    def close(self) -> None:
        """Close every connection."""
        self._database.close()

    def ping(self) -> None:
        """Return when the database answers."""
        with self._database.read() as connection:
            connection.execute(sa.select(jobs.c.id).limit(1))

    # What users do

    def create(self, request: JobRequest, asset: StoredFile, target: StoredFile | None = None) -> Job:
        """Record a new job, queued. Its files must be stored by now; their pins, if any, become references."""
        job_id = new_job_id()
        values = rows.new_job(job_id, request, asset, target, self._database.now())
        with self._database.write() as connection:
            self.files.unpin(sorted({file.key for file in (asset, target) if file}), connection)
            row = connection.execute(sa.insert(jobs).values(values).returning(jobs)).one()
        return rows.job(row)

    def get(self, job_id: str) -> Job:
        """Return a job.

        Raises
        ------
        NotFoundError
            There is none of this id.
        """
        with self._database.read() as connection:
            return _get(connection, job_id)

    def list_jobs(self, state: JobState | None = None, cursor: str | None = None, limit: int = 50) -> Page:
        """Return a page of jobs, newest first.

        Parameters
        ----------
        state : JobState, optional
            Only jobs in this state.
        cursor : str, optional
            `next_cursor` of the page before.
        limit : int
            Length of the page.

        Raises
        ------
        ParameterError
            The cursor is not one of ours.
        """
        query = sa.select(jobs).order_by(jobs.c.id.desc()).limit(limit + 1)
        if state is not None:
            query = query.where(jobs.c.state == state)
        if cursor is not None:
            query = query.where(jobs.c.id < decode_cursor(cursor))
        with self._database.read() as connection:
            found = [rows.job(row) for row in connection.execute(query)]
        more = len(found) > limit
        return Page(found[:limit], encode_cursor(found[limit - 1].id) if more else None)

    def request_cancel(self, job_id: str) -> Job:
        """Cancel a queued job at once; ask the worker of a running one to stop. Asking twice is no error.

        Raises
        ------
        NotFoundError, ConflictError
            There is no such job, or it is over.
        """
        queued = jobs.c.state == JobState.QUEUED
        change = (
            sa.update(jobs)
            .where(jobs.c.id == job_id, jobs.c.state.in_([JobState.QUEUED, JobState.RUNNING]))
            .values(
                state=sa.case((queued, JobState.CANCELED), else_=JobState.CANCELING),
                finished_at=sa.case((queued, self._database.now()), else_=None),
                phase=sa.case((queued, "done"), else_=jobs.c.phase),
                version=jobs.c.version + 1,
            )
        )
        with self._database.write() as connection:
            if row := connection.execute(change.returning(jobs)).one_or_none():
                return rows.job(row)
            job = _get(connection, job_id)
        if job.state.terminal:
            raise ConflictError(f"The job is {job.state} and cannot be canceled any more.", state=job.state.value)
        return job

    def delete(self, job_id: str) -> None:
        """Forget a job that is over. Its objects are due for removal from now on (`cleanup.py`).

        Raises
        ------
        NotFoundError, ConflictError
            There is no such job, or it is not over.
        """
        with self._database.write() as connection:
            found = connection.execute(
                sa.delete(jobs).where(jobs.c.id == job_id, jobs.c.state.in_(TERMINAL_STATES)).returning(jobs.c.id)
            ).one_or_none()
            if found is None:
                job = _get(connection, job_id)
                raise ConflictError(
                    f"The job is {job.state}; only a job that is over can be deleted.",
                    advice="Cancel it first, and delete it once it is canceled.",
                    state=job.state.value,
                )
            connection.execute(sa.insert(discarded).values(prefix=f"jobs/{job_id}/"))

    def artifacts(self, job_id: str) -> list[Artifact]:
        """Return the results of the job's present attempt, by name.

        Raises
        ------
        NotFoundError
            There is no such job.
        """
        query = (
            sa.select(artifacts)
            .join(jobs, sa.and_(jobs.c.id == artifacts.c.job_id, jobs.c.attempt == artifacts.c.attempt))
            .where(jobs.c.id == job_id)
            .order_by(artifacts.c.name)
        )
        with self._database.read() as connection:
            found = [rows.artifact(row) for row in connection.execute(query)]
            if not found:
                _get(connection, job_id)
        return found

    # What workers do

    def claim(self, job_id: str, worker_id: str, lease_s: float) -> Job | None:
        """Take a job that is queued, or whose worker has been silent for longer than its lease, as a new attempt.

        Returns
        -------
        Job or None
            None where there is nothing to take: a duplicate delivery, a canceled or deleted job.
        """
        now = self._database.now()
        abandoned = sa.and_(jobs.c.state == JobState.RUNNING, jobs.c.lease_expires_at < now)
        change = (
            sa.update(jobs)
            .where(jobs.c.id == job_id, sa.or_(jobs.c.state == JobState.QUEUED, abandoned))
            .values(
                state=JobState.RUNNING,
                attempt=jobs.c.attempt + 1,
                lost_attempts=jobs.c.lost_attempts + sa.case((jobs.c.state == JobState.RUNNING, 1), else_=0),
                worker_id=worker_id,
                lease_expires_at=self._database.now(lease_s),
                started_at=sa.func.coalesce(jobs.c.started_at, now),
                phase="loading",
                version=jobs.c.version + 1,
            )
        )
        with self._database.write() as connection:
            row = connection.execute(change.returning(jobs)).one_or_none()
        return rows.job(row) if row else None

    def heartbeat(self, job_id: str, attempt: int, lease_s: float) -> JobState:
        """Renew the lease; the state that comes back says whether to stop.

        Raises
        ------
        StaleAttemptError, NotFoundError
            Another attempt has the job, it is over, or it is gone. So from every method that takes an attempt.
        """
        return self._write(job_id, attempt, {"lease_expires_at": self._database.now(lease_s)})

    def save_progress(self, job_id: str, attempt: int, progress: Progress) -> None:
        """Publish progress, in one UPDATE. The fraction never goes back."""
        # Neither database has a name for it that the other knows: max() here, greatest() there.
        furthest = sa.case((jobs.c.fraction > progress.fraction, jobs.c.fraction), else_=progress.fraction)
        self._write(
            job_id,
            attempt,
            {
                "step": progress.step,
                "total_steps": progress.total_steps,
                "fraction": furthest,
                "phase": progress.phase,
                "losses": progress.losses,
                "eta_s": progress.eta_s,
                "version": jobs.c.version + 1,
            },
        )

    def set_checkpoint(self, job_id: str, attempt: int, key: str, step: int, sha256: str) -> None:
        """Point at a checkpoint that is stored by now."""
        values = {"job_id": job_id, "attempt": attempt, "step": step, "key": key, "sha256": sha256}
        insert = self._database.upsert(checkpoints).values(values)
        insert = insert.on_conflict_do_update(
            index_elements=["job_id", "attempt", "step"], set_={"key": key, "sha256": sha256}
        )
        with self._database.write() as connection:
            self._fence(connection, job_id, attempt)
            connection.execute(insert)

    def checkpoints(self, job_id: str) -> list[CheckpointRef]:
        """Return the checkpoints, newest first."""
        query = (
            sa.select(checkpoints)
            .where(checkpoints.c.job_id == job_id)
            .order_by(checkpoints.c.attempt.desc(), checkpoints.c.step.desc())
        )
        with self._database.read() as connection:
            return [rows.checkpoint(row) for row in connection.execute(query)]

    def forget_checkpoint(self, job_id: str, attempt: int, key: str) -> None:
        """Point no more at a checkpoint, so that its object can be deleted."""
        with self._database.write() as connection:
            self._fence(connection, job_id, attempt)
            connection.execute(sa.delete(checkpoints).where(checkpoints.c.job_id == job_id, checkpoints.c.key == key))

    def add_artifact(self, job_id: str, attempt: int, artifact: Artifact) -> None:
        """Point at a result that is stored by now; a result of this name of an earlier attempt gives way."""
        values = {**artifact.model_dump(), "job_id": job_id, "attempt": attempt}
        insert = self._database.upsert(artifacts).values(values)
        insert = insert.on_conflict_do_update(index_elements=["job_id", "name"], set_=values)
        with self._database.write() as connection:
            self._fence(connection, job_id, attempt)
            connection.execute(insert)

    def finish(self, job_id: str, attempt: int, state: JobState, error: JobError | None = None) -> None:
        """End the job: `succeeded`, `failed`, `canceled` or `expired`, for good.

        A cancel that came before the end was written wins over success: the user was told that the job stops.
        """
        if not state.terminal:
            raise ValueError(f"{state} is not terminal")
        asked = jobs.c.state == JobState.CANCELING
        canceled_anyway = state is JobState.SUCCEEDED
        self._write(
            job_id,
            attempt,
            {
                **_RELEASED,
                "state": sa.case((asked, JobState.CANCELED), else_=state) if canceled_anyway else state,
                "fraction": sa.case((asked, jobs.c.fraction), else_=1.0) if canceled_anyway else jobs.c.fraction,
                "error": error.model_dump() if error else None,
                "finished_at": self._database.now(),
                "phase": "done",
                "version": jobs.c.version + 1,
            },
        )

    def release(self, job_id: str, attempt: int) -> None:
        """Hand a job back in order, with its checkpoints: to the queue, or to its end where a cancel waits."""
        asked = jobs.c.state == JobState.CANCELING
        self._write(
            job_id,
            attempt,
            {
                **_RELEASED,
                "state": sa.case((asked, JobState.CANCELED), else_=JobState.QUEUED),
                "finished_at": sa.case((asked, self._database.now()), else_=None),
                "phase": sa.case((asked, "done"), else_="queued"),
                "version": jobs.c.version + 1,
            },
        )

    def worker_ended(self, worker_id: str) -> bool:
        """End the lease that a worker holds which is known to be gone; True if it held one.

        The job is then taken back like that of any silent worker (`reclaim_expired`), only without the wait.
        """
        held = sa.and_(jobs.c.worker_id == worker_id, jobs.c.state.in_(rows.OWNED))
        # A second ago: over by any clock's resolution.
        change = sa.update(jobs).where(held).values(lease_expires_at=self._database.now(-1.0))
        with self._database.write() as connection:
            return connection.execute(change.returning(jobs.c.id)).first() is not None

    # What the reconciler does

    def reclaim_expired(self, max_attempts: int) -> list[str]:
        """Take back every job whose lease is over; return the ids that are queued again.

        A job that was to be canceled is canceled. One that has now lost `max_attempts` workers fails (`worker_lost`).
        """
        now = self._database.now()
        expired = sa.and_(jobs.c.state.in_(rows.OWNED), jobs.c.lease_expires_at < now)
        with self._database.read() as connection:
            # Almost always there is none, and then nobody need wait for a write lock.
            if connection.execute(sa.select(jobs.c.id).where(expired).limit(1)).first() is None:
                return []
        lost = JobError.of(
            WorkerLostError(f"The workers of {max_attempts} attempts died or were cut off.")
        ).model_dump()
        exhausted = jobs.c.lost_attempts + 1 >= max_attempts
        change = sa.update(jobs).where(expired).values(**_RELEASED, version=jobs.c.version + 1)
        over = {"finished_at": now, "phase": "done"}
        with self._database.write() as connection:
            connection.execute(change.where(jobs.c.state == JobState.CANCELING).values(state=JobState.CANCELED, **over))
            connection.execute(
                change.where(exhausted).values(
                    state=JobState.FAILED, error=lost, lost_attempts=jobs.c.lost_attempts + 1, **over
                )
            )
            again = change.values(state=JobState.QUEUED, phase="queued", lost_attempts=jobs.c.lost_attempts + 1)
            return list(connection.execute(again.returning(jobs.c.id)).scalars())

    def queued_ids(self) -> list[str]:
        """Return the queued jobs, oldest first."""
        queued = jobs.c.state == JobState.QUEUED
        with self._database.read() as connection:
            return list(connection.scalars(sa.select(jobs.c.id).where(queued).order_by(jobs.c.id)))

    def discarded_prefixes(self) -> list[str]:
        """Return the prefixes of objects that belonged to deleted jobs."""
        with self._database.read() as connection:
            return list(connection.scalars(sa.select(discarded.c.prefix)))

    def forget_discarded(self, prefix: str) -> None:
        """The store holds nothing under the prefix any more."""
        with self._database.write() as connection:
            connection.execute(sa.delete(discarded).where(discarded.c.prefix == prefix))

    def _write(self, job_id: str, attempt: int, values: dict[str, Any]) -> JobState:
        change = sa.update(jobs).where(rows.fenced(job_id, attempt)).values(values).returning(jobs.c.state)
        with self._database.write() as connection:
            state = connection.execute(change).scalar_one_or_none()
            if state is None:
                raise self._stale(connection, job_id, attempt)
        return JobState(state)

    def _fence(self, connection: sa.Connection, job_id: str, attempt: int) -> None:
        """Hold the job's row until the end of the transaction, or refuse."""
        if (
            connection.execute(sa.select(jobs.c.id).where(rows.fenced(job_id, attempt)).with_for_update()).first()
            is None
        ):
            raise self._stale(connection, job_id, attempt)

    def _stale(self, connection: sa.Connection, job_id: str, attempt: int) -> StaleAttemptError:
        now = _get(connection, job_id)
        return StaleAttemptError(f"Attempt {attempt} is over: the job is {now.state}, attempt {now.attempt}.")


def _get(connection: sa.Connection, job_id: str) -> Job:
    row = connection.execute(sa.select(jobs).where(jobs.c.id == job_id)).one_or_none()
    if row is None:
        raise NotFoundError(f"There is no job {job_id!r}.")
    return rows.job(row)
