"""Jobs and artifacts as the HTTP API shows them: the service writes these documents, the client reads them."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, SerializeAsAny, SkipValidation

from meshdeform.record.models import (
    Artifact,
    CheckpointRef,
    Event,
    EventType,
    Job,
    JobError,
    JobState,
    Origin,
    OriginMode,
    Progress,
    StoredFile,
)
from meshdeform.requests.document import DeformParams, JobKind, OutputOptions

__all__ = [
    "ArtifactList",
    "ArtifactView",
    "CheckpointList",
    "CheckpointView",
    "EventList",
    "EventView",
    "FileView",
    "JobList",
    "JobView",
    "MeshView",
    "OriginView",
    "SignedUrl",
    "accepted",
    "job_headers",
]

_POLL_S = "1"
_TIME = "2026-01-31T12:00:00Z"
_JOB_ID = "job_01kg9zqk2xf3v8c5m7n9p1r4t6"
_SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"


class _Document(BaseModel):
    # A newer server may say more than this client knows.
    model_config = ConfigDict(frozen=True, extra="ignore")


class FileView(_Document):
    """A file that was sent."""

    filename: str = Field(description="Its name, as it was sent.", examples=["sphere.glb"])
    size: int = Field(ge=0, description="Bytes.", examples=[30720])
    sha256: str = Field(description="SHA-256 of its bytes, hexadecimal.", examples=[_SHA256])

    @classmethod
    def of(cls, file: StoredFile) -> Self:
        """Return what is told about a stored file."""
        return cls(filename=file.filename, size=file.size, sha256=file.sha256)


class OriginView(_Document):
    """What a job begins from that continues another one."""

    job_id: str = Field(description="The other job; it may be deleted since.", examples=[_JOB_ID])
    step: int = Field(ge=0, description="Steps that the other job had done.", examples=[500])
    mode: OriginMode = Field(
        description="`retry`: the same request goes on as if never interrupted. `branch`: another request begins with "
        "the shape of that step.",
        examples=["branch"],
    )

    @classmethod
    def of(cls, origin: Origin) -> Self:
        """Return what is told about an origin."""
        return cls(job_id=origin.job_id, step=origin.step, mode=origin.mode)


class JobView(_Document):
    """One job."""

    id: str = Field(description="Sorts by the time of creation.", examples=[_JOB_ID])
    kind: JobKind = Field(description="What the job does.", examples=["text_deform"])
    state: JobState = Field(
        description="`succeeded`, `failed`, `canceled` and `expired` are terminal: such a job never changes again.",
        examples=["running"],
    )
    prompt: str = Field(description="What the asset shall become.", examples=["a mushroom"])
    params: SerializeAsAny[SkipValidation[DeformParams]] = Field(
        description="The parameters as they were written.", examples=[{"preset": "preview"}]
    )
    output: OutputOptions = Field(description="What the job writes.", examples=[{"morph": False}])
    metadata: dict[str, str] = Field(description="Your own labels.", examples=[{"shot": "sc010"}])
    priority: int = Field(0, description="Workers take the job with the greatest one first.", examples=[0])
    asset: FileView = Field(description="The asset that is deformed.")
    target: FileView | None = Field(None, description="The second mesh of `target` guidance.")
    origin: OriginView | None = Field(None, description="What it begins from; null where it begins with its asset.")
    error: JobError | None = Field(None, description="Why the job failed; else null.")
    created_at: datetime = Field(description="UTC.", examples=[_TIME])
    started_at: datetime | None = Field(None, description="When its first attempt began, UTC.", examples=[_TIME])
    finished_at: datetime | None = Field(None, description="When it became terminal, UTC.", examples=[_TIME])
    deadline_at: datetime | None = Field(
        None, description="When it becomes `expired` unless it is over, UTC; null: never.", examples=[_TIME]
    )
    retain_until: datetime | None = Field(
        None, description="When it is deleted with its artifacts, UTC; null: never, or not over yet.", examples=[_TIME]
    )
    progress: Progress = Field(description="How far it is.")

    @classmethod
    def of(cls, job: Job) -> Self:
        """Return what is told about a job."""
        return cls(
            id=job.id,
            kind=job.kind,
            state=job.state,
            prompt=job.prompt,
            params=job.params,
            output=job.request.output,
            metadata=job.metadata,
            priority=job.request.priority,
            asset=FileView.of(job.asset),
            target=FileView.of(job.target) if job.target else None,
            origin=OriginView.of(job.origin) if job.origin else None,
            error=job.error,
            created_at=job.created_at,
            started_at=job.started_at,
            finished_at=job.finished_at,
            deadline_at=job.deadline_at,
            retain_until=job.retain_until,
            progress=job.progress,
        )

    def as_json(self) -> dict[str, Any]:
        """Return the document: everything, but of the parameters only what was written."""
        return {
            **self.model_dump(mode="json"),
            "params": self.params.model_dump(mode="json", exclude_unset=True),
        }


class JobList(_Document):
    """A page of jobs, newest first."""

    jobs: list[JobView] = Field(description="The jobs of this page.")
    next_cursor: str | None = Field(
        None, description="Give it as `cursor` to get the next page; null on the last one.", examples=["am9iXzAxa2c5"]
    )

    def as_json(self) -> dict[str, Any]:
        """Return the document."""
        return {"jobs": [job.as_json() for job in self.jobs], "next_cursor": self.next_cursor}


class ArtifactView(_Document):
    """A result of a job."""

    name: str = Field(description="Its name within the job.", examples=["result.glb"])
    content_type: str = Field(description="Its media type.", examples=["model/gltf-binary"])
    size: int = Field(ge=0, description="Bytes.", examples=[30720])
    sha256: str = Field(description="SHA-256 of its bytes, hexadecimal.", examples=[_SHA256])
    created_at: datetime = Field(description="UTC.", examples=[_TIME])
    href: str = Field(description="Where its bytes are.", examples=[f"/v1/jobs/{_JOB_ID}/artifacts/result.glb"])

    @classmethod
    def of(cls, artifact: Artifact, job_id: str) -> Self:
        """Return what is told about an artifact."""
        return cls(**artifact.model_dump(exclude={"key"}), href=f"/v1/jobs/{job_id}/artifacts/{artifact.name}")


class ArtifactList(_Document):
    """The results of a job."""

    artifacts: list[ArtifactView] = Field(description="By name.")


class SignedUrl(_Document):
    """A URL that needs no API key."""

    url: str = Field(
        description="Where the bytes are: absolute, or a path of this server. Whoever has it may read them.",
        examples=[f"/v1/jobs/{_JOB_ID}/artifacts/result.glb?expires=1769864400&signature=3b1f"],
    )
    expires_at: datetime = Field(description="From when on it is refused, UTC.", examples=["2026-01-31T13:00:00Z"])


class EventView(_Document):
    """Something that happened to a job."""

    seq: int = Field(ge=1, description="Its number within the job: 1, 2, 3 and so on, without a gap.", examples=[3])
    job_id: str = Field(description="The job.", examples=[_JOB_ID])
    type: EventType = Field(
        description="What happened. `succeeded`, `failed`, `canceled` and `expired` end the job; exactly one of them "
        "comes, and nothing after it.",
        examples=["progress"],
    )
    at: datetime = Field(description="When, UTC.", examples=[_TIME])
    attempt: int = Field(ge=0, description="Of which attempt; 0 before the first.", examples=[1])
    data: dict[str, Any] = Field(
        description="More about it: of `progress` the job's progress, of `checkpoint` its step, of `failed` the error, "
        "of `succeeded` the artifacts' names, of `queued` and `recovered` the reason.",
        examples=[{"step": 120, "total_steps": 300, "fraction": 0.4, "phase": "optimizing"}],
    )

    @classmethod
    def of(cls, event: Event) -> Self:
        """Return what is told about an event."""
        return cls(**event.model_dump())


class EventList(_Document):
    """Events of a job."""

    events: list[EventView] = Field(description="Oldest first.")
    next_after: int = Field(ge=0, description="Give it as `after` to get what follows.", examples=[3])


class MeshView(_Document):
    """The mesh of a checkpoint."""

    href: str = Field(description="Where its bytes are.", examples=[f"/v1/jobs/{_JOB_ID}/checkpoints/500/mesh.glb"])
    size: int = Field(ge=0, description="Bytes.", examples=[30720])
    sha256: str = Field(description="SHA-256 of its bytes, hexadecimal.", examples=[_SHA256])


class CheckpointView(_Document):
    """Where a job can go on from, or be branched."""

    step: int = Field(ge=0, description="Optimiser steps done.", examples=[500])
    attempt: int = Field(ge=1, description="The attempt that stored it.", examples=[1])
    size: int = Field(ge=0, description="Bytes.", examples=[184320])
    created_at: datetime | None = Field(None, description="UTC; null where it is not known.", examples=[_TIME])
    mesh: MeshView | None = Field(None, description="The asset with its shape at that step; null where it is not kept.")

    @classmethod
    def of(cls, found: CheckpointRef, job_id: str) -> Self:
        """Return what is told about a checkpoint."""
        mesh = None
        if found.mesh_key is not None:
            href = f"/v1/jobs/{job_id}/checkpoints/{found.step}/mesh.glb"
            mesh = MeshView(href=href, size=found.mesh_size or 0, sha256=found.mesh_sha256 or "")
        return cls(step=found.step, attempt=found.attempt, size=found.size, created_at=found.created_at, mesh=mesh)


class CheckpointList(_Document):
    """The checkpoints of a job."""

    checkpoints: list[CheckpointView] = Field(description="By step; of equal steps that of the newest attempt.")


def job_headers(job: Job) -> dict[str, str]:
    """Return the headers of every answer that shows a job."""
    retry = {} if job.state.terminal else {"Retry-After": _POLL_S}
    return {"ETag": f'W/"{job.version}"', "Cache-Control": "no-cache", **retry}


def accepted(job: Job) -> dict[str, Any]:
    """Return the answer to the request that made a job: `status`, `body` and `headers`."""
    headers = {**job_headers(job), "Location": f"/v1/jobs/{job.id}"}
    return {"status": 202, "body": JobView.of(job).as_json(), "headers": headers}
