"""Many who wait for jobs at once: what they cost, who is let in, and that none is forgotten."""

from __future__ import annotations

import asyncio
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import sqlalchemy as sa
from fastapi import FastAPI

from meshdeform.errors import UnavailableError
from meshdeform.record.changes import JobPosition
from meshdeform.record.models import JobState
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from service.events import waiting as hub_module
from service.events.waiting import JobWaiters
from tests.acceptance.cluster import deployed
from tests.integration.conftest import DEADLINE_S, new_job, serving_app
from tests.integration.streams import STREAM, stream
from tests.waiting import until


@pytest.fixture
def counted(record: JobRecord, own_settings: Callable[..., Settings]) -> Iterator[tuple[str, FastAPI, list[str]]]:
    """A server, and every statement that it sends to the database for those who wait."""
    statements: list[str] = []

    def count(_connection: Any, _cursor: Any, statement: str, *_: Any) -> None:
        if "jobs.event_seq, jobs.version" in statement and " IN (" in statement:
            statements.append(statement)

    with serving_app(own_settings()) as (url, app):
        engine = app.state.app_state.record.database._engine
        sa.event.listen(engine, "before_cursor_execute", count)
        yield url, app, statements


def test_two_hundred_waiting_clients_cost_one_query_a_tick_and_are_forgotten_when_they_go(
    counted: tuple[str, FastAPI, list[str]], record: JobRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    url, app, statements = counted
    waiters: JobWaiters = app.state.app_state.waiters
    jobs = [new_job(record).id for _ in range(20)]
    ticks: list[None] = []
    poll = waiters._poll

    async def counted_poll() -> None:
        ticks.append(None)
        await poll()

    monkeypatch.setattr(waiters, "_poll", counted_poll)

    async def clients() -> None:
        limits = httpx.Limits(max_connections=None)
        async with httpx.AsyncClient(base_url=url, timeout=DEADLINE_S, limits=limits) as http:

            async def follow(job_id: str) -> list[int]:
                seen = []
                async with http.stream("GET", f"/v1/jobs/{job_id}/events", headers=STREAM) as answer:
                    async for line in answer.aiter_lines():
                        if line.startswith("id: "):
                            seen.append(int(line[4:]))
                return seen

            async def everybody_waits(many: int) -> None:
                async with asyncio.timeout(DEADLINE_S):
                    while waiters.waiting != many:
                        await asyncio.sleep(0.01)

            readers = [asyncio.create_task(follow(job_id)) for job_id in jobs * 10]
            await everybody_waits(200)
            assert waiters.held == 200
            threads = threading.active_count()
            ticks.clear()
            statements.clear()
            async with asyncio.timeout(DEADLINE_S):
                while len(ticks) < 5:
                    await asyncio.sleep(0.01)
            assert abs(len(statements) - len(ticks)) <= 1
            assert threads < 60  # and not one for each reader
            for reader in readers[:100]:
                reader.cancel()
            await everybody_waits(100)
            for job_id in jobs:
                record.request_cancel(job_id)
            assert await asyncio.gather(*readers[100:]) == [[1, 2]] * 100

    asyncio.run(clients())
    until(lambda: waiters.held == 0, "all places are free")
    assert waiters.waiting == 0
    assert waiters._held == {}
    until(lambda: not waiters._wanted.is_set(), "nobody asks the record any more")


@pytest.mark.both_databases
def test_a_record_that_is_away_loses_no_reader(
    counted: tuple[str, FastAPI, list[str]], record: JobRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    url, app, _ = counted
    job = new_job(record)
    log, waiters = app.state.app_state.record.events, app.state.app_state.waiters
    away, heads, after = threading.Event(), waiters._heads, log.after
    refused: list[str] = []

    def asked(name: str, real: Any) -> Any:
        def call(*arguments: Any) -> Any:
            if away.is_set():
                refused.append(name)
                raise UnavailableError("The record does not answer.")
            return real(*arguments)

        return call

    monkeypatch.setattr(waiters, "_heads", asked("heads", heads))
    monkeypatch.setattr(log, "after", asked("after", after))
    with httpx.Client(base_url=url, timeout=DEADLINE_S) as http, stream(http, job.id) as found:
        events = found.events()
        assert next(events)["seq"] == 1
        away.set()
        until(lambda: refused.count("heads") >= 2, "the record was asked in vain")
        away.clear()
        record.request_cancel(job.id)
        assert next(events)["type"] == "canceled"


def test_places_are_counted_by_owner_and_in_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hub_module, "MOST_HELD_OF_ONE", 2)

    async def crowd() -> None:
        waiters = JobWaiters(lambda ids: {})
        monkeypatch.setattr(waiters, "_most", 4)
        with waiters.slot("a"), waiters.slot("a"):
            with pytest.raises(hub_module.LimitError, match="2 requests with this key"), waiters.slot("a"):
                raise AssertionError
            with waiters.slot("b"), waiters.slot(""), pytest.raises(hub_module.LimitError, match="4 requests"):
                waiters.slot("c").__enter__()
        with waiters.slot("a"):
            assert waiters.held == 1

    asyncio.run(crowd())


def test_what_a_crowd_waits_for_is_looked_up_for_those_who_were_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who comes while the record is asked is not in the answer; that must not look like a deleted job."""

    async def late() -> None:
        asked: list[set[str]] = []
        come, go = threading.Event(), threading.Event()

        def heads(ids: Any) -> dict[str, JobPosition]:
            asked.append(set(ids))
            if len(asked) == 1:
                come.set()
                go.wait(DEADLINE_S)
            return {job_id: JobPosition(1, 1, JobState.QUEUED) for job_id in ids}

        waiters = JobWaiters(heads, tick_s=0.01)
        gone: list[str] = []

        def wanted(head: JobPosition | None) -> bool:
            if head is None:
                gone.append("gone")
            return len(asked) >= 3

        async with waiters.running():
            first = asyncio.create_task(waiters.until("a", wanted, DEADLINE_S))
            await asyncio.to_thread(come.wait, DEADLINE_S)
            second = asyncio.create_task(waiters.until("b", wanted, DEADLINE_S))
            await asyncio.sleep(0)
            go.set()
            assert await asyncio.gather(first, second) == [True, True]
        assert asked[0] == {"a"}
        assert {"a", "b"} in asked
        assert gone == []

    asyncio.run(late())


# A server that waits for its answers for as long as they take.
_SERVE = """
import sys
import uvicorn
from service.app import create_app

uvicorn.run(create_app(), host="127.0.0.1", port=int(sys.argv[1]), log_level="warning")
"""


def test_a_process_that_is_to_end_does_not_wait_for_its_streams(tmp_path: Path) -> None:
    with deployed(tmp_path) as cluster:
        api = cluster.start_api([sys.executable, "-c", _SERVE])
        with stream(cluster.http, cluster.submit()) as found:
            events = found.events()
            assert next(events)["type"] == "queued"
            api.send(signal.SIGTERM)
            assert list(events) == []
        assert api.process.wait(timeout=DEADLINE_S) in (0, -signal.SIGTERM)
