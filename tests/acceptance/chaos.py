"""Random faults, from a seed: what may die, dies; what may sleep, sleeps; and everything is started again."""

from __future__ import annotations

import contextlib
import queue
import random
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping

import psutil
import redis

from meshdeform.errors import UnavailableError
from tests.acceptance.cluster import Cluster, Part
from tests.servers import PostgresServer

__all__ = ["Chaos"]


class Chaos:
    """Faults of a deployment with an API and the named supervisors, one after the other, in a thread, for a block.

    `pause_s` has the least and the greatest time between two; `more` are other faults by their names, each of
    which ends before it returns; `faults` counts how often each struck.
    """

    def __init__(
        self,
        cluster: Cluster,
        seed: int,
        supervisors: list[str],
        *,
        postgres: PostgresServer | None = None,
        pause_s: tuple[float, float],
        more: Mapping[str, Callable[[], None]] | None = None,
    ) -> None:
        self._cluster, self._random, self._pause_s = cluster, random.Random(seed), pause_s
        self._supervisors, self._postgres = supervisors, postgres
        self._asleep: list[tuple[float, psutil.Process]] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, name="chaos")
        self._error: BaseException | None = None
        self.faults: Counter[str] = Counter()
        self._planned: queue.SimpleQueue[tuple[str, Callable[[], None]]] = queue.SimpleQueue()
        self._kinds: list[tuple[str, int, Callable[[], None]]] = [
            ("a worker is killed", 6, self._kill_worker),
            ("a worker sleeps past its lease", 2, self._stop_worker),
            ("a supervisor is killed", 2, self._kill_supervisor),
            ("a supervisor is stopped in order", 2, self._end_supervisor),
            ("the API is killed", 1, self._kill_api),
            ("Redis is killed and forgets", 2, self._kill_redis),
            ("Redis is emptied", 3, self._flush_redis),
            ("messages come twice", 3, self._tell_again),
        ]
        if postgres is not None:
            self._kinds.append(("PostgreSQL crashes", 1, self._crash_postgres))
        self._kinds += [(name, 1, fault) for name, fault in (more or {}).items()]

    def next(self, name: str, fault: Callable[[], None]) -> None:
        """Let a fault of this name come next."""
        self._planned.put((name, fault))

    def check(self) -> None:
        """Raise what has ended the faults, if anything has: the deployment is as it was left."""
        if self._error is not None:
            raise self._error

    def __enter__(self) -> Chaos:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()
        for _until, process in self._asleep:
            _wake(process)
        self.check()

    def _run(self) -> None:
        bag = [name for name, weight, _ in self._kinds for _ in range(weight)]
        faults, left = {name: fault for name, _, fault in self._kinds}, list[str]()
        try:
            while not self._done.wait(self._random.uniform(*self._pause_s)):
                self._wake_sleepers()
                left = left or self._random.sample(bag, len(bag))  # in every round, each as often as it weighs
                name, fault = self._planned.get() if not self._planned.empty() else (left[-1], faults[left.pop()])
                # A fault that finds its victim dead already, by another one, is none.
                with contextlib.suppress(psutil.NoSuchProcess, UnavailableError, redis.RedisError):
                    fault()
                    self.faults[name] += 1
        except BaseException as error:
            self._error = error

    def _wake_sleepers(self) -> None:
        now = time.monotonic()
        for entry in [entry for entry in self._asleep if entry[0] < now]:
            self._asleep.remove(entry)
            _wake(entry[1])

    def _supervisor(self) -> Part:
        return self._cluster.parts[self._random.choice(self._supervisors)]

    def _kill_worker(self) -> None:
        for process in self._supervisor().children()[:1]:
            process.kill()

    def _stop_worker(self) -> None:
        for process in self._supervisor().children()[:1]:
            process.send_signal(signal.SIGSTOP)
            self._asleep.append((time.monotonic() + self._random.uniform(1.0, 8.0), process))

    def _kill_supervisor(self) -> None:
        part = self._supervisor()
        part.kill()
        self._cluster.start_worker(part.name)

    def _end_supervisor(self) -> None:
        part = self._supervisor()
        part.send(signal.SIGTERM)
        with contextlib.suppress(Exception):
            part.process.wait(timeout=3.0)
        part.clean_up()
        self._cluster.start_worker(part.name)

    def _kill_api(self) -> None:
        self._cluster.parts["api"].kill()
        self._cluster.start_api()

    def _kill_redis(self) -> None:
        self._cluster.redis.kill()
        self._done.wait(self._random.uniform(0.0, 1.0))
        self._cluster.redis.start()

    def _flush_redis(self) -> None:
        with redis.Redis.from_url(self._cluster.redis.url) as connection:
            connection.flushall()

    def _tell_again(self) -> None:
        jobs = self._cluster.record.list_jobs(limit=20).jobs
        for job in self._random.sample(jobs, min(3, len(jobs))):
            self._cluster.queue.enqueue(job.id)

    def _crash_postgres(self) -> None:
        assert self._postgres is not None
        self._postgres.kill()
        self._done.wait(self._random.uniform(0.0, 0.5))
        self._postgres.start()


def _wake(process: psutil.Process) -> None:
    with contextlib.suppress(psutil.NoSuchProcess):
        process.send_signal(signal.SIGCONT)
