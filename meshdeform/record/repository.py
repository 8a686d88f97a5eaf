"""The record of all jobs in SQL, the only source of truth: Redis, workers and the API only cache or announce.

`JobRecord` has the users' operations on jobs. Those of workers and the reconciler are in its attributes `leases` and
`upkeep`; others (`files`, `events`, `idempotency`, `webhooks` and so on) hold the rest.
"""

from __future__ import annotations

import base64
import secrets as random_bytes
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import ConflictError, ParameterError
from meshdeform.record import rows
from meshdeform.record.changes import EventLog, changing, find_job
from meshdeform.record.counters import read_counters
from meshdeform.record.database import MAX_CONNECTIONS, Database, NewRow, insert
from meshdeform.record.deliveries import Deliveries
from meshdeform.record.fetching import FETCHING_S, Fetching
from meshdeform.record.files import FileLedger, StorageQuotas, check_number, measure
from meshdeform.record.idempotency import IdempotencyLedger
from meshdeform.record.ids import decode_cursor, encode_cursor, least_id, new_job_id
from meshdeform.record.keys import KeyRing
from meshdeform.record.leases import Leases
from meshdeform.record.models import (
    TERMINAL_STATES,
    Artifact,
    EventType,
    Job,
    JobState,
    NewJob,
    Page,
)
from meshdeform.record.schema import (
    artifacts,
    discarded,
    job_files,
    job_texts,
    jobs,
    labels,
    secrets,
    webhooks,
)
from meshdeform.record.upkeep import Upkeep
from meshdeform.record.uploads import UploadLedger
from meshdeform.record.usage import UsageLedger
from meshdeform.record.webhooks import WebhookBook
from meshdeform.record.words import WordLedger

_CLOCKS_DIFFER = timedelta(hours=1)
_BEGINNING = datetime.min.replace(tzinfo=UTC)


class JobRecord:
    """Every job, from 202 to its deletion. Safe to share between threads. The URL and options are as of `Database`.

    Every method raises `UnavailableError` if the database does not answer; every method about one job raises
    `NotFoundError` if there is no such job or another owner has it.
    """

    def __init__(self, url: str, connections: int = MAX_CONNECTIONS, **options: Any) -> None:
        self.database = self._database = Database(url, connections, **options)
        self.leases = Leases(self._database)
        self.upkeep = Upkeep(self._database)
        self.files = FileLedger(self._database)
        self.events = EventLog(self._database)
        self.uploads = UploadLedger(self._database, self.files)
        self.idempotency = IdempotencyLedger(self._database)
        self.deliveries = Deliveries(self._database)
        self.webhooks = WebhookBook(self._database, self.deliveries, self.secret)
        self.keys = KeyRing(self._database)
        self.words = WordLedger(self._database, self.files)
        self.usage = UsageLedger(self._database)
        self._quotas = StorageQuotas()
        self.fetching = Fetching(self._database, self.files, self._quotas)

    def close(self) -> None:
        """Close every connection."""
        self._database.close()

    def ping(self) -> None:
        """Ask the database once whether it answers and takes writes."""
        # It changes nothing, and yet a database that is read-only refuses it.
        with self._database.write() as connection:
            connection.execute(sa.update(jobs).where(sa.false()).values(version=jobs.c.version))

    def create(self, new: NewJob) -> Job:
        """Record a new queued job. Its files must already be stored; their pins, if any, become references.

        Raises IdempotencyBusyError: another request has taken over the key of `new.claim`. Raises TooManyJobsError: the
        owner has the maximum number of unfinished jobs. Raises TooMuchStoredError: the owner's jobs would keep more
        bytes than allowed. Raises ParameterError: the priority is higher than the key allows.
        """
        check_priority(new.request.priority, new.max_priority)
        deadline = self._database.now(new.request.deadline_s) if new.request.deadline_s else None
        values = rows.new_job(new_job_id(), new, self._database.now(), deadline)
        if new.fetching:
            values["retry_at"] = self._database.now(2 * FETCHING_S)
        own = new.request.webhook
        webhook = None if own is None else self.webhooks.of_job(values["id"], new.owner_id, own.url, own.events)
        with changing(self._database) as change:
            connection = change.connection
            added = self._hold_to_limits(connection, new)
            self.files.unpin(new.sizes, connection)
            job_id = values["id"]
            row = insert(
                connection,
                self._database,
                NewRow(jobs, values),
                *(NewRow(job_files, file) for file in rows.job_files(job_id, new)),
                *(NewRow(labels, {"job_id": job_id, "name": k, "value": v}) for k, v in new.request.metadata.items()),
                NewRow(job_texts, {"job_id": job_id, "text": rows.searched_text(new)}),
            )
            if webhook is not None:
                connection.execute(sa.insert(webhooks).values(webhook))
            change.write_event(row, EventType.QUEUED, _beginning(new))
            job = rows.job(row)
            if new.claim is not None:
                assert new.answer is not None
                self.idempotency.complete(new.claim, new.answer(job), connection)
        self._quotas.accepted(new.owner_id, added)
        return job

    def get(self, job_id: str, owner: str | None = None) -> Job:
        """Return a job; with an owner, only a job of that owner."""
        with self._database.read() as connection:
            return _with_artifacts(connection, [find_job(connection, job_id, owner)])[0]

    def list_jobs(
        self,
        state: JobState | None = None,
        cursor: str | None = None,
        limit: int = 50,
        *,
        owner: str | None = None,
        metadata: Mapping[str, str] | None = None,
        created_after: datetime | None = None,
        words: str = "",
        error: str | None = None,
    ) -> Page:
        """Return a page of jobs, newest first.

        The cursor is `next_cursor` of the page before (`ParameterError`: it is not valid). All conditions must hold:
        state, owner, labels, a later creation, all words in the prompt, file names or labels, in any case, and
        the code of the error with which the job failed.
        """
        query = sa.select(jobs).order_by(jobs.c.id.desc()).limit(limit + 1)
        if owner is not None:
            query = query.where(jobs.c.owner_id == owner)
        if state is not None:
            query = query.where(jobs.c.state == state)
        if error is not None:
            query = query.where(jobs.c.state == JobState.FAILED, jobs.c.error["code"].as_string() == error)
        for name, value in (metadata or {}).items():
            labelled = sa.select(labels.c.job_id).where(labels.c.name == name, labels.c.value == value)
            query = query.where(jobs.c.id.in_(labelled))
        if created_after is not None:
            # The bound on the id is what the indexes find. Its clock may differ from that of the database.
            earliest = least_id("job", created_after.astimezone(UTC) - min(_CLOCKS_DIFFER, created_after - _BEGINNING))
            query = query.where(jobs.c.id >= earliest, jobs.c.created_at > created_after)
        if words.strip():
            query = query.where(_has_words(words))
        if cursor is not None:
            query = query.where(jobs.c.id < decode_cursor(cursor))
        with self._database.read() as connection:
            listed = _with_artifacts(connection, [rows.job(row) for row in connection.execute(query)])
        more = len(listed) > limit
        return Page(listed[:limit], encode_cursor(listed[limit - 1].id) if more else None)

    def request_cancel(self, job_id: str, owner: str | None = None) -> Job:
        """Cancel a queued job at once; mark a running one as `canceling`. Repeating this is not an error.

        `ConflictError`: the job is over.
        """
        queued = jobs.c.state == JobState.QUEUED
        open_ = sa.and_(jobs.c.id == job_id, jobs.c.state.in_([JobState.QUEUED, JobState.RUNNING]), _owned(owner))
        values = {
            "state": sa.case((queued, JobState.CANCELED), else_=JobState.CANCELING),
            "finished_at": sa.case((queued, self._database.now()), else_=None),
            "phase": sa.case((queued, "done"), else_=jobs.c.phase),
            # Of a failure after which it was to be tried again.
            "error": None,
            "retry_at": None,
        }
        with changing(self._database) as change:
            if changed := change.update(open_, values, lambda row: EventType(row.state)):
                return rows.job(changed[0])
            job = find_job(change.connection, job_id, owner)
        if job.state.terminal:
            raise ConflictError(f"The job is {job.state} and can no longer be canceled.", state=job.state.value)
        return job

    def delete(self, job_id: str, owner: str | None = None) -> list[str]:
        """Delete a finished job. Its objects are due for removal from then on (`reconciler.remove_job`).

        Returns the keys of the files that it used, with the checkpoint of its origin: other jobs may use them.
        `ConflictError`: the job is not over.
        """
        over = sa.and_(jobs.c.id == job_id, jobs.c.state.in_(TERMINAL_STATES), _owned(owner))
        with self._database.write() as connection:
            # Read first: they are deleted with the job.
            mine = sa.select(job_files.c.key).where(job_files.c.job_id == job_id).distinct().order_by(job_files.c.key)
            keys = list(connection.scalars(mine))
            if connection.execute(sa.delete(jobs).where(over).returning(jobs.c.id)).one_or_none() is None:
                job = find_job(connection, job_id, owner)
                raise ConflictError(
                    f"The job is {job.state}; only a finished job can be deleted.",
                    advice="Cancel it first, and delete it once it is canceled.",
                    state=job.state.value,
                )
            connection.execute(sa.insert(discarded).values(prefix=f"jobs/{job_id}/"))
            connection.execute(sa.delete(webhooks).where(webhooks.c.job_id == job_id))
        return keys

    def artifacts(self, job_id: str, owner: str | None = None) -> list[Artifact]:
        """Return the results of a job, sorted by name; there are none before it has succeeded."""
        query = sa.select(artifacts).where(artifacts.c.job_id == job_id).order_by(artifacts.c.name)
        with self._database.read() as connection:
            find_job(connection, job_id, owner)
            return [rows.read(Artifact, row) for row in connection.execute(query)]

    def add_artifact(self, job_id: str, artifact: Artifact, owner: str | None = None) -> Artifact:
        """Add an artifact to a job that has succeeded, unless it has one of that name; return the one that it has now.

        The job's version changes, and nothing else of it. `ConflictError`: the job has not succeeded.
        """
        done = sa.and_(jobs.c.id == job_id, jobs.c.state == JobState.SUCCEEDED, _owned(owner))
        values = {**artifact.model_dump(), "job_id": job_id}
        known = sa.select(artifacts).where(artifacts.c.job_id == job_id, artifacts.c.name == artifact.name)
        with changing(self._database) as change:
            connection = change.connection
            # Locked, so that two requests for the same artifact add it once.
            attempt = connection.scalar(sa.select(jobs.c.attempt).where(done).with_for_update())
            if attempt is None:
                job = find_job(connection, job_id, owner)
                raise ConflictError(f"The job is {job.state}; only one that succeeded has artifacts.")
            if row := connection.execute(known).one_or_none():
                return rows.read(Artifact, row)
            connection.execute(sa.insert(artifacts).values(**values, attempt=attempt))
            [row] = change.update(jobs.c.id == job_id, {})
            change.usage.add(row.owner_id, size=artifact.size)
            measure(connection, job_id)
            return artifact

    def counters(self) -> dict[tuple[str, str], float]:
        """Return the counters for the metrics by name and label (`counters.py`)."""
        return read_counters(self._database)

    def secret(self, name: str) -> bytes:
        """Return 32 random bytes shared by all processes of the deployment, created on first use."""
        secret = base64.b64encode(random_bytes.token_bytes(32)).decode()
        insert = self._database.upsert(secrets).values(name=name, value=secret).on_conflict_do_nothing()
        query = sa.select(secrets.c.value).where(secrets.c.name == name)
        with self._database.read() as connection:
            stored = connection.execute(query).scalar()
        if stored is None:
            with self._database.write() as connection:
                connection.execute(insert)
                stored = connection.execute(query).scalar_one()
        return base64.b64decode(stored)

    def check_room(self, owner_id: str, files: Mapping[str, int], limit: int) -> None:
        """Refuse a job before its files are stored if its owner has no room for them; `create` decides.

        `files` are sizes in bytes by key, `limit` the maximum of bytes, 0 for none (`TooMuchStoredError`).
        """
        if limit:
            with self._database.read() as connection:
                self._quotas.check(connection, owner_id, files, limit)

    def _hold_to_limits(self, connection: sa.Connection, new: NewJob) -> int:
        if not new.max_active and not new.max_stored_bytes:
            return 0
        self._database.serialise(connection, new.owner_id)
        check_number(connection, new.owner_id, new.max_active)
        return self._quotas.check(connection, new.owner_id, new.sizes, new.max_stored_bytes)


def _with_artifacts(connection: sa.Connection, jobs_found: list[Job]) -> list[Job]:
    """Return the jobs with their results."""
    begun = [job.id for job in jobs_found if job.attempt]
    if not begun:
        return jobs_found
    query = sa.select(artifacts).where(artifacts.c.job_id.in_(begun)).order_by(artifacts.c.name)
    results: dict[str, list[Artifact]] = {}
    for row in connection.execute(query):
        results.setdefault(row.job_id, []).append(rows.read(Artifact, row))
    return [job.model_copy(update={"artifacts": tuple(results.get(job.id, ()))}) for job in jobs_found]


def _owned(owner: str | None) -> sa.ColumnElement[bool]:
    return sa.true() if owner is None else jobs.c.owner_id == owner


def check_priority(priority: int, limit: int) -> None:
    """Refuse a priority above the limit of an API key (`ParameterError`)."""
    if priority > limit:
        detail = f"The priority {priority} is higher than this API key allows: {limit}."
        raise ParameterError(
            detail,
            advice="Set a lower priority. The service's operator can raise MESHDEFORM_MAX_PRIORITY or the key's limit.",
            errors=[{"loc": ["priority"], "msg": detail, "type": "less_than_equal"}],
            limit=limit,
        )


def _beginning(new: NewJob) -> dict[str, object]:
    if new.origin is None:
        return {"reason": "created"}
    return {"reason": new.origin.mode.value, "origin": {"job_id": new.origin.job_id, "step": new.origin.step}}


def _has_words(query: str) -> sa.ColumnElement[bool]:
    """Return the condition that a job's text contains every word of a query, anywhere and in any case."""
    # Every character of a word stands for itself, `%` and `_` too.
    mine = sa.select(sa.true()).where(job_texts.c.job_id == jobs.c.id)
    for word in rows.folded(query).split():
        mine = mine.where(job_texts.c.text.contains(word, autoescape=True))
    return mine.exists()
