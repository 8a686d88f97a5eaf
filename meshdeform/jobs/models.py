"""A job and what belongs to it, as frozen values. Needs nothing but pydantic: the client shares it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field

from meshdeform.config import DeformParams, JobKind, JobRequest
from meshdeform.errors import MeshdeformError

__all__ = ["Artifact", "CheckpointRef", "Job", "JobError", "JobState", "Page", "Progress", "StoredFile"]


class JobState(StrEnum):
    """Where a job stands. The last four are terminal: such a job never changes again."""

    QUEUED = "queued"
    RUNNING = "running"
    CANCELING = "canceling"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELED = "canceled"
    EXPIRED = "expired"

    @property
    def terminal(self) -> bool:
        """Whether the job is over."""
        return self in TERMINAL_STATES


TERMINAL_STATES = frozenset({JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELED, JobState.EXPIRED})


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True)


class Progress(_Frozen):
    """How far a job is."""

    step: int = Field(0, ge=0, description="Optimiser steps done.", examples=[120])
    total_steps: int = Field(0, ge=0, description="Optimiser steps in all; 0 until known.", examples=[300])
    fraction: float = Field(
        0.0, ge=0.0, le=1.0, description="Share of the work done, 0 to 1. Never goes back.", examples=[0.4]
    )
    phase: str = Field("queued", description="What happens now, in a word.", examples=["optimizing"])
    losses: dict[str, float] = Field(
        default_factory=dict, description="The newest value of each loss.", examples=[{"guidance": 0.21}]
    )
    eta_s: float | None = Field(
        None, ge=0.0, description="Seconds left by the pace so far; null until known.", examples=[9.5]
    )
    attempt: int = Field(0, ge=0, description="Which try this is; 0 before the first.", examples=[1])


class JobError(_Frozen):
    """Why a job failed."""

    code: str = Field(description="Stable: programs compare it.", examples=["worker_lost"])
    title: str = Field(
        description="The same sentence for every occurrence.", examples=["Every attempt lost its worker"]
    )
    detail: str = Field(description="About this occurrence.", examples=["3 of 3 attempts lost their worker."])
    advice: str = Field(description="What to do.", examples=["See the workers' logs."])
    status: int = Field(500, description="The HTTP status that fits it.", examples=[500])

    @classmethod
    def of(cls, error: MeshdeformError) -> Self:
        """Return the record of an error."""
        return cls(
            code=error.code, title=error.title, detail=error.detail, advice=error.advice_text, status=error.status
        )


class StoredFile(_Frozen):
    """An uploaded file in the object store."""

    key: str
    filename: str
    size: int
    sha256: str


class Artifact(_Frozen):
    """A stored result of a job."""

    name: str
    content_type: str
    size: int
    sha256: str
    key: str
    created_at: datetime


@dataclass(frozen=True)
class CheckpointRef:
    """Where a checkpoint lies."""

    key: str
    step: int
    attempt: int
    sha256: str


class Job(_Frozen):
    """One request to deform one asset, as the record knows it."""

    id: str
    state: JobState
    request: JobRequest
    asset: StoredFile
    target: StoredFile | None = None
    error: JobError | None = None
    created_at: datetime
    started_at: datetime | None = None
    finished_at: datetime | None = None
    progress: Progress = Field(default_factory=Progress)
    attempt: int = 0
    version: int = 1

    @property
    def kind(self) -> JobKind:
        """What the job does."""
        return self.request.kind

    @property
    def prompt(self) -> str:
        """What the asset shall become."""
        return self.request.prompt

    @property
    def params(self) -> DeformParams:
        """The parameters as they were written."""
        return self.request.params

    @property
    def metadata(self) -> dict[str, Any]:
        """The user's own labels."""
        return dict(self.request.metadata)


@dataclass(frozen=True)
class Page:
    """Some jobs, newest first, and where the next page begins; None at the end."""

    jobs: list[Job]
    next_cursor: str | None
