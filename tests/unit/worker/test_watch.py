"""Beside the optimisation: the lease is kept, progress is published and a cancel is heard, whatever else fails."""

from __future__ import annotations

import contextlib
import datetime as dt
import threading
import time
from collections.abc import Iterator

import pytest

from meshdeform.errors import StaleAttemptError, UnavailableError
from meshdeform.record.leases import WorkerIdentity
from meshdeform.record.models import Job, JobState, Progress, StoredFile
from meshdeform.runs.base import StepReport
from tests.waiting import until
from worker.watch import JobWatch, StepTimer

JOB = Job(
    id="job_1",
    state=JobState.RUNNING,
    document={"prompt": "a vase"},
    files={"asset": StoredFile(key="assets/0", filename="a.glb", size=1, sha256="0")},
    attempt=2,
    created_at=dt.datetime(2026, 1, 1, tzinfo=dt.UTC),
)


WORKER = WorkerIdentity("a worker", "meshdeform", "cpu")


class RecordStub:
    """The three calls that a watch makes, remembered; `failing` is raised by each while it is set."""

    def __init__(self) -> None:
        self.beats: list[float] = []
        self.with_progress: list[float] = []  # leases renewed by progress
        self.signs = 0  # of life of the worker
        self.progress: list[Progress] = []
        self.told: list[Progress] = []
        self.threads: set[str] = set()
        self.state = JobState.RUNNING
        self.failing: Exception | None = None

    def heartbeat(self, job_id: str, attempt: int, lease_s: float, *, worker: WorkerIdentity | None) -> JobState:
        self._called(job_id, attempt)
        assert worker in (WORKER, None)
        self.beats.append(lease_s)
        self.signs += worker is not None
        return self.state

    def save_progress(
        self, job_id: str, attempt: int, progress: Progress, *, as_event: bool, lease_s: float | None
    ) -> JobState:
        self._called(job_id, attempt)
        self.progress.append(progress)
        if as_event:
            self.told.append(progress)
        if lease_s is not None:
            self.with_progress.append(lease_s)
        return self.state

    def _called(self, job_id: str, attempt: int) -> None:
        assert (job_id, attempt) == (JOB.id, JOB.attempt)
        self.threads.add(threading.current_thread().name)
        if self.failing:
            raise self.failing


class Ear:
    """A listener that hears when it is told to."""

    def __init__(self) -> None:
        self.heard = threading.Event()
        self.closed = False

    def wait(self, timeout_s: float) -> bool:
        return self.heard.wait(timeout_s)

    @contextlib.contextmanager
    def listen(self) -> Iterator[Ear]:
        yield self
        self.closed = True


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worker.watch.PUBLISH_EVERY_S", 0.01)


@pytest.fixture
def record() -> RecordStub:
    return RecordStub()


@pytest.fixture
def ear() -> Ear:
    return Ear()


def watch_of(record: RecordStub, ear: Ear, job: Job = JOB, lease_s: float = 30.0) -> JobWatch:
    return JobWatch(record, WORKER, job, ear.listen, lease_s)  # type: ignore[arg-type]


def step(n: int, total: int = 100) -> StepReport:
    return StepReport(n, total, {"total": 1.0 / n})


def test_the_newest_step_is_published_and_only_from_the_thread(record: RecordStub, ear: Ear) -> None:
    with watch_of(record, ear) as watch:
        watch.phase("optimizing", step=0, total_steps=100)
        for n in range(1, 51):
            watch.step(step(n))
        until(lambda: bool(record.progress) and record.progress[-1].step == 50)
    last = record.progress[-1]
    assert (last.total_steps, last.fraction, last.phase, last.attempt) == (100, 0.5, "optimizing", 2)
    assert last.losses == {"total": 0.02}
    assert last.eta_s is not None
    assert record.threads == {"watch job_1"}
    until(lambda: ear.closed)


def test_a_job_that_was_handed_over_keeps_its_step_while_it_starts_again(record: RecordStub, ear: Ear) -> None:
    job = JOB.model_copy(update={"progress": Progress(step=30, total_steps=100, fraction=0.3)})
    with watch_of(record, ear, job):
        until(lambda: bool(record.progress))
    first = record.progress[0]
    assert (first.step, first.total_steps, first.fraction, first.phase) == (30, 100, 0.3, "loading")


def test_what_comes_after_the_last_step_is_part_of_the_time_left(record: RecordStub, ear: Ear) -> None:
    with JobWatch(record, WORKER, JOB, ear.listen, 30.0, end_s=50.0) as watch:  # type: ignore[arg-type]
        watch.phase("optimizing", step=0, total_steps=2)
        watch.step(step(1, 2))
        watch.step(step(2, 2))
        until(lambda: bool(record.progress) and record.progress[-1].eta_s == 50.0)
        watch.phase("writing")
        until(lambda: record.progress[-1].phase == "writing")
        assert record.progress[-1].eta_s == 50.0
        watch.phase("uploading")
    assert record.progress[-1].eta_s == 0.0


def test_a_heartbeat_that_is_due_with_progress_is_one_write_with_it(record: RecordStub, ear: Ear) -> None:
    with watch_of(record, ear, lease_s=0.06) as watch:
        for n in range(1, 10_000):
            watch.step(step(n, 10_000))
            if len(record.with_progress) > 5:
                break
            time.sleep(0.002)
    assert set(record.with_progress) == {0.06}
    # Only the first one was more: the sign of life of the worker itself is not renewed as often as so short a lease.
    assert record.signs == 1


def test_a_cancellation_is_seen_in_the_answer_to_progress_too(record: RecordStub, ear: Ear) -> None:
    with watch_of(record, ear) as watch:
        until(lambda: bool(record.beats))
        record.state = JobState.CANCELING
        watch.step(step(1))
        until(lambda: watch.canceled)


def test_the_lease_is_kept_while_a_step_takes_long_and_nothing_else_is_written(record: RecordStub, ear: Ear) -> None:
    with watch_of(record, ear, lease_s=0.06):
        until(lambda: len(record.beats) > 5)
    assert set(record.beats) == {0.06}
    assert len(record.progress) == 1


def test_a_cancel_that_the_record_does_not_confirm_is_not_believed(record: RecordStub, ear: Ear) -> None:
    ear.heard.set()
    with watch_of(record, ear) as watch:
        until(lambda: len(record.beats) > 3)
        assert not watch.canceled
        record.state = JobState.CANCELING
        until(lambda: watch.canceled)


def test_the_end_does_not_wait_for_the_cancel_listener(record: RecordStub, ear: Ear) -> None:
    ear.wait = lambda timeout_s: ear.heard.wait(60.0)  # type: ignore[method-assign]
    with watch_of(record, ear) as watch:
        watch.step(step(100))
        watch.phase("uploading")
    last = record.progress[-1]  # which is never lost
    assert (last.step, last.fraction, last.phase) == (100, 1.0, "uploading")
    assert not ear.closed
    ear.heard.set()
    until(lambda: ear.closed)


def test_a_job_without_a_cancel_listener_goes_on_and_is_canceled_all_the_same(record: RecordStub, ear: Ear) -> None:
    def deaf() -> contextlib.AbstractContextManager[Ear]:
        raise RuntimeError("no Redis client")

    ear.listen = deaf  # type: ignore[method-assign]
    with watch_of(record, ear, lease_s=0.06) as watch:
        until(lambda: len(record.beats) > 1)
        assert not watch.lost
        assert not watch.canceled
        record.state = JobState.CANCELING
        until(lambda: watch.canceled)


def test_a_job_that_is_claimed_while_it_is_being_canceled_is_canceled(record: RecordStub, ear: Ear) -> None:
    assert watch_of(record, ear, JOB.model_copy(update={"state": JobState.CANCELING})).canceled


def test_a_lost_lease_ends_the_watch(record: RecordStub, ear: Ear) -> None:
    record.failing = StaleAttemptError("gone")
    with watch_of(record, ear) as watch:
        until(lambda: watch.lost)
    record.failing = None
    assert record.progress == []


def test_an_outage_of_the_record_is_outlived(record: RecordStub, ear: Ear) -> None:
    record.failing = UnavailableError("the record does not answer")
    with watch_of(record, ear, lease_s=0.06) as watch:
        watch.step(step(7))
        until(lambda: len(record.threads) > 0)
        record.failing = None
        until(lambda: bool(record.progress) and record.progress[-1].step == 7)
        assert not watch.lost


def test_few_of_many_steps_become_events(record: RecordStub, ear: Ear) -> None:
    with watch_of(record, ear) as watch:
        watch.phase("optimizing", step=0, total_steps=10_000)
        for n in (1, 49, 50, 99, 100, 5000):
            until(lambda: not watch._thread.is_alive() or record.progress[-1:] == [watch._latest])
            watch.step(step(n, 10_000))
        until(lambda: record.progress[-1].step == 5000)
        watch.phase("writing")
    steps = [progress.step for progress in record.progress if progress.phase != "loading"]
    assert steps == [0, 1, 49, 50, 99, 100, 5000, 5000], "the row has them all"
    told = [(progress.phase, progress.step) for progress in record.told if progress.phase != "loading"]
    assert told == [("optimizing", n) for n in (0, 50, 100, 5000)] + [("writing", 5000)]


def test_a_slow_job_is_told_of_every_few_seconds(record: RecordStub, ear: Ear, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worker.watch._EVENT_EVERY_S", 0.0)
    with watch_of(record, ear) as watch:
        for n in (1, 2, 3):
            watch.step(step(n, 10_000))
            until(lambda n=n: record.progress[-1].step == n)  # type: ignore[misc]
    assert [progress.step for progress in record.told][-3:] == [1, 2, 3]


def test_losses_that_are_not_finite_are_left_out(record: RecordStub, ear: Ear) -> None:
    with watch_of(record, ear) as watch:
        watch.step(StepReport(1, 2, {"total": float("nan"), "guidance": 1.0}))
    assert record.progress[-1].losses == {"guidance": 1.0}


def test_the_estimate_follows_the_steps_and_leaves_the_warm_up_out() -> None:
    now = 100.0
    timer = StepTimer(lambda: now)
    assert timer.left_s(10) is None
    now += 30.0  # the first step compiles and allocates
    timer.tick()
    assert timer.left_s(10) is None
    for taken in (2.0, 4.0):
        now += taken
        timer.tick()
    assert timer.left_s(10) == pytest.approx(30.0)
    now += 1000.0  # a pause between phases is no step
    timer.start()
    for _ in range(200):
        now += 0.5
        timer.tick()
    assert timer.left_s(10) == pytest.approx(5.0, rel=1e-3)
