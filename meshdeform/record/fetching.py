"""Jobs that were accepted while a file of theirs is still being fetched from a URL: `record.fetching`.

Such a job is queued, in the phase `fetching`, and put off for longer than that may take, so that no worker of any
version takes it. The process that fetches completes it or lets it fail; if that process dies, the reconciler does.
"""

from __future__ import annotations

import sqlalchemy as sa

from meshdeform.errors import AssetNotFetchedError
from meshdeform.record import rows
from meshdeform.record.changes import JobChange, changing
from meshdeform.record.database import Database
from meshdeform.record.files import FileLedger, StorageQuotas
from meshdeform.record.leases import ended
from meshdeform.record.models import EventType, Job, JobError, JobState, NewJob
from meshdeform.record.schema import job_files, job_texts, jobs

FETCHING_S = 240.0
"""Seconds within which the files of a job are fetched and checked, with all waiting."""
_DEAD_S = 1.5 * FETCHING_S


class Fetching:
    """Ends of the phase `fetching`. A job that was canceled or has expired meanwhile is left as it is."""

    def __init__(self, database: Database, files: FileLedger, quotas: StorageQuotas) -> None:
        self._database, self._files, self._quotas = database, files, quotas

    def complete(self, job_id: str, new: NewJob) -> Job | None:
        """Give a job its files, which are stored and pinned, and let workers take it; None: it is over.

        `TooMuchStoredError`: the owner's jobs would keep more bytes than allowed.
        """
        whole = rows.new_job(job_id, new, None, None)
        values = {name: whole[name] for name in ("request", "resolved", "workload", "files", "faces", "parts", "phase")}
        with changing(self._database) as change:
            connection = change.connection
            added = self._quotas.check(connection, new.owner_id, new.sizes, new.max_stored_bytes)
            mine = sa.and_(jobs.c.id == job_id, _waits())
            values["retry_at"] = None
            changed = change.update(mine, values, EventType.QUEUED, {"reason": "fetched"})
            if not changed:
                return None
            self._files.unpin(new.sizes, connection)
            for file in rows.job_files(job_id, new):
                connection.execute(sa.insert(job_files).values(file))
            text = sa.update(job_texts).where(job_texts.c.job_id == job_id)
            connection.execute(text.values(text=rows.searched_text(new)))
        self._quotas.accepted(new.owner_id, added)
        return rows.job(changed[0])

    def fail(self, job_id: str, error: JobError) -> None:
        """Let a job fail whose files cannot be had, or that cannot be done with them."""
        with changing(self._database) as change:
            self._fail(change, sa.and_(jobs.c.id == job_id, _waits()), error)

    def fail_abandoned(self) -> None:
        """Let every job fail whose files nobody fetches any more."""
        late = sa.and_(_waits(), jobs.c.created_at < self._database.now(-_DEAD_S))
        with self._database.read() as connection:
            if connection.execute(sa.select(jobs.c.id).where(late).limit(1)).first() is None:
                return
        gone = AssetNotFetchedError("The server that fetched the file has stopped.", advice="Send the job again.")
        with changing(self._database) as change:
            self._fail(change, late, JobError.of(gone))

    def _fail(self, change: JobChange, which: sa.ColumnElement[bool], error: JobError) -> None:
        over = {**ended(self._database, JobState.FAILED, error), "retry_at": None}
        change.update(which, over, EventType.FAILED, {"error": over["error"]})


def _waits() -> sa.ColumnElement[bool]:
    return sa.and_(jobs.c.state == JobState.QUEUED, jobs.c.phase == rows.FETCHING)
