"""`Prefer: wait=N` over real sockets: the answer comes with the end of the job, or when the time is up."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from meshdeform.errors import UnavailableError
from meshdeform.record.models import JobState
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from tests.claims import claim_job
from tests.integration.conftest import DEADLINE_S, new_job, serving_app
from tests.waiting import until

WAIT = {"Prefer": "wait=60"}


@pytest.fixture
def server(record: JobRecord, own_settings: Callable[..., Settings]) -> Iterator[tuple[httpx.Client, FastAPI]]:
    """A server of its own, and a client that waits for longer than the test may take."""
    with serving_app(own_settings()) as (url, app), httpx.Client(base_url=url, timeout=2 * DEADLINE_S) as http:
        yield http, app


def waiting(app: FastAPI, many: int) -> None:
    until(lambda: app.state.app_state.waiters.waiting == many, f"{many} wait")


def test_an_answer_is_held_back_until_the_job_is_over(server: tuple[httpx.Client, FastAPI], record: JobRecord) -> None:
    http, app = server
    job = new_job(record)
    early = http.get(f"/v1/jobs/{job.id}", headers={"Prefer": "wait=1"})  # after its time it is shown as it is
    assert (early.status_code, early.json()["state"]) == (200, "queued")
    with ThreadPoolExecutor() as pool:
        answer = pool.submit(http.get, f"/v1/jobs/{job.id}", headers=WAIT)
        waiting(app, 1)
        assert claim_job(record.leases, job.id, "worker", 60.0)
        assert not answer.done()
        record.leases.finish(job.id, 1, JobState.SUCCEEDED)
        found = answer.result(DEADLINE_S)
    assert found.status_code == 200
    assert found.json()["state"] == "succeeded"
    assert found.headers["preference-applied"] == "wait=60"


def test_a_post_may_wait_too(server: tuple[httpx.Client, FastAPI], record: JobRecord, sphere: bytes) -> None:
    http, app = server
    files: dict[str, Any] = {"asset": ("sphere.glb", sphere), "request": (None, '{"prompt": "a mushroom"}')}
    with ThreadPoolExecutor() as pool:
        answer = pool.submit(http.post, "/v1/jobs", files=files, headers=WAIT)
        waiting(app, 1)
        [job] = record.list_jobs().jobs
        record.request_cancel(job.id)
        found = answer.result(DEADLINE_S)
    assert (found.status_code, found.json()["state"]) == (200, "canceled")
    assert found.headers["location"] == f"/v1/jobs/{job.id}"


def test_a_record_that_goes_away_shows_the_job_as_it_was(
    server: tuple[httpx.Client, FastAPI], record: JobRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    http, app = server
    job = new_job(record)
    kept = app.state.app_state.record
    get, away = kept.get, threading.Event()

    def maybe(*arguments: Any) -> Any:
        if away.is_set():
            raise UnavailableError("The record does not answer.")
        return get(*arguments)

    monkeypatch.setattr(kept, "get", maybe)
    with ThreadPoolExecutor() as pool:
        answer = pool.submit(http.get, f"/v1/jobs/{job.id}", headers=WAIT)
        waiting(app, 1)
        away.set()
        record.request_cancel(job.id)
        found = answer.result(DEADLINE_S)
    assert (found.status_code, found.json()["state"]) == (200, "queued")
