"""Idempotency keys of requests, with the hash of the request and the answer, which is written with the job.

Source: the IETF draft "The Idempotency-Key HTTP Header Field", with its three refusals.
"""

from __future__ import annotations

import math
import secrets
from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa

from meshdeform.errors import IdempotencyBusyError, IdempotencyMismatchError
from meshdeform.record.database import Database
from meshdeform.record.models import Claim
from meshdeform.record.schema import idempotency

_HELD_S = 30.0
"""How long a request holds its key, for the case that its process dies. A slower request may lose its key to a
repetition; it is then undone, so that nothing happens twice."""
_MOST_RETRY_S = 5  # the first request may finish at any moment


class IdempotencyLedger:
    """The idempotency keys of all owners and their answers."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def begin(self, owner_id: str, key: str, request_hash: str) -> Claim | dict[str, Any]:
        """Take a key: return the claim, to be completed or abandoned, or the answer to an earlier identical request.

        Raises IdempotencyMismatchError, IdempotencyBusyError: the key was used for a different request, or an identical
        one is in progress.
        """
        token = secrets.token_hex(16)
        now, until = self._database.now(), self._database.now(_HELD_S)
        values = {"request_hash": request_hash, "token": token, "locked_until": until, "created_at": now}
        insert = self._database.upsert(idempotency).values(owner_id=owner_id, key=key, **values)
        with self._database.write() as connection:
            if connection.execute(insert.on_conflict_do_nothing().returning(idempotency.c.key)).first():
                return Claim(owner_id, key, token)
            row = connection.execute(sa.select(idempotency).where(_is(owner_id, key)).with_for_update()).one_or_none()
            if row is None:
                raise IdempotencyBusyError("The key was just released.")
            if row.request_hash != request_hash:
                raise IdempotencyMismatchError("This Idempotency-Key was used for a different request.")
            if row.response is not None:
                return dict(row.response)
            abandoned = sa.and_(_is(owner_id, key), idempotency.c.locked_until < now)
            take = sa.update(idempotency).where(abandoned).values(values).returning(idempotency.c.key)
            if connection.execute(take).first() is None:
                left_s = math.ceil((row.locked_until - datetime.now(UTC)).total_seconds())
                raise IdempotencyBusyError(
                    "The first request with this Idempotency-Key is still in progress, or its server has stopped.",
                    retry_after_s=min(max(1, left_s), _MOST_RETRY_S),
                )
        return Claim(owner_id, key, token)

    def complete(self, claim: Claim, response: dict[str, Any], connection: sa.Connection) -> None:
        """Write the answer within the transaction of the request.

        Raises IdempotencyBusyError: another request has taken over the key; roll the transaction back, so that nothing
        is done twice.
        """
        mine = sa.and_(_is(claim.owner_id, claim.key), idempotency.c.token == claim.token)
        done = sa.update(idempotency).where(mine).values(response=response).returning(idempotency.c.key)
        if connection.execute(done).first() is None:
            raise IdempotencyBusyError("Another request has taken over this Idempotency-Key.")

    def abandon(self, claim: Claim) -> None:
        """Release the key of a refused request, so that it may be repeated."""
        mine = sa.and_(
            _is(claim.owner_id, claim.key), idempotency.c.token == claim.token, idempotency.c.response.is_(None)
        )
        with self._database.write() as connection:
            connection.execute(sa.delete(idempotency).where(mine))


def _is(owner_id: str, key: str) -> sa.ColumnElement[bool]:
    return sa.and_(idempotency.c.owner_id == owner_id, idempotency.c.key == key)
