"""The queue on a real Redis, and what mends it when Redis forgets or workers fall silent."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import redis
from rq import Queue
from rq.serializers import JSONSerializer

from meshdeform.errors import DependencyError, UnavailableError
from meshdeform.jobs.cleanup import remove_unreachable
from meshdeform.jobs.models import JobState
from meshdeform.jobs.queue import TASK, JobQueue
from meshdeform.jobs.reconciler import Reconciler
from meshdeform.jobs.record import JobRecord
from meshdeform.storage import ObjectStore
from tests.integration.conftest import DEADLINE_S, new_job, stored_file
from tests.servers import free_port


@pytest.fixture
def queue(redis_url: str) -> Iterator[JobQueue]:
    opened = JobQueue(redis_url, "test")
    yield opened
    opened.close()


@pytest.fixture
def nowhere() -> Iterator[JobQueue]:
    """A queue whose Redis is away."""
    opened = JobQueue(f"redis://127.0.0.1:{free_port()}/0", "test")
    yield opened
    opened.close()


def test_redis_holds_the_id_and_nothing_else_of_the_job(queue: JobQueue, redis_url: str) -> None:
    queue.enqueue("job_1")
    with redis.Redis.from_url(redis_url) as connection:
        (told,) = Queue("test", connection=connection, serializer=JSONSerializer).jobs
        assert (told.func_name, list(told.args), told.kwargs) == (TASK, ["job_1"], {})
        assert told.timeout == -1
        assert told.result_ttl == 0


def test_telling_twice_is_two_deliveries_of_one_id(queue: JobQueue) -> None:
    queue.enqueue("job_1")
    queue.enqueue("job_1")
    queue.enqueue("job_2")
    assert queue.told() == {"job_1", "job_2"}


def test_a_cancel_is_heard_by_who_listens_for_this_job(queue: JobQueue) -> None:
    heard: dict[str, bool] = {}
    ready = threading.Barrier(3)

    def listen(job_id: str) -> None:
        with queue.listen_for_cancel(job_id) as listener:
            assert not listener.wait(0.05)  # subscribed from here on
            ready.wait(DEADLINE_S)
            heard[job_id] = listener.wait(DEADLINE_S if job_id == "job_1" else 0.2)

    threads = [threading.Thread(target=listen, args=(job_id,)) for job_id in ("job_1", "job_2")]
    for thread in threads:
        thread.start()
    ready.wait(DEADLINE_S)
    queue.publish_cancel("job_1")
    for thread in threads:
        thread.join()
    assert heard == {"job_1": True, "job_2": False}


def test_a_redis_that_is_away_is_unavailable(nowhere: JobQueue) -> None:
    for call in (nowhere.ping, nowhere.told, lambda: nowhere.enqueue("job_1"), lambda: nowhere.publish_cancel("job_1")):
        with pytest.raises(UnavailableError, match="Redis"):
            call()
    with nowhere.listen_for_cancel("job_1") as listener:
        assert not listener.wait(0.01)


def test_a_url_that_is_none_is_refused() -> None:
    with pytest.raises(DependencyError, match="MESHDEFORM_REDIS_URL"):
        JobQueue("http://somewhere", "test")


def test_what_redis_forgot_is_told_again_and_only_that(record: JobRecord, queue: JobQueue, redis_url: str) -> None:
    jobs = [new_job(record) for _ in range(3)]
    for job in jobs:
        queue.enqueue(job.id)
    record.claim(jobs[0].id, "worker", 60.0)
    reconciler = Reconciler(record, queue, 3)
    assert reconciler.run_once() == []
    with redis.Redis.from_url(redis_url) as connection:
        connection.flushall()
    assert reconciler.run_once() == [jobs[1].id, jobs[2].id]
    assert reconciler.run_once() == []
    assert queue.told() == {jobs[1].id, jobs[2].id}


def test_a_job_whose_worker_fell_silent_is_told_again(record: JobRecord, queue: JobQueue) -> None:
    job = new_job(record)
    record.claim(job.id, "worker", -1.0)
    assert Reconciler(record, queue, 3).run_once() == [job.id]
    assert record.get(job.id).state is JobState.QUEUED


def test_the_reconciler_lives_through_an_outage(record: JobRecord, redis_url: str) -> None:
    job = new_job(record)
    queue = JobQueue(redis_url, "test")
    enqueue, failures = queue.enqueue, iter([UnavailableError("away"), RuntimeError("a mistake")])

    def flaky(job_id: str) -> None:
        if error := next(failures, None):
            raise error
        enqueue(job_id)

    queue.enqueue = flaky  # type: ignore[method-assign]
    with Reconciler(record, queue, 3, every_s=0.01):
        deadline = time.monotonic() + DEADLINE_S
        while job.id not in queue.told():
            assert time.monotonic() < deadline
            time.sleep(0.01)
    queue.close()


def test_deleted_jobs_leave_nothing_and_shared_files_stay(record: JobRecord, tmp_path: Path) -> None:
    store = ObjectStore(tmp_path)
    shared, own = stored_file("a"), stored_file("b")
    for file in (shared, own):
        store.put(file.key, b"xyz")
    first, second, third = new_job(record, letter="a"), new_job(record, letter="a"), new_job(record, letter="b")
    for job in (first, third):
        store.put(f"jobs/{job.id}/1/result.glb", b"result")
        record.request_cancel(job.id)
        record.delete(job.id)
    remove_unreachable(record, store)
    assert store.exists(shared.key)
    assert not store.exists(own.key)
    assert not store.exists(f"jobs/{first.id}/1/result.glb")
    assert record.discarded_prefixes() == []
    record.request_cancel(second.id)
    record.delete(second.id)
    remove_unreachable(record, store)
    assert not store.exists(shared.key)


def test_what_the_store_could_not_remove_stays_on_the_record(record: JobRecord, tmp_path: Path) -> None:
    store = ObjectStore(tmp_path)
    job = new_job(record)
    record.request_cancel(job.id)
    record.delete(job.id)

    def away(prefix: str) -> None:
        raise UnavailableError("away")

    store.delete_prefix = away  # type: ignore[method-assign]
    with pytest.raises(UnavailableError):
        remove_unreachable(record, store)
    assert record.discarded_prefixes() == [f"jobs/{job.id}/"]
