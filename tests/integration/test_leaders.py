"""One process does what need be done only once, and another one goes on when it is gone."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta

import pytest
import sqlalchemy as sa

from meshdeform.errors import UnavailableError
from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.models import JobState
from meshdeform.record.queue import JobQueue
from meshdeform.record.reconciler import LeaderCandidate, Reconciler
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import leaders
from tests.integration.conftest import DEADLINE_S, new_job
from tests.integration.record_calls import LEASE_S, OVER, claimed, set_to

pytestmark = pytest.mark.both_databases
EVERY_S = 5.0


def candidates(record: JobRecord, count: int, name: str = "work") -> list[LeaderCandidate]:
    return [LeaderCandidate(record.database, name, EVERY_S) for _ in range(count)]


def age(record: JobRecord, seconds: float, name: str = "work") -> None:
    """Let the term be so much older, and its leader silent for as long."""
    with record.database.write() as connection:
        (row,) = connection.execute(sa.select(leaders).where(leaders.c.name == name)).all()
        passed = timedelta(seconds=seconds)
        since = row.watching_since and row.watching_since - passed
        earlier = {"expires_at": row.expires_at - passed, "looked_at": row.looked_at - passed, "watching_since": since}
        connection.execute(sa.update(leaders).where(leaders.c.name == name).values(earlier))


def test_one_of_many_leads_until_its_term_is_over(record: JobRecord) -> None:
    first, second, third = candidates(record, 3)
    assert [each.look() for each in (first, second, third)] == [True, False, False]
    assert first.took_over
    age(record, 1.9 * EVERY_S)
    assert [each.look() for each in (second, first)] == [False, True]
    assert not first.took_over
    age(record, 2.1 * EVERY_S)
    assert [each.look() for each in (third, first, second)] == [True, False, False]
    assert third.took_over
    assert not first.leads


def test_who_resigns_is_followed_at_once_and_by_one(record: JobRecord) -> None:
    first, second, third = candidates(record, 3)
    first.look()
    first.resign()
    assert [each.look() for each in (second, third, first)] == [True, False, False]
    first.resign()  # of what it no longer has
    assert second.look()


def test_a_leader_that_finds_no_answer_goes_on_where_it_was(record: JobRecord, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = candidates(record, 2)
    first.look()

    @contextmanager
    def away() -> Iterator[sa.Connection]:
        raise UnavailableError("away")
        yield

    with monkeypatch.context() as patch:
        patch.setattr(record.database, "write", away)
        with pytest.raises(UnavailableError):
            first.look()
    assert first.look()
    assert not first.took_over
    assert not second.look()
    assert candidates(record, 1, "other work")[0].look()  # elections have nothing to do with each other
    age(record, -3600.0)  # a term given by a clock far ahead does not last
    assert second.look()


def test_the_more_there_are_the_less_often_each_looks(record: JobRecord) -> None:
    for number in range(100):
        record.leases.idle(WorkerIdentity(f"w{number}", "q", "cpu"))
    crowd = record.leases.alive_query("q")
    leader, follower = (LeaderCandidate(record.database, "work", EVERY_S, crowd) for _ in range(2))
    assert leader.look()
    assert leader.pause_s() == EVERY_S
    assert not follower.look()
    pauses = [follower.pause_s() for _ in range(200)]
    # 100 candidates look four times a second together.
    assert 18.0 < min(pauses) < max(pauses) < 32.0
    few, other = candidates(record, 2, "other work")
    few.look()
    other.look()
    assert 3.0 < other.pause_s() < 7.0


@pytest.mark.parametrize(("lived", "attempts"), [(True, 1), (False, 0)])
def test_a_successor_that_lived_blames_silent_workers_and_one_that_has_just_started_waits(
    record: JobRecord, redis_url: str, lived: bool, attempts: int
) -> None:
    queue = JobQueue(redis_url, "test")
    job = claimed(record, new_job(record), OVER)
    before, after = (Reconciler(record, queue, 3, LEASE_S, every_s=EVERY_S) for _ in range(2))
    now = record.upkeep.clock()
    before._watch.now = before._watch.since = now - timedelta(hours=1)
    before._look(before._repairing)
    before._watch.now = before._watch.since = now - timedelta(hours=1)
    before._look(before._repairing)
    if lived:
        after._look(after._repairing)
        after._repairing._first_look = now - timedelta(hours=1)
    # Its last sign of life was while both watched.
    set_to(record, job, lease_expires_at=now - timedelta(seconds=3.0))
    age(record, 2.1 * EVERY_S, "repair test")
    after._look(after._repairing)
    assert after._repairing.took_over
    after._repair()
    found = record.get(job.id)
    assert found.state is (JobState.QUEUED if lived else JobState.RUNNING)
    with record.database.read() as connection:
        assert connection.exec_driver_sql("SELECT lost_attempts FROM jobs").scalar_one() == attempts
    queue.close()


def test_only_the_leader_works_and_another_one_when_it_has_ended(record: JobRecord, redis_url: str) -> None:
    queue = JobQueue(redis_url, "test")
    worked: list[Reconciler] = []

    class Noting(Reconciler):
        def _repair(self) -> None:
            worked.append(self)

    first, second = (Noting(record, queue, 3, LEASE_S, every_s=EVERY_S) for _ in range(2))
    with first:
        deadline = time.monotonic() + DEADLINE_S
        while worked != [first]:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        second._turn(second._repairing, second._repair)
        assert worked == [first]
    second._turn(second._repairing, second._repair)
    assert worked == [first, second]
    queue.close()
