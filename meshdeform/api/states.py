"""Define the states, events, progress and errors of jobs, for record, service and client."""

from __future__ import annotations

from enum import StrEnum
from typing import Self

from pydantic import BaseModel, ConfigDict, Field

from meshdeform.errors import MeshdeformError


class JobState(StrEnum):
    """The state of a job. The last four are terminal: such a job never changes again."""

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
    """The type of an event. The last four end the job; a finished job has exactly one of them."""

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
    """The events that can be sent to webhooks: all except progress and checkpoints, which are frequent."""

    QUEUED = "job.queued"
    STARTED = "job.started"
    RECOVERED = "job.recovered"
    CANCELING = "job.canceling"
    SUCCEEDED = "job.succeeded"
    FAILED = "job.failed"
    CANCELED = "job.canceled"
    EXPIRED = "job.expired"


class OriginMode(StrEnum):
    """The way in which a job continues another one."""

    RETRY = "retry"
    BRANCH = "branch"


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True)


class Progress(_Frozen):
    """The progress of a job."""

    step: int = Field(0, ge=0, description="Optimiser steps done.", examples=[120])
    total_steps: int = Field(0, ge=0, description="Optimiser steps in all; 0 until known.", examples=[300])
    fraction: float = Field(
        0.0, ge=0.0, le=1.0, description="Share of the work done, 0 to 1. Never goes back.", examples=[0.4]
    )
    phase: str = Field("queued", description="Current phase, in a word.", examples=["optimizing"])
    losses: dict[str, float] = Field(
        default_factory=dict, description="The newest value of each loss.", examples=[{"guidance": 0.21}]
    )
    eta_s: float | None = Field(
        None,
        ge=0.0,
        description="Seconds left, by the pace so far and what the mesh costs after the last step; null until known.",
        examples=[9.5],
    )
    attempt: int = Field(0, ge=0, description="Which try this is; 0 before the first.", examples=[1])


class JobError(_Frozen):
    """The error of a failed job."""

    code: str = Field(description="Stable: programs compare it.", examples=["worker_lost"])
    title: str = Field(
        description="The same sentence for every occurrence.", examples=["Every attempt lost its worker"]
    )
    detail: str = Field(description="About this occurrence.", examples=["3 of 3 attempts lost their worker."])
    advice: str = Field(description="Advice.", examples=["See the workers' logs."])
    status: int = Field(500, description="The HTTP status that fits it.", examples=[500])

    @classmethod
    def of(cls, error: MeshdeformError) -> Self:
        """Return the record of an error."""
        return cls(
            code=error.code, title=error.title, detail=error.detail, advice=error.advice_text, status=error.status
        )
