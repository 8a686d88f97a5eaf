"""Rows of the record as values, and back."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from meshdeform.config import JobRequest
from meshdeform.jobs.models import Artifact, CheckpointRef, Job, JobError, JobState, Progress, StoredFile
from meshdeform.jobs.tables import jobs

__all__ = ["OWNED", "artifact", "checkpoint", "fenced", "job", "new_job"]

Row = sa.Row[Any]

OWNED = (JobState.RUNNING, JobState.CANCELING)
"""The states in which a worker has the job."""


def fenced(job_id: str, attempt: int) -> sa.ColumnElement[bool]:
    """Whether a row is this job, in the hands of this attempt's worker: the guard of every write of a worker."""
    return sa.and_(jobs.c.id == job_id, jobs.c.attempt == attempt, jobs.c.state.in_(OWNED))


def new_job(job_id: str, request: JobRequest, asset: StoredFile, target: StoredFile | None, now: Any) -> dict[str, Any]:
    """Return the row of a job that nobody has touched. `now` may be an expression of the database."""
    return {
        "id": job_id,
        "kind": request.kind.value,
        "state": JobState.QUEUED,
        # As it was written: what the user left out may get another default in a later version.
        "request": request.model_dump(mode="json", exclude_unset=True),
        "asset_key": asset.key,
        "asset": asset.model_dump(),
        "target_key": target.key if target else None,
        "target": target.model_dump() if target else None,
        "created_at": now,
        "version": 1,
        "attempt": 0,
        "lost_attempts": 0,
        "step": 0,
        "total_steps": 0,
        "fraction": 0.0,
        "phase": "queued",
        "losses": {},
    }


def job(row: Row) -> Job:
    """Return the job of a row."""
    return Job(
        id=row.id,
        state=JobState(row.state),
        request=JobRequest.model_validate(row.request),
        asset=StoredFile.model_validate(row.asset),
        target=StoredFile.model_validate(row.target) if row.target else None,
        error=JobError.model_validate(row.error) if row.error else None,
        created_at=row.created_at,
        started_at=row.started_at,
        finished_at=row.finished_at,
        progress=Progress(
            step=row.step,
            total_steps=row.total_steps,
            fraction=row.fraction,
            phase=row.phase,
            losses=row.losses,
            eta_s=row.eta_s,
            attempt=row.attempt,
        ),
        attempt=row.attempt,
        version=row.version,
    )


def artifact(row: Row) -> Artifact:
    """Return the artifact of a row."""
    return Artifact(
        name=row.name,
        content_type=row.content_type,
        size=row.size,
        sha256=row.sha256,
        key=row.key,
        created_at=row.created_at,
    )


def checkpoint(row: Row) -> CheckpointRef:
    """Return the checkpoint of a row."""
    return CheckpointRef(key=row.key, step=row.step, attempt=row.attempt, sha256=row.sha256)
