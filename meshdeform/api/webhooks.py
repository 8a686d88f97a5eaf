"""Webhooks as the HTTP API shows them, and the messages as receivers get them."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field

from meshdeform.api.jobs import JobView
from meshdeform.record.models import JobError, WebhookEvent
from meshdeform.record.webhooks import Delivery, DeliveryAttempt, Webhook
from meshdeform.webhooks.addresses import MAX_URL

__all__ = [
    "AttemptView",
    "DeliveryDetail",
    "DeliveryList",
    "DeliveryState",
    "DeliveryView",
    "JobMessage",
    "NewWebhook",
    "WebhookChange",
    "WebhookEvent",
    "WebhookList",
    "WebhookView",
    "WebhookWithSecret",
]

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
    model_config = ConfigDict(frozen=True, extra="ignore")


class NewWebhook(_Body):
    """A webhook to be."""

    url: str = Field(
        min_length=1,
        max_length=MAX_URL,
        description="Where messages go: an https URL whose host has only public addresses.",
        examples=[_URL],
    )
    events: list[WebhookEvent] = Field(
        default_factory=list,
        max_length=len(WebhookEvent),
        description="Types to send. Default: every one.",
        examples=[["job.succeeded", "job.failed"]],
    )


class WebhookChange(_Body):
    """What to change; the rest stays."""

    url: str | None = Field(
        None, min_length=1, max_length=MAX_URL, description="Where messages go from now on.", examples=[_URL]
    )
    events: list[WebhookEvent] | None = Field(
        None,
        max_length=len(WebhookEvent),
        description="Types to send; an empty list means every one.",
        examples=[["job.succeeded"]],
    )
    enabled: bool | None = Field(
        None,
        description="`false`: it is told of nothing, and what is pending fails. `true`: it is told of events again.",
        examples=[True],
    )


class WebhookView(_Document):
    """A webhook."""

    id: str = Field(description="Sorts by the time of creation.", examples=[_WEBHOOK])
    url: str = Field(description="Where messages go.", examples=[_URL])
    events: list[WebhookEvent] = Field(
        description="Types that are sent; an empty list means every one.", examples=[["job.succeeded"]]
    )
    enabled: bool = Field(description="Whether it is told of events.", examples=[True])
    disabled_at: datetime | None = Field(None, description="Since when it is not, UTC.", examples=[_TIME])
    disabled_reason: str | None = Field(None, description="Why it is not.", examples=["the receiver answered 410 Gone"])
    rotation_ends_at: datetime | None = Field(
        None, description="Until when the secret before the newest signs too, UTC.", examples=[_TIME]
    )
    created_at: datetime = Field(description="UTC.", examples=[_TIME])

    @classmethod
    def of(cls, webhook: Webhook, **more: Any) -> Self:
        """Return what is told about a webhook."""
        return cls(
            id=webhook.id,
            url=webhook.url,
            events=[WebhookEvent(event) for event in webhook.events],
            enabled=webhook.disabled_at is None,
            disabled_at=webhook.disabled_at,
            disabled_reason=webhook.disabled_reason,
            rotation_ends_at=webhook.previous_until,
            created_at=webhook.created_at,
            **more,
        )


class WebhookWithSecret(WebhookView):
    """A webhook with its secret, which no other answer tells."""

    secret: str = Field(
        description="Verifies the messages' signatures. Keep it: it is not told again.", examples=[_SECRET]
    )


class WebhookList(_Document):
    """The caller's webhooks, oldest first."""

    webhooks: list[WebhookView] = Field(description="All of them.")


class DeliveryView(_Document):
    """One message to a webhook."""

    id: str = Field(description="Sorts by the time of creation.", examples=[_DELIVERY])
    webhook_id: str = Field(description="To whom.", examples=[_WEBHOOK])
    message_id: str = Field(
        description="The header `webhook-id`: the same for every attempt and every replay.", examples=[_DELIVERY]
    )
    replay_of: str | None = Field(
        None, description="The first delivery of the message, where this one sends it again.", examples=[_DELIVERY]
    )
    type: str = Field(description="The message's type.", examples=["job.succeeded"])
    job_id: str | None = Field(None, description="The job that it tells of.", examples=[_JOB])
    state: DeliveryState = Field(
        description="`delivered` and `failed` never change; `replay` makes a new delivery.", examples=["delivered"]
    )
    attempt_count: int = Field(ge=0, description="How often it was tried.", examples=[1])
    next_at: datetime | None = Field(
        None, description="When it is tried (again), UTC; null once it is over.", examples=[_TIME]
    )
    created_at: datetime = Field(description="UTC.", examples=[_TIME])

    @classmethod
    def of(cls, delivery: Delivery, **more: Any) -> Self:
        """Return what is told about a delivery."""
        return cls(
            id=delivery.id,
            webhook_id=delivery.webhook_id,
            message_id=delivery.replay_of or delivery.id,
            replay_of=delivery.replay_of,
            type=delivery.type,
            job_id=delivery.job_id or None,
            state=delivery.state,
            attempt_count=delivery.attempts,
            next_at=delivery.next_at,
            created_at=delivery.created_at,
            **more,
        )


class DeliveryList(_Document):
    """A page of deliveries, newest first."""

    deliveries: list[DeliveryView] = Field(description="The deliveries of this page.")
    next_cursor: str | None = Field(
        None, description="Give it as `cursor` to get the next page; null on the last one.", examples=["bXNnXzAxa2c5"]
    )


class AttemptView(_Document):
    """One try at a delivery."""

    number: int = Field(ge=1, description="Which try.", examples=[1])
    at: datetime = Field(description="When it began, UTC.", examples=[_TIME])
    status: int | None = Field(None, description="The status of the answer; null where there was none.", examples=[500])
    error: str | None = Field(
        None, description="Why it does not count as delivered; else null.", examples=["The receiver answered 500."]
    )
    seconds: float = Field(ge=0.0, description="How long it took.", examples=[0.12])

    @classmethod
    def of(cls, attempt: DeliveryAttempt) -> Self:
        """Return what is told about an attempt."""
        return cls(
            number=attempt.number,
            at=attempt.at,
            status=attempt.status,
            error=attempt.error,
            seconds=attempt.seconds,
        )


class DeliveryDetail(DeliveryView):
    """One message to a webhook: what is sent, and every attempt."""

    payload: dict[str, Any] = Field(
        description="The message's body.",
        examples=[{"type": "job.succeeded", "timestamp": _TIME, "data": {"seq": 4}}],
    )
    attempts: list[AttemptView] = Field(description="Every attempt, oldest first.")

    @classmethod
    def of_log(cls, delivery: Delivery) -> Self:
        """Return everything about a delivery."""
        log = [AttemptView.of(attempt) for attempt in delivery.log]
        return cls.of(delivery, payload=delivery.payload, attempts=log)


class JobMessageData(_Document):
    """What a message tells of a job. More members may follow."""

    model_config = ConfigDict(extra="allow")

    seq: int = Field(ge=1, description="The event's number within the job: 1, 2, 3 ...", examples=[4])
    job: JobView = Field(description="The job as the event left it.")
    error: JobError | None = Field(None, description="Why the job failed, in `job.failed`.")


class JobMessage(_Document):
    """The body of a message, by the Standard Webhooks specification."""

    type: WebhookEvent = Field(description="What happened.", examples=["job.succeeded"])
    timestamp: datetime = Field(description="When it happened, UTC.", examples=[_TIME])
    data: JobMessageData = Field(description="The event.")
