"""Jobs and artifacts as the HTTP API shows them: the service writes these documents, the client reads them."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field

from meshdeform.config import DeformParams, JobKind, OutputOptions
from meshdeform.jobs.models import Artifact, Job, JobError, JobState, Progress, StoredFile

__all__ = ["ArtifactList", "ArtifactView", "FileView", "JobList", "JobView"]

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


class JobView(_Document):
    """One job."""

    id: str = Field(description="Sorts by the time of creation.", examples=[_JOB_ID])
    kind: JobKind = Field(description="What the job does.", examples=["text_deform"])
    state: JobState = Field(
        description="`succeeded`, `failed`, `canceled` and `expired` are terminal: such a job never changes again.",
        examples=["running"],
    )
    prompt: str = Field(description="What the asset shall become.", examples=["a mushroom"])
    params: DeformParams = Field(description="The parameters as they were written.", examples=[{"preset": "preview"}])
    output: OutputOptions = Field(description="What the job writes.", examples=[{"morph": False}])
    metadata: dict[str, str] = Field(description="Your own labels.", examples=[{"shot": "sc010"}])
    asset: FileView = Field(description="The asset that is deformed.")
    target: FileView | None = Field(None, description="The second mesh of `target` guidance.")
    error: JobError | None = Field(None, description="Why the job failed; else null.")
    created_at: datetime = Field(description="UTC.", examples=[_TIME])
    started_at: datetime | None = Field(None, description="When its first attempt began, UTC.", examples=[_TIME])
    finished_at: datetime | None = Field(None, description="When it became terminal, UTC.", examples=[_TIME])
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
            asset=FileView.of(job.asset),
            target=FileView.of(job.target) if job.target else None,
            error=job.error,
            created_at=job.created_at,
            started_at=job.started_at,
            finished_at=job.finished_at,
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
