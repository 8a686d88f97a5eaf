"""Messages to webhooks, `record.deliveries`: written with their events, taken by a sender, with their outcomes.

A message is written in the transaction of its event, so that none is lost and none is sent without an event.

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

_TYPES = frozenset(event.value for event in WebhookEvent)

RETRY_AFTER_S = (5.0, 300.0, 1800.0, 7200.0, 18_000.0, 36_000.0, 50_400.0, 72_000.0, 86_400.0)
"""Seconds from each failed attempt to the next one: ten attempts in a little more than three days."""

_TAKEN_S = 120.0
"""Seconds that a delivery is reserved for its taker, longer than any attempt; after that it is sent again."""
_JITTER = 0.1
_KEPT_S = 30 * 86_400.0
_BATCH = 500
_LISTENING = (
    sa.select(webhooks.c.id, webhooks.c.events)
    .where(webhooks.c.owner_id == sa.bindparam("owner"), webhooks.c.disabled_at.is_(None))
    .where(sa.or_(webhooks.c.job_id.is_(None), webhooks.c.job_id == sa.bindparam("job")))
    .order_by(webhooks.c.id)
    # Locked: a concurrent deletion has either happened or waits until the message is written.
    .with_for_update(read=True, key_share=True)
)


@dataclass(frozen=True)
class DueDelivery:
    """A delivery reserved for its taker.

    `message_id` is the `webhook-id`: the same for every attempt and every replay. `secrets` are the current one, and
    the previous one for a day after a change. `attempts` counts earlier attempts.
    """

    id: str
    webhook_id: str
    owner_id: str
    message_id: str
    url: str
    payload: dict[str, Any]
    secrets: tuple[str, ...]
    attempts: int


def payload_of(job: Job, event: Event) -> dict[str, Any]:
    """Return the message of an event as the Standard Webhooks specification defines it: `type`, `timestamp`, `data`."""
    document = JobView.of(job).as_json()
    # The artifacts are recorded after this event, which names them; what can read the request is another process.
    del document["artifacts"], document["unreadable"]
    return {
        "type": f"job.{event.type}",
        "timestamp": event.at.isoformat().replace("+00:00", "Z"),
        "data": {"seq": event.seq, "job": document, **event.data},
    }


def write_deliveries(connection: sa.Connection, database: Database, job: Job, event: Event) -> None:
    """Write a message for every webhook of the job, or of its owner, that subscribes to the event."""
    if f"job.{event.type}" not in _TYPES:
        return
    for webhook in connection.execute(_LISTENING, {"owner": job.owner_id, "job": job.id}).all():
        if webhook.events and f"job.{event.type}" not in webhook.events:
            continue
        connection.execute(new_delivery(database, webhook.id, f"job.{event.type}", payload_of(job, event), job.id))


def new_delivery(
    database: Database,
    webhook_id: str,
    kind: str,
    payload: dict[str, Any],
    job_id: str = "",
    replay_of: str | None = None,
) -> sa.Insert:
    """Return the statement that adds a message to a webhook, which is due at once."""
    now = database.now()
    return sa.insert(deliveries).values(
        id=new_id("msg"),
        webhook_id=webhook_id,
        job_id=job_id,
        replay_of=replay_of,
        type=kind,
        payload=payload,
        state="pending",
        attempts=0,
        next_at=now,
        created_at=now,
    )


class Deliveries:
    """The deliveries of all webhooks. Any number of senders may work at once, each on its own deliveries."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def due(
        self,
        limit: int,
        *,
        without: Collection[str] = (),
        without_owners: Collection[str] = (),
        each: int = 4,
        each_owner: int = 4,
    ) -> list[DueDelivery]:
        """Take due deliveries: the first of each owner, then the second, and so on, each time the oldest first.

        Those of the webhooks and owners in `without` and `without_owners` are skipped. At most `each` for one webhook
        and `each_owner` for one owner are taken, so that slow ones do not block the others.
        """
        now = self._database.now()
        is_due = sa.and_(deliveries.c.state == "pending", deliveries.c.next_at <= now)
        with self._database.read() as connection:
            # Usually nothing is due, and no write lock is needed.
            if connection.execute(sa.select(deliveries.c.id).where(is_due).limit(1)).first() is None:
                return []
        enabled = sa.select(webhooks.c.id).where(webhooks.c.disabled_at.is_(None))
        condition = sa.and_(
            is_due,
            webhooks.c.disabled_at.is_(None),
            deliveries.c.webhook_id.not_in(sorted(without)),
            webhooks.c.owner_id.not_in(sorted(without_owners)),
        )
        ranked = _ranked(condition, each)
        # Of two senders that choose the same rows, the second one skips those locked by the first one; those already
        # taken are no longer due.
        free = sa.select(deliveries.c.id).join(ranked, ranked.c.id == deliveries.c.id)
        free = free.where(ranked.c.owner_rank <= each_owner, is_due)
        free = free.order_by(ranked.c.owner_rank, deliveries.c.next_at, deliveries.c.id).limit(limit)
        free_now = free.with_for_update(skip_locked=True, of=deliveries).cte("free_now")
        take = sa.update(deliveries).where(deliveries.c.id.in_(sa.select(free_now.c.id)), is_due)
        take = take.values(next_at=self._database.now(_TAKEN_S)).returning(deliveries)
        with self._database.write() as connection:
            self._drop(connection, sa.and_(is_due, deliveries.c.webhook_id.not_in(enabled)))
            rows = sorted(connection.execute(take).all(), key=lambda row: row.id)
            both = sa.case((webhooks.c.previous_until > now, webhooks.c.previous_secret)).label("other_secret")
            query = sa.select(webhooks, both).where(webhooks.c.id.in_({row.webhook_id for row in rows}))
            targets = {row.id: row for row in connection.execute(query)}
        return [_due(row, targets[row.webhook_id]) for row in rows if row.webhook_id in targets]

    def give_back(self, delivery: DueDelivery) -> None:
        """Make a delivery due again that was taken but not sent."""
        with self._database.write() as connection:
            connection.execute(sa.update(deliveries).where(_still(delivery)).values(next_at=self._database.now()))

    def succeeded(self, delivery: DueDelivery, *, at: datetime, status: int, seconds: float) -> None:
        """Record a success. Nothing is written if another sender has taken the message or the webhook was deleted."""
        with self._database.write() as connection:
            if self._close(connection, delivery, "delivered", None):
                self._log(connection, delivery, at, status, None, seconds)
                self._count(connection, "delivered")

    def failed(
        self,
        delivery: DueDelivery,
        *,
        at: datetime,
        status: int | None,
        error: str,
        seconds: float,
        retry_after_s: float = 0.0,
    ) -> None:
        """Record a failure and the time of the next attempt, if any. The status `410 Gone` disables the webhook.

        `retry_after_s` is what the receiver asks for: it prolongs the wait, up to the longest one of the schedule.
        """
        again = status != 410 and delivery.attempts < len(RETRY_AFTER_S)
        next_at = None
        if again:
            delay = max(RETRY_AFTER_S[delivery.attempts], min(retry_after_s, RETRY_AFTER_S[-1]))
            next_at = self._database.now(delay * (1.0 + random.uniform(0.0, _JITTER)))  # noqa: S311 - no secret
        with self._database.write() as connection:
            if status == 410:
                # Lock the webhook first: two senders that both receive 410 would otherwise deadlock.
                held = sa.select(webhooks.c.id).where(webhooks.c.id == delivery.webhook_id)
                connection.execute(held.with_for_update(key_share=True))
            if not self._close(connection, delivery, "pending" if again else "failed", next_at):
                return
            self._log(connection, delivery, at, status, error, seconds)
            if status == 410:
                self.disable(connection, delivery.webhook_id, "the receiver answered 410 Gone")
            self._count(connection, "retried" if again else "failed")

    def delete_old_deliveries(self) -> int:
        """Delete a batch of deliveries older than 30 days; return their number."""
        old = sa.and_(deliveries.c.created_at < self._database.now(-_KEPT_S), deliveries.c.state != "pending")
        with self._database.read() as connection:
            ids = list(connection.scalars(sa.select(deliveries.c.id).where(old).limit(_BATCH)))
        if not ids:
            return 0
        with self._database.write() as connection:
            deleted = sa.delete(deliveries).where(deliveries.c.id.in_(ids), old).returning(deliveries.c.id)
            return len(connection.execute(deleted).all())

    def _close(self, connection: sa.Connection, delivery: DueDelivery, state: str, next_at: Any) -> bool:
        values = {"state": state, "attempts": delivery.attempts + 1, "next_at": next_at}
        change = sa.update(deliveries).where(_still(delivery)).values(values).returning(deliveries.c.id)
        return connection.execute(change).first() is not None

    def _log(
        self,
        connection: sa.Connection,
        delivery: DueDelivery,
        at: datetime,
        status: int | None,
        error: str | None,
        seconds: float,
    ) -> None:
        values = {
            "delivery_id": delivery.id,
            "number": delivery.attempts + 1,
            "at": at,
            "status": status,
            "error": error[:500] if error else None,
            "seconds": seconds,
        }
        connection.execute(sa.insert(delivery_attempts).values(values))

    def disable(self, connection: sa.Connection, webhook_id: str, reason: str) -> None:
        """Disable a webhook within a transaction; its pending deliveries fail."""
        enabled = sa.and_(webhooks.c.id == webhook_id, webhooks.c.disabled_at.is_(None))
        values = {"disabled_at": self._database.now(), "disabled_reason": reason}
        connection.execute(sa.update(webhooks).where(enabled).values(values))
        self._drop(connection, sa.and_(deliveries.c.webhook_id == webhook_id, deliveries.c.state == "pending"))

    def _drop(self, connection: sa.Connection, which: sa.ColumnElement[bool]) -> None:
        # Lock in a fixed order, so that two transactions that drop the same deliveries cannot deadlock.
        held = sa.select(deliveries.c.id).where(which).order_by(deliveries.c.id).with_for_update().cte("held")
        change = sa.update(deliveries).where(deliveries.c.id.in_(sa.select(held.c.id)), deliveries.c.state == "pending")
        change = change.values(state="failed", next_at=None)
        if count := len(connection.execute(change.returning(deliveries.c.id)).all()):
            self._count(connection, "failed", count)

    def _count(self, connection: sa.Connection, label: str, count: int = 1) -> None:
        counters = Counters(self._database, connection)
        counters.add("webhook_deliveries", label, count)
        counters.write()


def _ranked(condition: sa.ColumnElement[bool], each: int) -> sa.Subquery:
    """Return the first deliveries of each webhook, with their ranks (1, 2, 3 ...) among those of their owner."""
    rank = sa.func.row_number().over(partition_by=deliveries.c.webhook_id, order_by=deliveries.c.id)
    query = sa.select(deliveries.c.id, webhooks.c.owner_id, rank.label("rank"))
    first = query.join(webhooks, webhooks.c.id == deliveries.c.webhook_id).where(condition).subquery()
    # An owner's webhooks in turn, so that a slow one does not take the places of the others.
    order = (first.c.rank, first.c.id)
    owner_rank = sa.func.row_number().over(partition_by=first.c.owner_id, order_by=order)
    return sa.select(first.c.id, owner_rank.label("owner_rank")).where(first.c.rank <= each).subquery()


def _still(delivery: DueDelivery) -> sa.ColumnElement[bool]:
    """Return the condition that no other sender has tried the delivery since it was taken."""
    return sa.and_(
        deliveries.c.id == delivery.id, deliveries.c.state == "pending", deliveries.c.attempts == delivery.attempts
    )


def _due(row: sa.Row[Any], webhook: sa.Row[Any]) -> DueDelivery:
    return DueDelivery(
        id=row.id,
        webhook_id=row.webhook_id,
        owner_id=webhook.owner_id,
        message_id=row.replay_of or row.id,
        url=webhook.url,
        payload=row.payload,
        secrets=tuple(filter(None, (webhook.secret, webhook.other_secret))),
        attempts=row.attempts,
    )
