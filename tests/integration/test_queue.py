"""The queue on a real Redis: what workers hear, and what is said when Redis is away."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import redis
from rq import Callback, Queue
from rq.serializers import JSONSerializer

from meshdeform.errors import DependencyError, UnavailableError
from meshdeform.record.queue import JobQueue, job_of
from tests.cases import each_case
from tests.integration.conftest import DEADLINE_S
from tests.servers import free_port
from tests.shut_redis import WAYS, shut_redis
from worker.process import InProcessWorker


@pytest.fixture
def queue(redis_url: str) -> Iterator[JobQueue]:
    opened = JobQueue(redis_url, "test")
    yield opened
    opened.close()


@pytest.fixture
def signals() -> Iterator[None]:
    """The handlers of signals as they were before, at the end."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_redis_holds_the_id_and_nothing_else_of_the_job(queue: JobQueue, redis_url: str) -> None:
    queue.enqueue("job_1")
    with redis.Redis.from_url(redis_url) as connection:
        (told,) = Queue("test", connection=connection, serializer=JSONSerializer).jobs
        assert (job_of(told.id), list(told.args), told.kwargs) == ("job_1", [], {})
        assert told.timeout == -1
        assert told.result_ttl == 0


def test_what_others_put_into_redis_is_dropped_and_nothing_of_it_is_imported(
    queue: JobQueue, redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, signals: None
) -> None:
    (tmp_path / "planted.py").write_text("raise SystemExit('it was imported')")
    monkeypatch.syspath_prepend(str(tmp_path))
    ran: list[str] = []
    with redis.Redis.from_url(redis_url) as connection:
        foreign = Queue("test", connection=connection, serializer=JSONSerializer)
        foreign.enqueue("planted.function", job_id="job_1-1", on_failure=Callback("planted.callback"))
        dead = foreign.create_job("planted.function", on_failure=Callback("planted.callback"), job_id="dead")
        dead.save()
        connection.zadd(f"{foreign.started_job_registry.key}", {"dead:1": 1.0})
        foreign.enqueue("a job waits", job_id="job_2-1")
        connection.hset("rq:job:job_2-1", "data", b"no JSON")
        queue.enqueue("job_3")
        worker = InProcessWorker("test", connection, ran.append, on_idle=lambda: None, on_stop=lambda: None)
        worker.work(burst=True, logging_level="WARNING")
        assert foreign.count == 0
        assert [key for key in connection.keys("rq:job:*") if key != b"rq:job:dead"] == []
    assert ran == ["job_3"]
    assert "planted" not in sys.modules


def test_a_worker_obeys_no_command_from_redis(queue: JobQueue, redis_url: str, signals: None) -> None:
    """RQ's `shutdown` would stop a worker, `rq suspend` would keep every worker waiting."""
    heard = []
    with redis.Redis.from_url(redis_url) as connection:
        queue.enqueue("job_1")
        connection.set("rq:suspended", 1)

        def run(_job_id: str) -> None:
            heard.append(connection.publish(worker.pubsub_channel_name, '{"command": "shutdown"}'))

        worker = InProcessWorker("test", connection, run, on_idle=lambda: None, on_stop=lambda: None)
        worker.work(burst=True, logging_level="WARNING")
    assert heard == [0]  # subscribers


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


def test_what_stands_in_the_place_of_the_queue_is_deleted(queue: JobQueue, redis_url: str) -> None:
    for call in (lambda: queue.enqueue("job_1"), queue.announced, queue.length):
        with redis.Redis.from_url(redis_url) as connection:
            connection.delete("rq:queue:test")
            connection.set("rq:queue:test", "x")
        with pytest.raises(UnavailableError):
            call()
        assert queue.announced() == set()
        queue.enqueue("job_2")
        assert queue.announced() == {"job_2"}


def test_a_redis_that_is_away_is_unavailable() -> None:
    nowhere = JobQueue(f"redis://127.0.0.1:{free_port()}/0", "test")
    for call in (
        nowhere.ping,
        nowhere.announced,
        lambda: nowhere.enqueue("job_1"),
        lambda: nowhere.publish_cancel("job_1"),
    ):
        with pytest.raises(UnavailableError, match="Redis"):
            call()
    with nowhere.listen_for_cancel("job_1") as listener:
        assert not listener.wait(0.01)
    nowhere.close()


def test_a_url_that_is_none_is_refused() -> None:
    with pytest.raises(DependencyError, match="MESHDEFORM_REDIS_URL"):
        JobQueue("http://somewhere", "test")


@each_case("way", WAYS)
def test_a_redis_that_refuses_is_unavailable(queue: JobQueue, redis_url: str, way: str) -> None:
    with shut_redis(redis_url, way):
        refused = JobQueue(redis_url, "test")  # what is connected already stays so
        for call in (refused.ping, lambda: refused.enqueue("job_1")):
            with pytest.raises(UnavailableError, match="Redis"):
                call()
        refused.close()
    queue.ping()
