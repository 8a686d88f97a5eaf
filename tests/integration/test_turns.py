"""Who runs next, and for how long while others wait: workers that take no time, under a clock that the test moves."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from meshdeform.record.leases import HANDED_OVER, Leases
from meshdeform.record.models import EventType, Job, JobState
from meshdeform.record.repository import JobRecord
from meshdeform.record.turns import Turns
from tests.cases import each_case
from tests.integration.record_calls import LEASE_S, OVER, claimed, ids, posted, set_to

TURN_S, BEAT_S, SHORT_S = 60.0, 5, 4
TURNS = Turns(TURN_S)
BOUND_S = TURN_S + BEAT_S + 1
"""How long a job waits for one that runs: its turn, a heartbeat, and the step that is being done."""


@dataclass
class Worker:
    """A worker, with the job that it runs."""

    leases: Leases
    job: Job | None = None
    age: int = 0
    yields: bool = False


@dataclass
class Simulation:
    """A service whose steps take a second each of a clock of its own."""

    record: JobRecord
    turns: Turns = TURNS
    second: int = 0
    workers: list[Worker] = field(default_factory=list)
    left: dict[str, int] = field(default_factory=dict)
    posted_at: dict[str, int] = field(default_factory=dict)
    started_at: dict[str, int] = field(default_factory=dict)
    served: list[str] = field(default_factory=list)
    hand_overs: int = 0

    def now(self, later_s: float = 0.0) -> datetime:
        return datetime(2026, 1, 1, tzinfo=UTC) + timedelta(seconds=self.second + later_s)

    def post(self, owner: str, seconds: int, priority: int = 0) -> str:
        job = posted(self.record, owner, priority=priority)
        self.left[job.id], self.posted_at[job.id] = seconds, self.second
        return job.id

    def employ(self, count: int) -> None:
        self.workers += [Worker(Leases(self.record.database)) for _ in range(count)]

    def wait_s(self, job_id: str) -> int:
        return self.started_at[job_id] - self.posted_at[job_id]

    def tick(self) -> None:
        """Let every worker do a step."""
        for number, worker in enumerate(self.workers):
            if worker.job is None:
                worker.job = worker.leases.claim_next(f"worker {number}", LEASE_S, self.turns)
                worker.age, worker.yields = 0, False
                if worker.job is not None:
                    self.started_at.setdefault(worker.job.id, self.second)
                    self.served.append(worker.job.owner_id)
        self.second += 1
        for number, worker in enumerate(self.workers):
            if worker.job is not None:
                self._step(worker, worker.job, (self.second + number) % BEAT_S == 0)

    def _step(self, worker: Worker, job: Job, beats: bool) -> None:
        worker.age += 1
        self.left[job.id] -= 1
        if not self.left[job.id]:
            worker.leases.finish(job.id, job.attempt, JobState.SUCCEEDED)
            worker.job = None
        elif worker.yields:
            worker.leases.release(job.id, job.attempt, HANDED_OVER)
            worker.job = None
            self.hand_overs += 1
        elif beats and worker.age >= self.turns.turn_s:
            worker.yields = worker.leases.hand_over(job, self.turns)

    def until_done(self, job_ids: list[str], longest_s: int = 10_000) -> None:
        while any(self.left[each] for each in job_ids):
            assert self.second < longest_s
            self.tick()


@pytest.fixture
def service(record: JobRecord, monkeypatch: pytest.MonkeyPatch) -> Iterator[Simulation]:
    """A service with one worker."""
    made = Simulation(record)
    monkeypatch.setattr(record.database, "now", made.now)
    made.employ(1)
    return made


def test_ten_short_jobs_behind_a_long_one_wait_for_a_turn(service: Simulation) -> None:
    long = service.post("long", 50_000)
    service.tick()
    short = [service.post(f"owner {number % 3}", SHORT_S) for number in range(10)]
    service.until_done(short)
    assert max(map(service.wait_s, short)) <= BOUND_S + 9 * SHORT_S
    assert service.hand_overs == 1
    service.tick()
    assert service.record.get(long).state is JobState.RUNNING
    assert [event.data.get("reason") for event in service.record.events.after(long) if event.type == "queued"] == [
        "created", "handed_over",
    ]  # fmt: skip
    assert service.record.counters()["hand_overs", ""] == 1


@pytest.mark.parametrize(("waiting", "hand_overs"), [(1, 1), (9, 2)])
def test_an_owner_with_all_workers_gives_up_an_equal_share(service: Simulation, waiting: int, hand_overs: int) -> None:
    service.employ(3)
    for _ in range(8):
        service.post("a", 10_000)
    service.tick()
    others = [service.post("b", 10_000) for _ in range(waiting)]
    while service.second < BOUND_S + BEAT_S:
        service.tick()
    assert service.wait_s(others[0]) <= BOUND_S
    assert service.hand_overs == hand_overs
    running = [worker.job.owner_id for worker in service.workers if worker.job]
    assert running.count("b") == hand_overs


def test_nobody_starves(service: Simulation) -> None:
    long = service.post("a", 240)
    short = []
    while service.left[long]:
        if service.second % SHORT_S == 0:  # as many as one worker can run
            short.append(service.post("b", SHORT_S))
        service.tick()
        assert service.second < 240 * 3
    started = [each for each in short if each in service.started_at]
    # Each gets half of the time.
    assert len(started) * SHORT_S > 0.4 * service.second
    assert service.wait_s(started[0]) <= BOUND_S


@pytest.mark.parametrize("limit", [1, 3])
def test_an_owner_runs_as_many_jobs_as_it_may(service: Simulation, limit: int) -> None:
    service.turns = Turns(TURN_S, limit)
    service.employ(4)
    mine = [service.post("a", SHORT_S) for _ in range(7)]
    other = service.post("b", SHORT_S)
    most = 0
    while any(service.left[each] for each in mine):
        service.tick()
        most = max(most, sum(worker.job is not None and worker.job.owner_id == "a" for worker in service.workers))
    assert most == limit
    assert service.wait_s(other) == 0


def test_time_is_counted_over_attempts(service: Simulation) -> None:
    record, job_id = service.record, service.post("a", 50)
    for attempt in (1, 2):
        claimed(record, record.get(job_id), 8.0)
        service.second += 10
        if attempt == 1:
            record.leases.release(job_id, attempt)
        else:  # lost: no longer than its lease
            assert record.upkeep.reclaim_expired(3) == [job_id]
        service.second += 100
    assert record.get(job_id).ran_s == pytest.approx(18.0, abs=0.01)


@pytest.mark.both_databases
def test_a_claim_counts_what_runs_however_many_workers_claim_at_once(record: JobRecord, database_url: str) -> None:
    mine, other = [posted(record, "a") for _ in range(6)], [posted(record, "b") for _ in range(2)]
    records = [JobRecord(database_url) for _ in range(6)]
    try:
        with ThreadPoolExecutor(len(records)) as pool:
            claims = [pool.submit(each.leases.claim_next, "worker", LEASE_S, Turns(max_running=2)) for each in records]
            taken = [claim.result() for claim in claims]
    finally:
        for each in records:
            each.close()
    assert sorted(job.owner_id for job in taken if job) == ["a", "a", "b", "b"]
    assert record.upkeep.queued_count(9) == 4
    # Nobody is to be told of jobs that may not start.
    assert (record.upkeep.queued_count(9, 2), record.upkeep.queued_ids(9, 2)) == (0, [])
    done = next(job for job in taken if job and job.owner_id == "a")
    record.leases.finish(done.id, done.attempt, JobState.SUCCEEDED)
    again = record.leases.claim_next("worker", LEASE_S, Turns(max_running=2))
    assert again is not None
    assert again.id in ids(mine)
    assert len(other) == 2


@pytest.mark.both_databases
def test_a_job_is_handed_over_once_to_one_that_has_waited(record: JobRecord) -> None:
    running = claimed(record, posted(record, "a"))
    second = claimed(record, posted(record, "a"))
    waiting = posted(record, "b")
    assert not record.leases.hand_over(running, TURNS)
    set_to(record, waiting, created_at=record.database.now(-2 * TURN_S))
    assert record.leases.hand_over(running, TURNS)
    assert not record.leases.hand_over(running, TURNS)
    assert not record.leases.hand_over(second, TURNS)  # there is room for it already
    record.leases.release(running.id, 1, HANDED_OVER)
    set_to(record, running, created_at=record.database.now(-9 * TURN_S))
    taken = [record.leases.claim_next("worker", LEASE_S, TURNS) for _ in range(2)]
    assert [job.id for job in taken if job] == [waiting.id, running.id]
    assert record.get(running.id).ran_s > 0.0
    assert [event.type for event in record.events.after(running.id)].count(EventType.STARTED) == 2


@pytest.mark.both_databases
@each_case(
    ("owners", "waiting", "changed", "room"),
    [
        ("a", {"owner_id": "b"}, {}, True),
        ("a", {"owner_id": "b"}, {"retry_at": 60.0}, False),
        ("a", {"owner_id": "b"}, {"kind": "of another version"}, False),
        ("a", {"owner_id": "a"}, {}, False),
        ("a", {"owner_id": "a", "priority": 1}, {}, True),
        ("ab", {"owner_id": "b"}, {}, False),
        ("aab", {"owner_id": "b"}, {}, True),
    ],
)
def test_room_is_made_for_whom_it_is_due(
    record: JobRecord, owners: str, waiting: dict[str, Any], changed: dict[str, Any], room: bool
) -> None:
    """Not for a job that may not start, and for one of the same owner only if it is more urgent."""
    for job in record.list_jobs(JobState.QUEUED).jobs:
        record.request_cancel(job.id)
    running = [claimed(record, posted(record, owner)) for owner in owners]
    if "retry_at" in changed:
        changed = {"retry_at": record.database.now(changed["retry_at"])}
    made = posted(record, **waiting)
    set_to(record, made, created_at=record.database.now(-2 * TURN_S), **changed)
    assert record.leases.hand_over(running[0], TURNS) is room
    if not room and changed:
        assert record.leases.claim_next("worker", LEASE_S, TURNS) is None
    for job in running:
        record.leases.finish(job.id, 1, JobState.SUCCEEDED)


@pytest.mark.both_databases
def test_an_attempt_that_is_over_hands_nothing_over(record: JobRecord) -> None:
    lost = claimed(record, posted(record, "a"), OVER)
    set_to(record, posted(record, "b"), created_at=record.database.now(-2 * TURN_S))
    record.upkeep.reclaim_expired(3)
    assert not record.leases.hand_over(lost, TURNS)
