"""Convert rows of the record to values and back."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from meshdeform.record.models import (
    Artifact,
    CheckpointRef,
    Event,
    EventType,
    Job,
    JobError,
    JobState,
    NewJob,
    Origin,
    OriginMode,
    Progress,
    StoredFile,
)
from meshdeform.record.schema import ORIGIN, jobs
from meshdeform.requests.choices import JobKind, member_of
from meshdeform.requests.document import JobRequest

Row = sa.Row[Any]

# Documents may have further members, such as the sources of their files.
_REQUEST = set(JobRequest.model_fields)
OWNED = (JobState.RUNNING, JobState.CANCELING)
"""The states in which a worker has the job."""


def fenced(job_id: str, attempt: int) -> sa.ColumnElement[bool]:
    """Return the condition that this attempt's worker has the job, which guards every write of a worker."""
    return sa.and_(
        jobs.c.id == job_id, jobs.c.attempt == attempt, jobs.c.state.in_(OWNED), jobs.c.worker_id.is_not(None)
    )


def new_job(job_id: str, new: NewJob, now: Any, deadline: Any) -> dict[str, Any]:
    """Return the row of a new job. The times may be SQL expressions."""
    request, origin = new.request, new.origin
    return {
        "id": job_id,
        "owner_id": new.owner_id,
        "kind": request.kind.value,
        "workload": request.workload,
        "state": JobState.QUEUED,
        # Only what the user wrote: later versions may have other defaults.
        "request": request.model_dump(mode="json", exclude_unset=True, include=_REQUEST),
        "resolved": new.resolved.model_dump(mode="json") if new.resolved else None,
        "files": {part: file.model_dump() for part, file in new.files.items()},
        "origin": origin.model_dump(mode="json") if origin else None,
        "faces": new.faces,
        "parts": new.parts,
        "priority": request.priority,
        "deadline_at": deadline,
        "retention_s": request.retention_s or new.retention_s,
        "request_id": new.request_id,
        "traceparent": new.traceparent,
        "created_at": now,
        "version": 1,
        "attempt": 0,
        "lost_attempts": 0,
        "oom_attempts": 0,
        "event_seq": 1,
        "step": 0,
        "total_steps": 0,
        "fraction": 0.0,
        "phase": "queued",
        "losses": {},
        "stored_bytes": 0,
    }


def job_files(job_id: str, new: NewJob) -> list[dict[str, Any]]:
    """Return the rows of a new job's stored files."""
    found = [{"part": part, "key": file.key, "size": file.size} for part, file in new.files.items()]
    if new.origin is not None and new.origin.key:
        found.append({"part": ORIGIN, "key": new.origin.key, "size": new.origin.size})
    return [{"job_id": job_id, "owner_id": new.owner_id, **each} for each in found]


def job(row: Row) -> Job:
    """Return the job of a row, whichever version wrote it: the request is read only when it is asked for."""
    return Job(
        id=row.id,
        kind=member_of(JobKind, row.kind),
        state=member_of(JobState, row.state),
        document=row.request,
        priority=row.priority,
        resolved=row.resolved,
        files={part: StoredFile.model_validate(file) for part, file in row.files.items()},
        error=JobError.model_validate(row.error) if row.error else None,
        created_at=row.created_at,
        started_at=row.started_at,
        finished_at=row.finished_at,
        progress=Progress.model_construct(
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
        owner_id=row.owner_id,
        origin=_origin(row.origin) if row.origin else None,
        deadline_at=row.deadline_at,
        retain_until=row.retain_until,
        retry_at=row.retry_at,
        oom_attempts=row.oom_attempts,
        ran_s=row.ran_s,
        event_seq=row.event_seq,
        request_id=row.request_id,
        traceparent=row.traceparent,
        faces=row.faces,
        parts=row.parts,
    )


def _origin(document: dict[str, Any]) -> Origin:
    return Origin.model_validate({**document, "mode": member_of(OriginMode, document["mode"])})


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
    return CheckpointRef(
        key=row.key,
        step=row.step,
        attempt=row.attempt,
        sha256=row.sha256,
        size=row.size,
        mesh_key=row.mesh_key,
        mesh_sha256=row.mesh_sha256,
        mesh_size=row.mesh_size,
        created_at=row.created_at,
    )


def event(row: Row) -> Event:
    """Return the event of a row."""
    kind = member_of(EventType, row.type)
    return Event(job_id=row.job_id, seq=row.seq, type=kind, at=row.at, attempt=row.attempt, data=row.data)
