"""Define the HTTP API's documents of webhooks, and the messages that receivers get."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from meshdeform.api.jobs import JobView
from meshdeform.api.states import JobError
from meshdeform.api.states import WebhookEvent as WebhookEvent
from meshdeform.outgoing.addresses import MAX_URL

_TIME = "2026-01-31T12:00:00Z"
_URL = "https://example.com/meshdeform"
_WEBHOOK = "wh_01kg9zqk2xf3v8c5m7n9p1r4t6"
_DELIVERY = "msg_01kg9zqk2xf3v8c5m7n9p1r4t7"
_JOB = "job_01kg9zqk2xf3v8c5m7n9p1r4t6"
_SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSwMfKQ9r8GKYo="  # noqa: S105 - an example

DeliveryState = Literal["pending", "delivered", "failed"]


class _Body(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class _Document(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", from_attributes=True)


class NewWebhook(_Body):
    """A webhook to create."""

    url: str = Field(
        min_length=1,
        max_length=MAX_URL,
        description="Where to send messages: an https URL whose host has only public addresses.",
        examples=[_URL],
    )
    events: list[WebhookEvent] = Field(
        default_factory=list,
        max_length=len(WebhookEvent),
        description="Event types to send. Default: all.",
        examples=[["job.succeeded", "job.failed"]],
    )


class WebhookChange(_Body):
    """The changes to a webhook; members left out do not change."""

    url: str | None = Field(
        None, min_length=1, max_length=MAX_URL, description="Where to send messages from now on.", examples=[_URL]
    )
    events: list[WebhookEvent] | None = Field(
        None,
        max_length=len(WebhookEvent),
        description="Event types to send; an empty list means all.",
        examples=[["job.succeeded"]],
    )
    enabled: bool | None = Field(
        None,
        description="`false`: it gets no events, and pending deliveries fail. `true`: it gets events again.",
        examples=[True],
    )


class WebhookSecret(_Document):
    """The secret of an account."""

    secret: str = Field(description="Signs messages to webhooks of single jobs.", examples=[_SECRET])


class WebhookView(_Document):
    """A webhook."""

    id: str = Field(description="Sorts by the time of creation.", examples=[_WEBHOOK])
    url: str = Field(description="Where messages are sent.", examples=[_URL])
    events: list[WebhookEvent] = Field(
        description="Event types to send; an empty list means all.", examples=[["job.succeeded"]]
    )
    enabled: bool = Field(description="Whether it gets events.", examples=[True])
    disabled_at: datetime | None = Field(None, description="When it was disabled, UTC.", examples=[_TIME])
    disabled_reason: str | None = Field(
        None, description="Why it was disabled.", examples=["the receiver answered 410 Gone"]
    )
    rotation_ends_at: datetime | None = Field(
        None, description="Until when the previous secret also signs messages, UTC.", examples=[_TIME]
    )
    created_at: datetime = Field(description="UTC.", examples=[_TIME])


class WebhookWithSecret(WebhookView):
    """A webhook with its secret, which no other response contains."""

    secret: str = Field(
        description="Verifies the messages' signatures. Store it: it is not shown again.", examples=[_SECRET]
    )


class WebhookList(_Document):
    """The caller's webhooks, oldest first."""

    webhooks: list[WebhookView] = Field(description="All of them.")


class DeliveryView(_Document):
    """The delivery of a message to a webhook."""

    id: str = Field(description="Sorts by the time of creation.", examples=[_DELIVERY])
    webhook_id: str = Field(description="The receiving webhook.", examples=[_WEBHOOK])
    message_id: str = Field(
        description="The header `webhook-id`: the same for every attempt and every replay.", examples=[_DELIVERY]
    )
    replay_of: str | None = Field(
        None, description="The first delivery of the message, if this one repeats it.", examples=[_DELIVERY]
    )
    type: str = Field(description="The message's type.", examples=["job.succeeded"])
    job_id: str | None = Field(None, description="The job that the message is about.", examples=[_JOB])
    state: DeliveryState = Field(
        description="`delivered` and `failed` never change; `replay` creates a new delivery.", examples=["delivered"]
    )
    attempt_count: int = Field(ge=0, description="Number of attempts so far.", examples=[1])
    next_at: datetime | None = Field(
        None, description="When the next attempt is due, UTC; null once it is delivered or failed.", examples=[_TIME]
    )
    created_at: datetime = Field(description="UTC.", examples=[_TIME])


class DeliveryList(_Document):
    """A page of deliveries, newest first."""

    deliveries: list[DeliveryView] = Field(description="The deliveries of this page.")
    next_cursor: str | None = Field(
        None, description="Pass it as `cursor` to get the next page; null on the last one.", examples=["bXNnXzAxa2c5"]
    )


class AttemptView(_Document):
    """An attempt at a delivery."""

    number: int = Field(ge=1, description="Number of the attempt.", examples=[1])
    at: datetime = Field(description="When it began, UTC.", examples=[_TIME])
    status: int | None = Field(None, description="The response's status; null if there was none.", examples=[500])
    error: str | None = Field(
        None, description="Why the attempt failed; else null.", examples=["The receiver answered 500."]
    )
    seconds: float = Field(ge=0.0, description="How long it took.", examples=[0.12])


class DeliveryDetail(DeliveryView):
    """The delivery of a message to a webhook, with the message and all attempts."""

    payload: dict[str, Any] = Field(
        description="The message's body.",
        examples=[{"type": "job.succeeded", "timestamp": _TIME, "data": {"seq": 4}}],
    )
    attempts: list[AttemptView] = Field(description="Every attempt, oldest first.")


class JobMessageData(_Document):
    """The data of a message about a job. More members may be added."""

    model_config = ConfigDict(extra="allow")

    seq: int = Field(ge=1, description="The event's number within the job: 1, 2, 3 ...", examples=[4])
    job: JobView = Field(description="The job after the event.")
    error: JobError | None = Field(None, description="Why the job failed, in `job.failed`.")


class JobMessage(_Document):
    """The body of a message, following the Standard Webhooks specification."""

    type: WebhookEvent = Field(description="Kind of event.", examples=["job.succeeded"])
    timestamp: datetime = Field(description="When it happened, UTC.", examples=[_TIME])
    data: JobMessageData = Field(description="The event.")
