"""Messages to webhooks, written in the transaction of the event that they tell of: none is lost, none is invented."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

from meshdeform.api.jobs import JobView
from meshdeform.record.database import Database
from meshdeform.record.ids import new_id
from meshdeform.record.models import Event, Job, WebhookEvent
from meshdeform.record.schema import deliveries, webhooks

__all__ = ["payload_of", "write_deliveries"]

_TYPES = frozenset(event.value for event in WebhookEvent)


def payload_of(job: Job, event: Event) -> dict[str, Any]:
    """Return the message about an event, by the Standard Webhooks specification: `type`, `timestamp`, `data`."""
    return {
        "type": f"job.{event.type}",
        "timestamp": event.at.isoformat().replace("+00:00", "Z"),
        "data": {"seq": event.seq, "job": JobView.of(job).as_json(), **event.data},
    }


def write_deliveries(connection: sa.Connection, database: Database, job: Job, event: Event) -> None:
    """Write a message for every webhook of the job's owner that wants to hear of the event."""
    if f"job.{event.type}" not in _TYPES:
        return
    listening = sa.select(webhooks.c.id, webhooks.c.events).where(
        webhooks.c.owner_id == job.owner_id, webhooks.c.disabled_at.is_(None)
    )
    # Held: one that is deleted at the same time is either gone by now or waits until the message is written.
    listening = listening.order_by(webhooks.c.id).with_for_update(read=True, key_share=True)
    for webhook in connection.execute(listening).all():
        if webhook.events and f"job.{event.type}" not in webhook.events:
            continue
        now = database.now()
        values = {
            "id": new_id("msg"),
            "webhook_id": webhook.id,
            "job_id": job.id,
            "type": f"job.{event.type}",
            "payload": payload_of(job, event),
            "state": "pending",
            "attempts": 0,
            "next_at": now,
            "created_at": now,
        }
        connection.execute(sa.insert(deliveries).values(values))
