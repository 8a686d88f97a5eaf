"""Events over real sockets: every reader gets every event once and in order, whatever breaks in between."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import httpx
import pytest
import sqlalchemy as sa

from meshdeform.record.models import TERMINAL_STATES, JobState
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from service.events import routes as events_module
from tests.cases import each_case
from tests.claims import claim_job
from tests.integration.conftest import DEADLINE_S, Api, new_job, serving_app
from tests.integration.http_calls import check_document, check_problem
from tests.integration.streams import STREAM, progress, recovered_run, stream

TERMINAL = {state.value for state in TERMINAL_STATES}


def check_whole(events: list[dict[str, Any]], first: int = 1) -> None:
    """Check that nothing is left out, nothing comes twice, and one event ends it all."""
    assert [event["seq"] for event in events] == list(range(first, first + len(events)))
    assert [event["type"] in TERMINAL for event in events] == [False] * (len(events) - 1) + [True]


def test_the_events_of_a_recovered_job_are_whole_from_every_last_event_id(api: Api, openapi: dict[str, Any]) -> None:
    job = new_job(api.record)
    recovered_run(api.record, job.id)
    with stream(api.http, job.id) as found:
        events = list(found.events())
        assert found.retry_ms == 2000
        assert found.answer.headers["cache-control"] == "no-store"
        assert found.answer.headers["x-accel-buffering"] == "no"
    check_whole(events)
    types = [event["type"] for event in events]
    assert types[:2] == ["queued", "started"]
    assert types.count("recovered") == 1
    assert types.count("started") == 2
    assert types[-1] == "succeeded"
    assert [event["attempt"] for event in events] == sorted(event["attempt"] for event in events)
    fractions = [event["data"]["fraction"] for event in events if event["type"] == "progress"]
    assert all(before <= after for before, after in pairwise(fractions))
    assert len(fractions) == 10
    assert fractions[-1] == 1.0
    for event in events:
        check_document(event, "EventView", openapi)
    for last in range(len(events)):
        with stream(api.http, job.id, last) as found:
            assert list(found.events()) == events[last:]


def test_a_stream_that_was_read_to_the_end_tells_browsers_to_stay_away(api: Api) -> None:
    job = new_job(api.record)
    api.record.request_cancel(job.id)
    for last in (2, 3, 2**31 - 1):
        answer = api.http.get(f"/v1/jobs/{job.id}/events", headers={**STREAM, "Last-Event-ID": str(last)})
        assert (answer.status_code, answer.content) == (204, b"")


def test_events_come_while_they_happen_also_beyond_the_end(api: Api) -> None:
    job = new_job(api.record)
    far = stream(api.http, job.id, 1000)  # let go when the job is over
    with stream(api.http, job.id) as all_of_them, stream(api.http, job.id, 3) as beyond, far as nothing:
        everything = all_of_them.events()
        assert next(everything)["type"] == "queued"
        assert claim_job(api.record.leases, job.id, "worker", 60.0)
        assert next(everything)["type"] == "started"
        progress(api.record, job.id, 1, 1)
        assert next(everything)["data"]["step"] == 1
        progress(api.record, job.id, 1, 2)
        assert next(everything)["data"]["step"] == 2
        assert next(beyond.events())["seq"] == 4
        api.record.leases.finish(job.id, 1, JobState.SUCCEEDED)
        assert [event["type"] for event in everything] == ["succeeded"]
        assert list(nothing.events()) == []


def test_many_events_come_in_order_in_one_stream(api: Api) -> None:
    job = new_job(api.record)
    assert claim_job(api.record.leases, job.id, "worker", 60.0)
    for step in range(250):
        progress(api.record, job.id, 1, step, 250)
    api.record.leases.finish(job.id, 1, JobState.SUCCEEDED)
    with stream(api.http, job.id) as found:
        events = list(found.events())
    check_whole(events)
    assert len(events) == 253


def test_a_deleted_job_ends_its_streams(api: Api) -> None:
    job = new_job(api.record)
    with stream(api.http, job.id, 7) as found:
        # Deleted before the stream can see that it is over.
        with api.record.database.write() as connection:
            connection.execute(sa.text("DELETE FROM jobs WHERE id = :id"), {"id": job.id})
        assert list(found.events()) == []


def test_a_server_that_ends_lets_its_readers_go_on_with_the_next_one(
    record: JobRecord, own_settings: Callable[..., Settings]
) -> None:
    job, own = new_job(record), own_settings()
    seen: list[dict[str, Any]] = []
    told = threading.Event()

    def read(url: str) -> None:
        last = seen[-1]["seq"] if seen else None
        with httpx.Client(base_url=url, timeout=DEADLINE_S) as http, stream(http, job.id, last) as found:
            for event in found.events():
                seen.append(event)
                told.set()

    with ThreadPoolExecutor() as pool:
        with serving_app(own) as (url, _):
            first = pool.submit(read, url)
            assert claim_job(record.leases, job.id, "worker", 60.0)
            for step in (1, 2, 3):
                progress(record, job.id, 1, step)
            assert told.wait(DEADLINE_S)
        first.result(DEADLINE_S)  # ended in order: the server did not wait for the job
        assert not record.get(job.id).state.terminal
        for step in (4, 5, 6):
            progress(record, job.id, 1, step)
        with serving_app(own) as (url, _):
            second = pool.submit(read, url)
            progress(record, job.id, 1, 7)
            record.leases.finish(job.id, 1, JobState.SUCCEEDED)
            second.result(DEADLINE_S)
    check_whole(seen)
    assert len(seen) == 10


def test_silence_is_filled_with_comments(api: Api, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(events_module, "_SILENCE_S", 0.05)
    job = new_job(api.record)
    with stream(api.http, job.id) as found:
        events = found.events()
        assert next(events)["type"] == "queued"
        threading.Timer(0.5, api.record.request_cancel, [job.id]).start()
        assert next(events)["type"] == "canceled"
        assert found.comments


@each_case("sent", ["x", "-1", "1.5", "9" * 20])
def test_a_last_event_id_that_is_no_number_is_refused(api: Api, sent: str) -> None:
    job = new_job(api.record)
    headers = {**STREAM, "Last-Event-ID": sent}
    problem = check_problem(api.http.get(f"/v1/jobs/{job.id}/events", headers=headers), 422, "parameter_invalid")
    assert problem["errors"][0]["loc"] == ["header", "Last-Event-ID"]


def test_json_comes_in_pages(api: Api, openapi: dict[str, Any]) -> None:
    job = new_job(api.record)
    recovered_run(api.record, job.id)
    events: list[dict[str, Any]] = []
    after = 0
    while True:
        answer = api.http.get(f"/v1/jobs/{job.id}/events", params={"after": after, "limit": 4})
        assert answer.headers["cache-control"] == "no-store"
        page = answer.json()
        check_document(page, "EventList", openapi)
        if not page["events"]:
            break
        assert page["next_after"] == page["events"][-1]["seq"]
        events += page["events"]
        after = page["next_after"]
    check_whole(events)
    assert page["next_after"] == after
    everything = api.http.get(f"/v1/jobs/{job.id}/events", params={"format": "json"}, headers=STREAM).json()
    assert everything["events"] == events
    check_problem(api.http.get(f"/v1/jobs/{job.id}/events", params={"limit": 1001}), 422, "parameter_invalid")


@each_case(
    ("accept", "query", "streamed"),
    [
        ("*/*", "", False),
        ("application/json", "", False),
        ("text/event-stream", "", True),
        ("application/json, text/event-stream", "", True),
        ("application/json, text/event-stream;q=0.5", "", False),
        ("text/event-stream;q=0", "", False),
        ("text/html", "?format=stream", True),
        ("text/event-stream", "?format=json", False),
    ],
)
def test_who_asks_for_a_stream_gets_one(api: Api, accept: str, query: str, streamed: bool) -> None:
    job = new_job(api.record)
    api.record.request_cancel(job.id)
    answer = api.http.get(f"/v1/jobs/{job.id}/events{query}", headers={"Accept": accept})
    assert answer.headers["content-type"].startswith("text/event-stream" if streamed else "application/json")


def test_an_empty_page_can_be_held_back_until_something_happens(api: Api) -> None:
    job = new_job(api.record)
    url, wait = f"/v1/jobs/{job.id}/events", {"Prefer": "wait=30"}
    with ThreadPoolExecutor() as pool:
        waiting = pool.submit(api.http.get, url, params={"after": 1}, headers=wait)
        at_once = api.http.get(url, headers=wait)
        assert [event["seq"] for event in at_once.json()["events"]] == [1]
        assert not waiting.done()
        assert claim_job(api.record.leases, job.id, "worker", 60.0)
        answer = waiting.result(DEADLINE_S)
    assert [event["type"] for event in answer.json()["events"]] == ["started"]
    assert answer.headers["preference-applied"] == "wait=30"
    late = api.http.get(url, params={"after": 2}, headers={"Prefer": "wait=1"})
    assert late.json() == {"events": [], "next_after": 2}
