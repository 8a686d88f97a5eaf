"""Measure how long jobs wait after a failure: ``python -m bench.recovery [--times 7]``.

A deployment of plain processes on PostgreSQL, with the default settings (a lease of 30 s), runs jobs whose steps only
wait for 10 ms. Each fault hits a running job the given number of times. Printed are the median and the worst time from
the fault until the next worker has the job or, if nothing was lost, until it continues. Times for restarting a process
depend on the machine; times for waiting for a lease depend on its length.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import signal
import statistics
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

import redis

from meshdeform.record.models import Event, EventType
from tests.acceptance.cluster import Cluster, running_redis
from tests.acceptance.service import until
from tests.servers import PostgresServer

STEPS = 6000


class Bench:
    """One deployment, subjected to repeated faults."""

    def __init__(self, cluster: Cluster, postgres: PostgresServer) -> None:
        self.cluster, self.postgres = cluster, postgres

    def next_start(self, job_id: str, after: datetime) -> float:
        """Wait for the next attempt and return the seconds until it began."""

        def found() -> Event | None:
            events = self.cluster.events(job_id)
            return next((e for e in events if e.type is EventType.STARTED and e.at > after), None)

        event = until("the next attempt", found, deadline_s=120.0)
        return (event.at - after).total_seconds()

    def running(self) -> str:
        """Create a job and return its id once it runs."""
        job_id = self.cluster.submit(STEPS)
        self.cluster.at_step(job_id, 5)
        return job_id

    def done(self, job_id: str) -> None:
        """End the job."""
        with contextlib.suppress(Exception):
            self.cluster.record.request_cancel(job_id)
            self.cluster.queue.publish_cancel(job_id)
        self.cluster.finished(job_id)

    def worker_killed(self) -> float:
        """Kill the worker for the first time; after repeated deaths the supervisor waits longer, up to 30 s."""
        self.cluster.parts["worker"].stop()
        self.cluster.start_worker()
        job_id = self.running()
        now = datetime.now(UTC)
        self.cluster.parts["worker"].child().kill()
        seconds = self.next_start(job_id, now)
        self.done(job_id)
        return seconds

    def host_lost(self) -> float:
        """Stop supervisor and worker, while another supervisor is running."""
        job_id = self.running()
        self.cluster.start_worker("other")
        until("the other is ready", lambda: "device" in self.cluster.parts["other"].log)
        silent = [self.cluster.parts["worker"].child().pid, self.cluster.parts["worker"].pid]
        now = datetime.now(UTC)
        for pid in silent:
            os.kill(pid, signal.SIGSTOP)
        seconds = self.next_start(job_id, now)
        for pid in silent:
            os.kill(pid, signal.SIGCONT)
        self.done(job_id)
        self.cluster.parts["other"].stop()
        return seconds

    def redis_emptied(self) -> float:
        """Lose the message of a queued job while a worker is free."""
        first = self.running()
        waiting = self.cluster.submit(STEPS)
        with redis.Redis.from_url(self.cluster.redis.url) as connection:
            connection.flushall()
        self.cluster.record.request_cancel(first)
        self.cluster.queue.publish_cancel(first)
        now = datetime.now(UTC)
        seconds = self.next_start(waiting, now)
        self.done(waiting)
        return seconds

    def postgres_crashed(self) -> float:
        """Crash PostgreSQL; wait until the running job's progress is recorded again."""
        job_id = self.running()
        now = time.monotonic()
        self.postgres.kill()
        self.postgres.start()
        before = until("the record", lambda: self.cluster.job(job_id)).progress.step
        until("progress", lambda: self.cluster.job(job_id).progress.step > before)
        seconds = time.monotonic() - now
        assert self.cluster.job(job_id).attempt == 1
        self.done(job_id)
        return seconds

    def step_hangs(self) -> float:
        """Hang a step; the supervisor waits for MESHDEFORM_STEP_TIMEOUT_S (here 5 s) first."""
        self.cluster.parts["worker"].stop()
        self.cluster.start_worker(MESHDEFORM_STEP_TIMEOUT_S="5")
        job_id = self.running()
        now = datetime.now(UTC)
        self.cluster.parts["worker"].child().send_signal(signal.SIGSTOP)
        seconds = self.next_start(job_id, now)
        self.done(job_id)
        return seconds


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=7)
    parser.add_argument("--only", default="", help="words in the names of the rows to measure; default: every row")
    options = parser.parse_args()
    # The record's client logs errors while its server is down, which is part of the measurement.
    logging.disable()
    base = Path(tempfile.mkdtemp(prefix="meshdeform-recovery-", dir="/tmp"))
    base.chmod(0o755)
    folder = base / "postgres"
    folder.mkdir()
    server = PostgresServer(folder, durable=True)
    server.start()
    settings = {"MESHDEFORM_LEASE_S": "30", "MESHDEFORM_MAX_ATTEMPTS": "1000"}
    with contextlib.ExitStack() as cleanup:
        cleanup.callback(server.kill)
        running = cleanup.enter_context(running_redis(base))
        cluster = Cluster(base, running, database_url=server.url, environment=settings)
        cleanup.callback(cluster.clean_up)
        cluster.start_api()
        cluster.start_worker()
        bench = Bench(cluster, server)
        print(f"{'seconds from the fault until a job continues':<42}{'n':>3}{'median':>9}{'worst':>9}")
        rows = {
            "worker process killed": bench.worker_killed,
            "Redis emptied, one job queued": bench.redis_emptied,
            "PostgreSQL crashed and started again": bench.postgres_crashed,
            "host silent (lease of 30 s)": bench.host_lost,
            "step hangs (step timeout of 5 s)": bench.step_hangs,
        }
        for name, once in rows.items():
            if options.only in name:
                found = sorted(once() for _ in range(options.times))
                median = statistics.median(found)
                print(f"{name:<42}{len(found):>3}{median:>9.1f}{found[-1]:>9.1f}", flush=True)


if __name__ == "__main__":
    main()
