"""Messages to webhooks, `record.deliveries`: written with their events, taken by a sender, and what came of them.

A message is written in the transaction of the event that it tells of: none is lost, none is invented.

Source: the Standard Webhooks specification 1.0.0 (https://www.standardwebhooks.com), "Deliverability and reliability".
"""

from __future__ import annotations

import random
from collections.abc import Collection
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import sqlalchemy as sa

from meshdeform.api.jobs import JobView
from meshdeform.record.counters import Counters
from meshdeform.record.database import Database
from meshdeform.record.ids import new_id
from meshdeform.record.models import Event, Job, WebhookEvent
from meshdeform.record.schema import deliveries, delivery_attempts, webhooks

__all__ = ["RETRY_AFTER_S", "Deliveries", "DueDelivery", "payload_of", "write_deliveries"]

_TYPES = frozenset(event.value for event in WebhookEvent)

RETRY_AFTER_S = (5.0, 300.0, 1800.0, 7200.0, 18_000.0, 36_000.0, 50_400.0, 72_000.0, 86_400.0)
"""Seconds from each attempt that failed to the next one: ten attempts in a little more than three days."""

_TAKEN_S = 120.0
"""How long a delivery belongs to who took it: longer than any attempt. After that it is sent again."""
_JITTER = 0.1
_KEPT_S = 30 * 86_400.0
_BATCH = 500


@dataclass(frozen=True)
class DueDelivery:
    """A delivery that its taker alone may send now.

    Attributes
    ----------
    id, webhook_id : str
    message_id : str
        The `webhook-id` of the message: the same for every attempt and every replay.
    url : str
    payload : dict
    secrets : tuple of str
        What to sign with: the secret, and while it is being changed the one before.
    attempts : int
        How many there were.
    """

    id: str
    webhook_id: str
    message_id: str
    url: str
    payload: dict[str, Any]
    secrets: tuple[str, ...]
    attempts: int


def payload_of(job: Job, event: Event) -> dict[str, Any]:
    """Return the message about an event, by the Standard Webhooks specification: `type`, `timestamp`, `data`."""
    document = JobView.of(job).as_json()
    # The artifacts are recorded after this event, which names them.
    del document["artifacts"]
    return {
        "type": f"job.{event.type}",
        "timestamp": event.at.isoformat().replace("+00:00", "Z"),
        "data": {"seq": event.seq, "job": document, **event.data},
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


class Deliveries:
    """Any number of senders may work at once: each takes what no other one has."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def due(self, limit: int, *, without: Collection[str] = (), each: int = 4) -> list[DueDelivery]:
        """Take deliveries that are due, oldest first.

        Parameters
        ----------
        limit : int
            At most so many.
        without : collection of str
            Webhooks to pass over.
        each : int
            At most so many for one webhook: one that answers slowly must not hold up the others.
        """
        now = self._database.now()
        is_due = sa.and_(deliveries.c.state == "pending", deliveries.c.next_at <= now)
        with self._database.read() as connection:
            # Almost always there is nothing, and then nobody need wait for a write lock.
            if connection.execute(sa.select(deliveries.c.id).where(is_due).limit(1)).first() is None:
                return []
        enabled = sa.select(webhooks.c.id).where(webhooks.c.disabled_at.is_(None))
        place = sa.func.row_number().over(partition_by=deliveries.c.webhook_id, order_by=deliveries.c.id)
        wanted = sa.and_(is_due, deliveries.c.webhook_id.in_(enabled), deliveries.c.webhook_id.not_in(sorted(without)))
        placed = sa.select(deliveries.c.id, place.label("place")).where(wanted).subquery()
        chosen = sa.select(placed.c.id).where(placed.c.place <= each)
        # Two that choose the same rows: the second one passes over those that the first one has locked, and those
        # that it has already taken are not due any more.
        free = sa.select(deliveries.c.id).where(deliveries.c.id.in_(chosen), is_due).order_by(deliveries.c.next_at)
        free_now = free.limit(limit).with_for_update(skip_locked=True).cte("free_now")
        take = sa.update(deliveries).where(deliveries.c.id.in_(sa.select(free_now.c.id)), is_due)
        take = take.values(next_at=self._database.now(_TAKEN_S)).returning(deliveries)
        with self._database.write() as connection:
            self._drop(connection, sa.and_(is_due, deliveries.c.webhook_id.not_in(enabled)))
            taken = sorted(connection.execute(take).all(), key=lambda row: row.id)
            both = sa.case((webhooks.c.previous_until > now, webhooks.c.previous_secret)).label("other_secret")
            query = sa.select(webhooks, both).where(webhooks.c.id.in_({row.webhook_id for row in taken}))
            targets = {row.id: row for row in connection.execute(query)}
        return [_due(row, targets[row.webhook_id]) for row in taken if row.webhook_id in targets]

    def give_back(self, taken: DueDelivery) -> None:
        """Let somebody else send it: this one did not get to it."""
        with self._database.write() as connection:
            connection.execute(sa.update(deliveries).where(_still(taken)).values(next_at=self._database.now()))

    def succeeded(self, taken: DueDelivery, *, at: datetime, status: int, seconds: float) -> None:
        """Write down that the message has arrived. Who was too late, or whose webhook is gone, writes nothing."""
        with self._database.write() as connection:
            if self._close(connection, taken, "delivered", None):
                self._log(connection, taken, at, status, None, seconds)
                self._count(connection, "delivered")

    def failed(
        self,
        taken: DueDelivery,
        *,
        at: datetime,
        status: int | None,
        error: str,
        seconds: float,
        retry_after_s: float = 0.0,
    ) -> None:
        """Write down that the message has not arrived, and when to try again, if at all.

        Parameters
        ----------
        taken : DueDelivery
        at : datetime
        status : int, optional
            Of the answer, if there was one. `410 Gone` disables the webhook.
        error : str
        seconds : float
        retry_after_s : float
            What the receiver asked for; the schedule never waits less, and never longer than its longest wait.
        """
        again = status != 410 and taken.attempts < len(RETRY_AFTER_S)
        next_at = None
        if again:
            delay = max(RETRY_AFTER_S[taken.attempts], min(retry_after_s, RETRY_AFTER_S[-1]))
            next_at = self._database.now(delay * (1.0 + random.uniform(0.0, _JITTER)))  # noqa: S311 - no secret
        with self._database.write() as connection:
            if status == 410:
                # The webhook first: two whose deliveries both meet it would wait for each other's.
                held = sa.select(webhooks.c.id).where(webhooks.c.id == taken.webhook_id)
                connection.execute(held.with_for_update(key_share=True))
            if not self._close(connection, taken, "pending" if again else "failed", next_at):
                return
            self._log(connection, taken, at, status, error, seconds)
            if status == 410:
                self.disable(connection, taken.webhook_id, "the receiver answered 410 Gone")
            self._count(connection, "retried" if again else "failed")

    def delete_old_deliveries(self) -> int:
        """Forget deliveries that are 30 days old, some at a time; return how many there were."""
        old = sa.and_(deliveries.c.created_at < self._database.now(-_KEPT_S), deliveries.c.state != "pending")
        with self._database.read() as connection:
            found = list(connection.scalars(sa.select(deliveries.c.id).where(old).limit(_BATCH)))
        if not found:
            return 0
        with self._database.write() as connection:
            gone = sa.delete(deliveries).where(deliveries.c.id.in_(found), old).returning(deliveries.c.id)
            return len(connection.execute(gone).all())

    def _close(self, connection: sa.Connection, taken: DueDelivery, state: str, next_at: Any) -> bool:
        values = {"state": state, "attempts": taken.attempts + 1, "next_at": next_at}
        change = sa.update(deliveries).where(_still(taken)).values(values).returning(deliveries.c.id)
        return connection.execute(change).first() is not None

    def _log(
        self,
        connection: sa.Connection,
        taken: DueDelivery,
        at: datetime,
        status: int | None,
        error: str | None,
        seconds: float,
    ) -> None:
        values = {
            "delivery_id": taken.id,
            "number": taken.attempts + 1,
            "at": at,
            "status": status,
            "error": error[:500] if error else None,
            "seconds": seconds,
        }
        connection.execute(sa.insert(delivery_attempts).values(values))

    def disable(self, connection: sa.Connection, webhook_id: str, reason: str) -> None:
        """Tell a webhook of nothing more, within a transaction: its pending deliveries fail."""
        enabled = sa.and_(webhooks.c.id == webhook_id, webhooks.c.disabled_at.is_(None))
        values = {"disabled_at": self._database.now(), "disabled_reason": reason}
        connection.execute(sa.update(webhooks).where(enabled).values(values))
        self._drop(connection, sa.and_(deliveries.c.webhook_id == webhook_id, deliveries.c.state == "pending"))

    def _drop(self, connection: sa.Connection, which: sa.ColumnElement[bool]) -> None:
        # In one order, so that two that drop the same ones never wait in a circle.
        held = sa.select(deliveries.c.id).where(which).order_by(deliveries.c.id).with_for_update().cte("held")
        change = sa.update(deliveries).where(deliveries.c.id.in_(sa.select(held.c.id)), deliveries.c.state == "pending")
        change = change.values(state="failed", next_at=None)
        if count := len(connection.execute(change.returning(deliveries.c.id)).all()):
            self._count(connection, "failed", count)

    def _count(self, connection: sa.Connection, label: str, count: int = 1) -> None:
        counters = Counters(self._database, connection)
        counters.add("webhook_deliveries", label, count)
        counters.write()


def _still(taken: DueDelivery) -> sa.ColumnElement[bool]:
    """Whether nobody else has tried it since it was taken."""
    return sa.and_(
        deliveries.c.id == taken.id, deliveries.c.state == "pending", deliveries.c.attempts == taken.attempts
    )


def _due(row: sa.Row[Any], webhook: sa.Row[Any]) -> DueDelivery:
    return DueDelivery(
        id=row.id,
        webhook_id=row.webhook_id,
        message_id=row.replay_of or row.id,
        url=webhook.url,
        payload=row.payload,
        secrets=tuple(filter(None, (webhook.secret, webhook.other_secret))),
        attempts=row.attempts,
    )
