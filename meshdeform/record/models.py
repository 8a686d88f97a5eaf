"""A job and what belongs to it, as frozen values. Needs nothing but pydantic: the client shares it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field

from meshdeform.errors import MeshdeformError
from meshdeform.requests.document import DeformParams, JobKind, JobRequest

__all__ = [
    "TERMINAL_STATES",
    "Artifact",
    "CheckpointRef",
    "Claim",
    "Event",
    "EventType",
    "Job",
    "JobError",
    "JobState",
    "NewJob",
    "Origin",
    "OriginMode",
    "Page",
    "Progress",
    "StoredFile",
    "WebhookEvent",
]


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


class EventType(StrEnum):
    """What can happen to a job. The last four end it; a job has exactly one of them."""

    QUEUED = "queued"
    STARTED = "started"
    PROGRESS = "progress"
    CHECKPOINT = "checkpoint"
    RECOVERED = "recovered"
    CANCELING = "canceling"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELED = "canceled"
    EXPIRED = "expired"

    @property
    def terminal(self) -> bool:
        """Whether it is the job's last event."""
        return self in {EventType(state.value) for state in TERMINAL_STATES}


class WebhookEvent(StrEnum):
    """What a webhook can be told of: everything but progress and checkpoints, which are many."""

    QUEUED = "job.queued"
    STARTED = "job.started"
    RECOVERED = "job.recovered"
    CANCELING = "job.canceling"
    SUCCEEDED = "job.succeeded"
    FAILED = "job.failed"
    CANCELED = "job.canceled"
    EXPIRED = "job.expired"


class OriginMode(StrEnum):
    """How a job continues another one."""

    RETRY = "retry"
    BRANCH = "branch"


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


class Origin(_Frozen):
    """What a job begins from that continues another one.

    Attributes
    ----------
    job_id : str
        The other job. It may be deleted since.
    step : int
        Steps that it had done.
    mode : OriginMode
        `retry`: the same request goes on, as if never interrupted. `branch`: another request begins with that shape.
    key, sha256 : str
        The object with the copy of its checkpoint; empty where there was none and the retry begins at the start.
    """

    job_id: str
    step: int
    mode: OriginMode
    key: str = ""
    sha256: str = ""


class Event(_Frozen):
    """Something that happened to a job."""

    job_id: str
    seq: int
    type: EventType
    at: datetime
    attempt: int
    data: dict[str, Any]


@dataclass(frozen=True)
class CheckpointRef:
    """Where a checkpoint lies, and the mesh of that step where it was stored."""

    key: str
    step: int
    attempt: int
    sha256: str
    size: int = 0
    mesh_key: str | None = None
    mesh_sha256: str | None = None
    mesh_size: int | None = None
    created_at: datetime | None = None


class Job(_Frozen):
    """One request to deform one asset, as the record knows it."""

    id: str
    state: JobState
    request: JobRequest
    resolved: dict[str, Any] | None = None
    """The parameters that run, every one with its value; None for jobs of older versions."""
    asset: StoredFile
    target: StoredFile | None = None
    error: JobError | None = None
    created_at: datetime
    started_at: datetime | None = None
    finished_at: datetime | None = None
    progress: Progress = Field(default_factory=Progress)
    attempt: int = 0
    version: int = 1
    owner_id: str = ""
    origin: Origin | None = None
    deadline_at: datetime | None = None
    retain_until: datetime | None = None
    oom_attempts: int = 0
    event_seq: int = 0
    request_id: str | None = None
    traceparent: str | None = None
    artifacts: tuple[Artifact, ...] = ()
    """The results of a job that has succeeded, by name; read by `JobRecord.get` and `list_jobs` only."""

    @property
    def kind(self) -> JobKind:
        """What the job does."""
        return self.request.kind

    @property
    def prompt(self) -> str:
        """What the asset should become."""
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
class Claim:
    """An idempotency key that a request holds."""

    owner_id: str
    key: str
    token: str


@dataclass(frozen=True)
class NewJob:
    """What a new job is made of.

    Attributes
    ----------
    request : JobRequest
    asset, target : StoredFile
        Stored by now.
    owner_id : str
        Whose it is; empty where keys are off.
    origin : Origin, optional
        What it begins from.
    retention_s : float, optional
        What holds where the request says nothing.
    max_active : int
        Unfinished jobs that the owner may have with this one; 0: any number.
    request_id, traceparent : str, optional
        The HTTP request that made it, for logs and traces.
    resolved : BaseModel, optional
        What the request's parameters came to when they were checked.
    claim : Claim, optional
        The idempotency key of the HTTP request; its answer is written with the job.
    """

    request: JobRequest
    asset: StoredFile
    target: StoredFile | None = None
    owner_id: str = ""
    origin: Origin | None = None
    retention_s: float | None = None
    max_active: int = 0
    request_id: str | None = None
    traceparent: str | None = None
    resolved: BaseModel | None = None
    claim: Claim | None = None


@dataclass(frozen=True)
class Page:
    """Some jobs, newest first, and where the next page begins; None at the end."""

    jobs: list[Job]
    next_cursor: str | None
