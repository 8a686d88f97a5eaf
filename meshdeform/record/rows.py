"""Convert rows of the record to values and back."""

from __future__ import annotations

import unicodedata
from typing import Any, TypeVar

import sqlalchemy as sa
from pydantic import TypeAdapter, ValidationError

from meshdeform.record.models import (
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
from meshdeform.requests.document import DeformParams, JobRequest

Row = sa.Row[Any]
_Value = TypeVar("_Value")

# Documents may have further members, such as the sources of their files.
_REQUEST = set(JobRequest.model_fields)
OWNED = (JobState.RUNNING, JobState.CANCELING)
"""The states in which a worker has the job."""
FETCHING = "fetching"
"""The phase of a job that was accepted before its files were there."""
_CONTENTS: dict[str, tuple[TypeAdapter[Any], Any]] = {
    "request": (TypeAdapter(dict[str, Any]), {}),
    "resolved": (TypeAdapter(dict[str, Any] | None), None),
    "files": (TypeAdapter(dict[str, StoredFile]), {}),
    "origin": (TypeAdapter(dict[str, Any] | None), None),
    "error": (TypeAdapter(JobError | None), None),
    "losses": (TypeAdapter(dict[str, float]), {}),
}
"""What the columns of JSON of a job hold, and what stands for anything else."""


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
        "request": _stored_request(request),
        "resolved": new.resolved.model_dump(mode="json") if new.resolved else None,
        "files": {name: file.model_dump() for name, file in new.files.items()},
        "origin": origin.model_dump(mode="json") if origin else None,
        "faces": new.faces,
        "parts": new.meshes,
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
        "phase": FETCHING if new.fetching else "queued",
        "losses": {},
        "stored_bytes": 0,
    }


def _stored_request(request: JobRequest) -> dict[str, Any]:
    """Return what the user wrote, and the treatment of the rig, whose default was another one once."""
    # Only that: later versions may have other defaults.
    document = request.model_dump(mode="json", exclude_unset=True, include=_REQUEST)
    if request.kind is JobKind.TEXT_DEFORM:
        document["output"] = {**document.get("output", {}), "rig": request.output.rig.value}
    return document


def job_files(job_id: str, new: NewJob) -> list[dict[str, Any]]:
    """Return the rows of a new job's stored files."""
    files = [{"part": name, "key": file.key, "size": file.size} for name, file in new.files.items()]
    if new.origin is not None and new.origin.key:
        files.append({"part": ORIGIN, "key": new.origin.key, "size": new.origin.size})
    return [{"job_id": job_id, "owner_id": new.owner_id, **each} for each in files]


def read(model: type[_Value], row: Row, /, **others: Any) -> _Value:
    """Return a value whose members are the columns of the same names, but for `others`."""
    columns = row._mapping
    return model(**{name: columns[name] for name in model.__annotations__ if name not in others}, **others)


def job(row: Row) -> Job:
    """Return the job of a row, whichever version wrote it: the request is read only when it is asked for.

    Of a row with other content than any version writes, the rest is shown; its request is unreadable.
    """
    columns = dict(row._mapping)
    try:
        if isinstance(columns["losses"], dict):
            return _job(columns)
    except (ValidationError, TypeError, ValueError, KeyError, AttributeError):
        pass
    return _job(columns | {name: _sound(columns[name], *content) for name, content in _CONTENTS.items()}, damaged=True)


def _sound(value: Any, model: TypeAdapter[Any], otherwise: Any) -> Any:
    try:
        model.validate_python(value)
    except ValidationError:
        return otherwise
    return value


def _job(columns: dict[str, Any], *, damaged: bool = False) -> Job:
    own = {
        "kind": member_of(JobKind, columns["kind"]),
        "state": member_of(JobState, columns["state"]),
        "document": columns["request"],
        "origin": None if damaged or columns["origin"] is None else _origin(columns["origin"]),
        "retry_at": None if columns["phase"] == FETCHING else columns["retry_at"],
        "progress": Progress.model_construct(**{name: columns[name] for name in Progress.model_fields}),
        "artifacts": (),
        "meshes": columns["parts"],
        "damaged": damaged,
    }
    return Job(**{name: columns[name] for name in Job.__annotations__ if name not in own}, **own)


def _origin(document: dict[str, Any]) -> Origin:
    return Origin.model_validate({**document, "mode": member_of(OriginMode, document["mode"])})


def event(row: Row) -> Event:
    """Return the event of a row."""
    return read(Event, row, type=member_of(EventType, row.type), data=row.data if isinstance(row.data, dict) else {})


def folded(text: str) -> str:
    """Return a text in the form in which texts are compared: without differences of case and Unicode composition."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", text).casefold())


def searched_text(new: NewJob) -> str:
    """Return the text in which a search looks for a new job: its prompts, file names and values of labels."""
    names = [file.filename for file in new.files.values()]
    return folded(
        "\n".join([new.request.prompt, *_further_prompts(new.request), *names, *new.request.metadata.values()])
    )


def _further_prompts(request: JobRequest) -> list[str]:
    """Return the prompts beside that of the request; parameters of other kinds of job have none."""
    return [each.prompt for each in request.params.prompts] if isinstance(request.params, DeformParams) else []
