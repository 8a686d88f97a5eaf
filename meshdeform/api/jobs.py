"""Define the HTTP API's documents of jobs and artifacts, which the service writes and the client reads."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, Self

from pydantic import Field, SerializeAsAny, SkipValidation

from meshdeform.api.documents import ApiDocument, or_new
from meshdeform.api.states import EventType, JobError, JobState, OriginMode, Progress
from meshdeform.record.models import Artifact, CheckpointRef, Event, Job, Origin, StoredFile
from meshdeform.requests.document import DeformParams, JobKind, OutputParams

_POLL_S = "1"
_TIME = "2026-01-31T12:00:00Z"
_JOB_ID = "job_01kg9zqk2xf3v8c5m7n9p1r4t6"
_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
_OUTPUT = OutputParams().model_dump(mode="json")


class FileView(ApiDocument):
    """An uploaded file."""

    filename: str = Field(description="Its name, as sent.", examples=["sphere.glb"])
    size: int = Field(ge=0, description="Bytes.", examples=[30720])
    sha256: str = Field(description="SHA-256 of its bytes, hexadecimal.", examples=[_SHA256])

    @classmethod
    def of(cls, file: StoredFile) -> Self:
        """Return the document of a stored file."""
        return cls(filename=file.filename, size=file.size, sha256=file.sha256)


class OriginView(ApiDocument):
    """The job and step from which a job continues."""

    job_id: str = Field(description="The other job, which may have been deleted since.", examples=[_JOB_ID])
    step: int = Field(ge=0, description="Steps that the other job had completed.", examples=[500])
    mode: Annotated[OriginMode, or_new(OriginMode)] = Field(
        description="`retry`: the same request continues as if never interrupted. `branch`: another request starts "
        "from the shape of that step.",
        examples=["branch"],
    )

    @classmethod
    def of(cls, origin: Origin) -> Self:
        """Return the document of an origin."""
        return cls(job_id=origin.job_id, step=origin.step, mode=origin.mode)


class ArtifactView(ApiDocument):
    """A result of a job."""

    name: str = Field(description="Its name within the job.", examples=["result.glb"])
    content_type: str = Field(description="Its media type.", examples=["model/gltf-binary"])
    size: int = Field(ge=0, description="Bytes.", examples=[30720])
    sha256: str = Field(description="SHA-256 of its bytes, hexadecimal.", examples=[_SHA256])
    created_at: datetime = Field(description="UTC.", examples=[_TIME])
    href: str = Field(description="URL of its bytes.", examples=[f"/v1/jobs/{_JOB_ID}/artifacts/result.glb"])
    warnings: list[str] = Field(
        default_factory=list,
        description="What its format cannot hold, and what its numbers mean, in sentences.",
        examples=[["Without animations: 2."]],
    )

    @classmethod
    def of(cls, artifact: Artifact, job_id: str) -> Self:
        """Return the document of an artifact."""
        described = artifact.model_dump(exclude={"key", "warnings"})
        href = f"/v1/jobs/{job_id}/artifacts/{artifact.name}"
        return cls(**described, href=href, warnings=artifact.warnings or [])


class JobView(ApiDocument):
    """A job."""

    id: str = Field(description="Sorts by the time of creation.", examples=[_JOB_ID])
    kind: Annotated[JobKind, or_new(JobKind)] = Field(
        description="Kind of the job; if it is `unreadable`, maybe one of another version.", examples=["text_deform"]
    )
    state: Annotated[JobState, or_new(JobState)] = Field(
        description="`succeeded`, `failed`, `canceled` and `expired` are terminal: such a job never changes again.",
        examples=["running"],
    )
    prompt: str = Field(description="New shape of the asset, in words.", examples=["a mushroom"])
    params: SerializeAsAny[SkipValidation[DeformParams]] = Field(
        description="The parameters as given in the request.",
        examples=[{"seed": 7, "guidance": {"kind": "exemplar"}}],
    )
    output: OutputParams = Field(description="Files that the job writes, and how.", examples=[{"morph": False}])
    metadata: dict[str, str] = Field(description="Your own labels.", examples=[{"shot": "sc010"}])
    priority: int = Field(0, description="Workers take the job with the highest priority first.", examples=[0])
    files: dict[str, FileView] = Field(
        default_factory=dict, description="Its files by the names of their fields, in the order of its kind."
    )
    asset: FileView = Field(description="The first of `files`: the asset to deform; without a name if there is none.")
    target: FileView | None = Field(None, description="`files.target`, the second mesh of `target` guidance.")
    origin: OriginView | None = Field(None, description="Its first checkpoint; null if it starts from its files.")
    error: JobError | None = Field(
        None, description="Why the job failed, or, with `retry_at`, why its last attempt did; else null."
    )
    created_at: datetime = Field(description="UTC.", examples=[_TIME])
    started_at: datetime | None = Field(None, description="When its first attempt began, UTC.", examples=[_TIME])
    finished_at: datetime | None = Field(None, description="When it became terminal, UTC.", examples=[_TIME])
    deadline_at: datetime | None = Field(
        None, description="When it becomes `expired` unless finished, UTC; null: never.", examples=[_TIME]
    )
    max_run_s: float | None = Field(
        None, description="Seconds for which it may run; null: as long as any job of this server.", examples=[3600]
    )
    retain_until: datetime | None = Field(
        None, description="When it is deleted with its artifacts, UTC; null: never, or not finished.", examples=[_TIME]
    )
    retry_at: datetime | None = Field(
        None,
        description="When a queued job is tried again after a failure that may pass, UTC; else null.",
        examples=[None],
    )
    progress: Progress = Field(description="The job's progress.")
    artifacts: list[ArtifactView] = Field(
        default_factory=list,
        description="The results, sorted by name; none unless the job has succeeded.",
    )

    made_by: str | None = Field(
        None,
        description="Version of Meshdeform that computed the results, with a digest of its sources; several, in order, "
        "if another one went on from a checkpoint: their results may differ. Null if unknown, or there are none.",
        examples=["0.1.0+3f9a2c1d"],
    )
    unreadable: str | None = Field(
        None,
        description="Why this server cannot read the request, so that it neither retries nor branches the job, and "
        "its workers leave the job to others; for example, a later version accepted it, or its kind is retired. Null: "
        "it can.",
        examples=[None],
    )

    @classmethod
    def of(cls, job: Job) -> JobView:
        """Return the document of a job. Nothing of its request is read, so `unreadable` is for the caller to fill."""
        files = {part: FileView.of(file) for part, file in job.files.items()}
        written = job.document
        return cls.model_construct(
            id=job.id,
            kind=job.kind,
            state=job.state,
            prompt=job.prompt,
            params=_members(written, "params"),
            output=_over(_OUTPUT, _members(written, "output")),
            metadata={name: str(value) for name, value in _members(written, "metadata").items()},
            priority=job.priority,
            files=files,
            asset=FileView.of(job.source),
            target=files.get("target"),
            origin=OriginView.of(job.origin) if job.origin else None,
            error=job.error,
            created_at=job.created_at,
            started_at=job.started_at,
            finished_at=job.finished_at,
            deadline_at=job.deadline_at,
            max_run_s=_number(written.get("max_run_s")),
            retain_until=job.retain_until,
            retry_at=job.retry_at,
            progress=job.progress,
            artifacts=[ArtifactView.of(artifact, job.id) for artifact in job.artifacts],
            made_by=job.made_by,
        )


def _number(value: Any) -> float | None:
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def _members(document: Mapping[str, Any], name: str) -> Any:
    """Return a member that is an object; clients are promised one, whatever a later version stores."""
    members = document.get(name)
    return members if isinstance(members, Mapping) else {}


def _over(defaults: Mapping[str, Any], written: Mapping[str, Any]) -> Any:
    """Return a document with the defaults of the members that it leaves out, at any depth."""
    inner = {name: value for name, value in defaults.items() if isinstance(value, Mapping)}
    deep = {
        name: _over(inner[name], value)
        for name, value in written.items()
        if name in inner and isinstance(value, Mapping)
    }
    return {**defaults, **written, **deep}


class JobList(ApiDocument):
    """A page of jobs, newest first."""

    jobs: list[JobView] = Field(description="The jobs of this page.")
    next_cursor: str | None = Field(
        None, description="Pass it as `cursor` to get the next page; null on the last one.", examples=["am9iXzAxa2c5"]
    )


class ArtifactList(ApiDocument):
    """The results of a job."""

    artifacts: list[ArtifactView] = Field(description="The artifacts, sorted by name.")


class SignedUrl(ApiDocument):
    """A URL that needs no API key."""

    url: str = Field(
        description="The URL, absolute or a path of this server. Anyone who has it can read what it is for.",
        examples=[f"/v1/jobs/{_JOB_ID}/artifacts/result.glb?expires=1769864400&signature=3b1f"],
    )
    expires_at: datetime = Field(description="When it expires, UTC.", examples=["2026-01-31T13:00:00Z"])


class EventView(ApiDocument):
    """Something that happened to a job."""

    seq: int = Field(ge=1, description="Its number within the job: 1, 2, 3 and so on, without gaps.", examples=[3])
    job_id: str = Field(description="The job.", examples=[_JOB_ID])
    type: Annotated[EventType, or_new(EventType)] = Field(
        description="Kind of event. Exactly one of `succeeded`, `failed`, `canceled` and `expired` ends the job; no "
        "event follows it.",
        examples=["progress"],
    )
    at: datetime = Field(description="When it happened, UTC.", examples=[_TIME])
    attempt: int = Field(ge=0, description="Number of the attempt; 0 before the first.", examples=[1])
    data: dict[str, Any] = Field(
        description="Details: for `progress` the job's progress, for `checkpoint` its step, for `failed` the error, "
        "for `succeeded` the artifacts' names, for `queued` and `recovered` the reason.",
        examples=[{"step": 120, "total_steps": 300, "fraction": 0.4, "phase": "optimizing"}],
    )

    @classmethod
    def of(cls, event: Event) -> Self:
        """Return the document of an event."""
        return cls(**event.model_dump())


class EventList(ApiDocument):
    """Events of a job."""

    events: list[EventView] = Field(description="Oldest first.")
    next_after: int = Field(ge=0, description="Pass it as `after` to get the following events.", examples=[3])


class MeshView(ApiDocument):
    """The mesh of a checkpoint."""

    href: str = Field(description="URL of its bytes.", examples=[f"/v1/jobs/{_JOB_ID}/checkpoints/500/mesh.glb"])
    size: int = Field(ge=0, description="Bytes.", examples=[30720])
    sha256: str = Field(description="SHA-256 of its bytes, hexadecimal.", examples=[_SHA256])


class CheckpointView(ApiDocument):
    """A checkpoint from which a job can continue or be branched."""

    step: int = Field(ge=0, description="Completed optimiser steps.", examples=[500])
    attempt: int = Field(ge=1, description="The attempt that stored it.", examples=[1])
    size: int = Field(ge=0, description="Bytes.", examples=[184320])
    created_at: datetime | None = Field(None, description="UTC; null if unknown.", examples=[_TIME])
    mesh: MeshView | None = Field(None, description="The asset with its shape at that step; null if it was not kept.")

    @classmethod
    def of(cls, checkpoint: CheckpointRef, job_id: str) -> Self:
        """Return the document of a checkpoint."""
        mesh = None
        if checkpoint.mesh_key is not None:
            href = f"/v1/jobs/{job_id}/checkpoints/{checkpoint.step}/mesh.glb"
            mesh = MeshView(href=href, size=checkpoint.mesh_size or 0, sha256=checkpoint.mesh_sha256 or "")
        return cls(
            step=checkpoint.step,
            attempt=checkpoint.attempt,
            size=checkpoint.size,
            created_at=checkpoint.created_at,
            mesh=mesh,
        )


class CheckpointList(ApiDocument):
    """The checkpoints of a job."""

    checkpoints: list[CheckpointView] = Field(
        description="Sorted by step. For equal steps, only that of the newest attempt."
    )


def job_headers(job: Job) -> dict[str, str]:
    """Return the headers of every response with a job."""
    retry = {} if job.state.terminal else {"Retry-After": _POLL_S}
    return {"ETag": f'W/"{job.version}"', "Cache-Control": "no-cache", **retry}


def accepted(job: Job) -> dict[str, Any]:
    """Return the response to the request that created a job: `status`, `body` and `headers`."""
    headers = {**job_headers(job), "Location": f"/v1/jobs/{job.id}"}
    return {"status": 202, "body": JobView.of(job).as_json(), "headers": headers}
