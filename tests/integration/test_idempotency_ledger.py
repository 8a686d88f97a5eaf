"""Requests that may come twice, on SQLite and PostgreSQL: done once, answered as often as asked."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
import sqlalchemy as sa

from meshdeform.api.jobs import accepted
from meshdeform.errors import IdempotencyBusyError, IdempotencyMismatchError
from meshdeform.record.models import Claim, NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import idempotency
from meshdeform.record.upkeep import IDEMPOTENCY_KEPT_S
from meshdeform.requests.document import JobRequest
from tests.integration.conftest import stored_file

pytestmark = pytest.mark.both_databases


def begun(record: JobRecord, owner: str = "me", key: str = "k", request: str = "hash") -> Claim:
    claim = record.idempotency.begin(owner, key, request)
    assert isinstance(claim, Claim)
    return claim


def done(record: JobRecord, claim: Claim) -> str:
    """Do what a request asks for: a job and its answer, or neither."""
    new = NewJob(
        JobRequest(prompt="a mushroom"), {"asset": stored_file()}, owner_id=claim.owner_id, claim=claim, answer=accepted
    )
    return record.create(new).id


def answer(record: JobRecord) -> dict[str, Any]:
    """What the request that made the newest job was answered with."""
    return accepted(record.list_jobs().jobs[0])


def later(record: JobRecord, seconds: float) -> None:
    """Let time go by for the keys."""
    with record.database.write() as connection:
        for row in connection.execute(sa.select(idempotency)).all():
            is_it = sa.and_(idempotency.c.owner_id == row.owner_id, idempotency.c.key == row.key)
            past = {"locked_until": record.database.now(-seconds), "created_at": record.database.now(-seconds)}
            connection.execute(sa.update(idempotency).where(is_it).values(past))


def test_a_key_is_of_one_owner_and_of_one_request(record: JobRecord) -> None:
    claim = begun(record)
    with pytest.raises(IdempotencyMismatchError):
        record.idempotency.begin("me", "k", "another")
    with pytest.raises(IdempotencyBusyError):
        record.idempotency.begin("me", "k", "hash")
    begun(record, owner="them")
    begun(record, key="K")
    done(record, claim)
    with pytest.raises(IdempotencyMismatchError):
        record.idempotency.begin("me", "k", "another")


def test_a_request_that_was_refused_gives_its_key_free_also_for_another_one(record: JobRecord) -> None:
    claim = begun(record)
    record.idempotency.abandon(claim)
    again = begun(record, request="another")
    # Giving up what one has not any more changes nothing.
    record.idempotency.abandon(claim)
    done(record, again)
    record.idempotency.abandon(again)
    assert record.idempotency.begin("me", "k", "another") == answer(record)


def test_the_key_of_a_request_that_died_is_taken_over_and_what_that_one_does_late_is_undone(record: JobRecord) -> None:
    slow = begun(record)
    later(record, 1.0)
    with pytest.raises(IdempotencyMismatchError):
        record.idempotency.begin("me", "k", "another")
    fresh = begun(record)
    with pytest.raises(IdempotencyBusyError):
        done(record, slow)
    assert record.list_jobs().jobs == []
    record.idempotency.abandon(slow)
    job_id = done(record, fresh)
    with pytest.raises(IdempotencyBusyError):
        done(record, slow)
    assert [job.id for job in record.list_jobs().jobs] == [job_id]
    assert record.idempotency.begin("me", "k", "hash") == answer(record)


def test_of_many_that_come_at_once_one_is_done(record: JobRecord) -> None:
    def post(_: int) -> str:
        try:
            found = record.idempotency.begin("me", "k", "hash")
        except IdempotencyBusyError:
            return "busy"
        return done(record, found) if isinstance(found, Claim) else "answered"

    with ThreadPoolExecutor(8) as pool:
        outcomes = list(pool.map(post, range(24)))
    (job,) = record.list_jobs().jobs
    assert outcomes.count(job.id) == 1
    assert set(outcomes) <= {job.id, "busy", "answered"}


def test_of_many_that_take_over_at_once_one_does(record: JobRecord) -> None:
    begun(record)
    later(record, 1.0)

    def take(_: int) -> bool:
        try:
            return isinstance(record.idempotency.begin("me", "k", "hash"), Claim)
        except IdempotencyBusyError:
            return False

    with ThreadPoolExecutor(8) as pool:
        assert sum(pool.map(take, range(8))) == 1


def test_keys_are_forgotten_after_their_time(record: JobRecord) -> None:
    done(record, begun(record))
    later(record, IDEMPOTENCY_KEPT_S - 60.0)
    record.upkeep.delete_stale_requests()
    assert record.idempotency.begin("me", "k", "hash") == answer(record)
    later(record, IDEMPOTENCY_KEPT_S + 60.0)
    record.upkeep.delete_stale_requests()
    begun(record, request="another")
