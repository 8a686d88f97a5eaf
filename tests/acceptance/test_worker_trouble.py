"""A real supervisor and a real worker process in trouble: no memory on the device, a step that hangs, an outage."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from meshdeform.record.models import JobState
from tests.acceptance.cluster import Cluster, deployed
from tests.acceptance.service import until
from tests.cases import each_case
from tests.fake_worker import TROUBLE_AT

pytestmark = pytest.mark.acceptance

STEPS = 12


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """One whose worker is out of memory once, and whose jobs have two attempts and turns of a second."""
    folder = tmp_path_factory.mktemp("usual")
    trouble = {"FAKE_OOM_ONCE": str(folder / "once"), "FAKE_FROZEN": str(folder / "frozen")}
    with deployed(folder) as made:
        made.start_worker(MESHDEFORM_MAX_ATTEMPTS="2", MESHDEFORM_TURN_S="1", **trouble)
        yield made


def test_a_device_without_memory_gets_a_clean_context_and_the_job_goes_on(usual: Cluster) -> None:
    # Two attempts may be lost: this one is none.
    worker = usual.parts["worker"]
    first = worker.child().pid
    job = usual.check(usual.submit(STEPS, prompt="ooms once"), steps=STEPS)
    assert (job.attempt, job.oom_attempts) == (2, 1)
    events = usual.events(job.id)
    assert TROUBLE_AT - 1 in [e.data["step"] for e in events if e.type == "checkpoint" and e.attempt == 1]
    assert [e.data["reason"] for e in events if e.type == "queued"][1:] == ["out_of_memory"]
    assert "ended with exit code 75; starting it again in 0 s" in worker.log
    assert worker.child().pid != first


def test_a_step_that_hangs_is_killed_and_fails_the_job_at_last(cluster: Cluster) -> None:
    cluster.start_worker(MESHDEFORM_STEP_TIMEOUT_S="4", MESHDEFORM_MAX_ATTEMPTS="2")
    job = cluster.check(cluster.submit(STEPS, prompt="hangs"), state=JobState.FAILED)
    assert job.error is not None
    assert (job.error.code, job.attempt) == ("worker_lost", 2)
    cluster.check(cluster.submit(STEPS), steps=STEPS)


@each_case("trouble", ["hangs", "freezes"])
def test_a_cancellation_does_not_wait_for_a_step_that_does_not_end(usual: Cluster, trouble: str) -> None:
    """The record has one end of the job, in one attempt, and the next job has a worker."""
    worker = usual.parts["worker"]
    job_id = usual.submit(STEPS, prompt=trouble)
    if trouble == "hangs":
        usual.at_step(job_id, TROUBLE_AT - 1)
    else:
        until("it is frozen", (usual.folder / "frozen").exists)
    process = worker.child()
    usual.record.request_cancel(job_id)
    job = usual.check(job_id, state=JobState.CANCELED)
    assert job.attempt == 1
    assert [e.type for e in usual.events(job_id)].count("canceled") == 1
    until("the process is replaced", lambda: not process.is_running() and worker.child())
    usual.check(usual.submit(STEPS), steps=STEPS)
    assert usual.job(job_id) == job


def test_the_time_of_a_job_is_over_also_while_it_writes(usual: Cluster) -> None:
    job = usual.check(usual.submit(STEPS, prompt="never ends", max_run_s=1.0), state=JobState.FAILED)
    assert job.error is not None
    assert (job.error.code, job.attempt) == ("run_time_exceeded", 1)
    assert job.error.detail == "The job has run for the 1 s that it may run, and was writing."
    usual.check(usual.submit(STEPS), steps=STEPS)


def test_a_job_that_writes_for_long_makes_room_for_one_that_has_waited(usual: Cluster) -> None:
    long = usual.submit(STEPS, prompt="never ends")
    until("it writes", lambda: usual.job(long).progress.phase == "writing")
    urgent = usual.submit(STEPS, priority=1)
    usual.check(urgent, steps=STEPS)
    until("it is tried again", lambda: usual.job(long).attempt == 2)
    assert [e.data["reason"] for e in usual.events(long) if e.type == "queued"][1:] == ["handed_over"]
    usual.record.request_cancel(long)
    usual.check(long, state=JobState.CANCELED)


def test_a_worker_starts_works_and_stops_while_redis_is_away(cluster: Cluster) -> None:
    cluster.redis.kill()
    worker = cluster.start_worker()
    cluster.check(cluster.submit(STEPS), steps=STEPS)
    assert worker.stop() == 0


# Signals at the worst moment


STORM = """
# At each bytecode of whatever handles the first signal comes another one, as when a supervisor with several threads
# is killed and the kernel tells of each thread's death.
import signal, sys
from tests.fake_worker import engine
from worker.process import main

def in_a_handler(frame, event, argument):
    frame.f_trace_opcodes = True
    if event == "opcode":
        signal.raise_signal(signal.SIGTERM)
    return in_a_handler

def at_a_call(frame, event, argument):
    return in_a_handler if frame.f_code.co_name == "request_stop" or frame.f_back.f_trace is in_a_handler else None

sys.settrace(at_a_call)
sys.exit(main(engine))
"""


def test_a_burst_of_signals_in_the_midst_of_a_job_ends_the_worker_in_order(cluster: Cluster) -> None:
    gate, job_id = cluster.folder / "gate", cluster.submit(20)
    worker = cluster._start(
        "worker", [sys.executable, "-c", STORM], {"MESHDEFORM_FAILPOINTS": f"worker.step=pause@3:{gate}"}
    )
    until("the worker is there", Path(f"{gate}.reached").exists)
    worker.send(signal.SIGTERM)
    Path(f"{gate}.go").touch()
    assert worker.process.wait(timeout=240) == 0
    assert cluster.job(job_id).state == JobState.QUEUED
