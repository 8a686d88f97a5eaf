"""Webhooks of owners and the log of their messages: `record.webhooks`.

`deliveries.py` writes messages with their events and gives them to senders.
"""

from __future__ import annotations

import base64
import hmac
import secrets
from collections.abc import Callable, Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import ConflictError, NotFoundError, RequestError
from meshdeform.record.database import Database
from meshdeform.record.deliveries import Deliveries, new_delivery
from meshdeform.record.ids import decode_cursor, encode_cursor, new_id
from meshdeform.record.rows import read
from meshdeform.record.schema import deliveries, delivery_attempts, webhooks

MAX_WEBHOOKS = 20
"""Maximum number of webhooks of one owner, because each costs a row per event."""
TEST_EVENT = "meshdeform.test"
"""The type of test messages, sent on request whatever events a webhook subscribes to."""

_KEEP_S = 86_400.0


@dataclass(frozen=True)
class Webhook:
    """A webhook without its secret, which is shown only when it is created."""

    id: str
    owner_id: str
    url: str
    events: tuple[str, ...]
    created_at: datetime
    rotation_ends_at: datetime | None
    disabled_at: datetime | None
    disabled_reason: str | None

    @property
    def enabled(self) -> bool:
        """Whether it gets events."""
        return self.disabled_at is None


@dataclass(frozen=True)
class DeliveryAttempt:
    """One attempt at a delivery: the status of the response, or why there is none."""

    number: int
    at: datetime
    status: int | None
    error: str | None
    seconds: float


@dataclass(frozen=True)
class Delivery:
    """One message to one webhook.

    `pending` becomes `delivered` or `failed`, which never change. `replay_of` names the first delivery of a repeated
    message. In a list of deliveries, `attempts` is empty.
    """

    id: str
    webhook_id: str
    job_id: str | None
    replay_of: str | None
    type: str
    payload: dict[str, Any]
    state: str
    attempt_count: int
    next_at: datetime | None
    created_at: datetime
    attempts: tuple[DeliveryAttempt, ...] = ()

    @property
    def message_id(self) -> str:
        """The header `webhook-id`: the same for every attempt and every replay."""
        return self.replay_of or self.id


@dataclass(frozen=True)
class DeliveryPage:
    """A page of deliveries, newest first, and the cursor of the next page; None at the end."""

    deliveries: list[Delivery]
    next_cursor: str | None


class WebhookBook:
    """Every webhook. Each look-up names the owner, so that those of other owners are not found (`NotFoundError`)."""

    def __init__(self, database: Database, messages: Deliveries, secret: Callable[[str], bytes]) -> None:
        self._database, self._messages, self._secret = database, messages, secret

    def create(self, owner: str, url: str, events: Collection[str] = ()) -> tuple[Webhook, str]:
        """Create an enabled webhook for types of events (empty: all), and return it with its secret.

        The secret cannot be retrieved again. The address must already be checked (`meshdeform.outgoing.addresses`).
        `RequestError`: the owner has too many.
        """
        secret = _new_secret()
        values = {
            "id": new_id("wh"),
            "owner_id": owner,
            "url": url,
            "events": _types(events),
            "secret": secret,
            "created_at": self._database.now(),
        }
        with self._database.write() as connection:
            self._database.serialise(connection, f"webhooks {owner}")
            own = sa.select(sa.func.count()).select_from(webhooks).where(_of_account(owner))
            if connection.execute(own).scalar_one() >= MAX_WEBHOOKS:
                raise RequestError(
                    f"You have {MAX_WEBHOOKS} webhooks, the maximum.", advice="Delete one that you do not need."
                )
            row = connection.execute(sa.insert(webhooks).values(values).returning(webhooks)).one()
        return _webhook(row), secret

    def account_secret(self, owner: str) -> str:
        """Return the secret that signs messages to the webhooks of an owner's single jobs: the same at any time."""
        digest = hmac.digest(self._secret("webhooks"), owner.encode(), "sha256")
        return "whsec_" + base64.b64encode(digest).decode()

    def of_job(self, job_id: str, owner: str, url: str, events: Collection[str]) -> dict[str, Any]:
        """Return the row of the webhook that a job's request names; it is deleted with the job, and not listed."""
        return {
            "id": new_id("wh"),
            "owner_id": owner,
            "url": url,
            "events": _types(events),
            "secret": self.account_secret(owner),
            "created_at": self._database.now(),
            "job_id": job_id,
        }

    def get(self, webhook_id: str, owner: str) -> Webhook:
        """Return a webhook."""
        with self._database.read() as connection:
            return _webhook(_find(connection, webhook_id, owner))

    def list_webhooks(self, owner: str) -> list[Webhook]:
        """Return the owner's webhooks, oldest first."""
        query = sa.select(webhooks).where(_of_account(owner)).order_by(webhooks.c.id)
        with self._database.read() as connection:
            return [_webhook(row) for row in connection.execute(query)]

    def update(
        self,
        webhook_id: str,
        owner: str,
        *,
        url: str | None = None,
        events: Collection[str] | None = None,
        enabled: bool | None = None,
    ) -> Webhook:
        """Change the given properties. A disabled webhook receives nothing, and its pending deliveries fail."""
        values: dict[str, Any] = {}
        if url is not None:
            values["url"] = url
        if events is not None:
            values["events"] = _types(events)
        if enabled:
            values |= {"disabled_at": None, "disabled_reason": None}
        held = sa.select(webhooks.c.id).where(_is(webhook_id, owner)).with_for_update(key_share=True)
        with self._database.write() as connection:
            if connection.execute(held).first() is None:
                raise _missing(webhook_id)
            if values:
                connection.execute(sa.update(webhooks).where(_is(webhook_id, owner)).values(values))
            if enabled is False:
                self._messages.disable(connection, webhook_id, "disabled by its owner")
            return _webhook(_find(connection, webhook_id, owner))

    def rotate(self, webhook_id: str, owner: str) -> tuple[Webhook, str]:
        """Create a new secret. The previous one also signs for a day; older ones no longer do."""
        secret = _new_secret()
        values = {
            "previous_secret": webhooks.c.secret,
            "previous_until": self._database.now(_KEEP_S),
            "secret": secret,
        }
        change = sa.update(webhooks).where(_is(webhook_id, owner)).values(values).returning(webhooks)
        with self._database.write() as connection:
            row = connection.execute(change).one_or_none()
        if row is None:
            raise _missing(webhook_id)
        return _webhook(row), secret

    def delete(self, webhook_id: str, owner: str) -> None:
        """Delete a webhook with its log. A message that is being sent may still arrive."""
        deleted = sa.delete(webhooks).where(_is(webhook_id, owner)).returning(webhooks.c.id)
        with self._database.write() as connection:
            if connection.execute(deleted).first() is None:
                raise _missing(webhook_id)

    def deliveries(
        self, webhook_id: str, owner: str, *, state: str | None = None, cursor: str | None = None, limit: int = 50
    ) -> DeliveryPage:
        """Return a page of sent and pending deliveries, newest first; `ParameterError`: the cursor is not valid."""
        query = sa.select(deliveries).where(deliveries.c.webhook_id == webhook_id).order_by(deliveries.c.id.desc())
        if state is not None:
            query = query.where(deliveries.c.state == state)
        if cursor is not None:
            query = query.where(deliveries.c.id < decode_cursor(cursor, "msg"))
        with self._database.read() as connection:
            _find(connection, webhook_id, owner)
            listed = [_delivery(row) for row in connection.execute(query.limit(limit + 1))]
        more = len(listed) > limit
        return DeliveryPage(listed[:limit], encode_cursor(listed[limit - 1].id) if more else None)

    def delivery(self, webhook_id: str, delivery_id: str, owner: str) -> Delivery:
        """Return a delivery with its attempts."""
        tried = sa.select(delivery_attempts).where(delivery_attempts.c.delivery_id == delivery_id)
        with self._database.read() as connection:
            _find(connection, webhook_id, owner)
            row = _find_delivery(connection, webhook_id, delivery_id)
            log = connection.execute(tried.order_by(delivery_attempts.c.number)).all()
        return _delivery(row, tuple(read(DeliveryAttempt, attempt) for attempt in log))

    def replay(self, webhook_id: str, delivery_id: str, owner: str) -> Delivery:
        """Send a message again as a new delivery; `ConflictError`: it is still pending, or the webhook is disabled.

        By the specification the identifier belongs to the event, so that the new delivery has the `webhook-id` of the
        first one, and a receiver that has processed it ignores the repetition.
        """
        with self._database.write() as connection:
            webhook = _find(connection, webhook_id, owner)
            row = _find_delivery(connection, webhook_id, delivery_id)
            if row.state == "pending":
                raise ConflictError(
                    "The delivery is still pending.", advice="Wait: it is retried automatically.", state=row.state
                )
            first = row.replay_of or row.id
            new = new_delivery(self._database, webhook_id, row.type, row.payload, row.job_id, replay_of=first)
            return self._add(connection, webhook, new)

    def send_test(self, webhook_id: str, owner: str) -> Delivery:
        """Send a message of the type `meshdeform.test`, whatever events the webhook subscribes to.

        `ConflictError`: it is disabled.
        """
        payload = {
            "type": TEST_EVENT,
            "timestamp": datetime.now(UTC).isoformat().replace("+00:00", "Z"),
            "data": {"webhook_id": webhook_id},
        }
        with self._database.write() as connection:
            new = new_delivery(self._database, webhook_id, TEST_EVENT, payload)
            return self._add(connection, _find(connection, webhook_id, owner), new)

    def _add(self, connection: sa.Connection, webhook: sa.Row[Any], new: sa.Insert) -> Delivery:
        if webhook.disabled_at is not None:
            raise ConflictError(
                "The webhook is disabled: nothing is sent to it.",
                advice="Enable it first, with PATCH.",
                state="disabled",
            )
        return _delivery(connection.execute(new.returning(deliveries)).one())


def _new_secret() -> str:
    # The specification asks for 24 to 64 random bytes.
    return "whsec_" + base64.b64encode(secrets.token_bytes(32)).decode()


def _types(events: Collection[str]) -> list[str]:
    return sorted(set(events))


def _is(webhook_id: str, owner: str) -> sa.ColumnElement[bool]:
    return sa.and_(webhooks.c.id == webhook_id, _of_account(owner))


def _of_account(owner: str) -> sa.ColumnElement[bool]:
    """Return the condition that a webhook is the owner's for all jobs, not one that a job's request named."""
    return sa.and_(webhooks.c.owner_id == owner, webhooks.c.job_id.is_(None))


def _missing(webhook_id: str) -> NotFoundError:
    return NotFoundError(f"There is no webhook {webhook_id!r}.", advice="Check the id: GET /v1/webhooks lists yours.")


def _find(connection: sa.Connection, webhook_id: str, owner: str) -> sa.Row[Any]:
    row = connection.execute(sa.select(webhooks).where(_is(webhook_id, owner))).one_or_none()
    if row is None:
        raise _missing(webhook_id)
    return row


def _find_delivery(connection: sa.Connection, webhook_id: str, delivery_id: str) -> sa.Row[Any]:
    query = sa.select(deliveries).where(deliveries.c.id == delivery_id, deliveries.c.webhook_id == webhook_id)
    row = connection.execute(query).one_or_none()
    if row is None:
        raise NotFoundError(
            f"The webhook has no delivery {delivery_id!r}.", advice="Deliveries are kept for 30 days after they end."
        )
    return row


def _webhook(row: sa.Row[Any]) -> Webhook:
    return read(Webhook, row, events=tuple(row.events), rotation_ends_at=row.previous_until)


def _delivery(row: sa.Row[Any], log: tuple[DeliveryAttempt, ...] = ()) -> Delivery:
    return read(Delivery, row, job_id=row.job_id or None, attempt_count=row.attempts, attempts=log)
