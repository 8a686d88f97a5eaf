"""Revoked keys, probes without a key, and work that anybody may ask for."""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path

import httpx
import pytest

from meshdeform.errors import UnavailableError
from meshdeform.record.idempotency import IdempotencyLedger
from meshdeform.record.models import NewJob
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from service.events import routes as event_routes
from service.http import auth
from tests.integration.conftest import DEADLINE_S, serving, serving_app, stored_file


def test_the_event_streams_of_a_revoked_key_and_of_its_links_end(
    redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(event_routes, "_SILENCE_S", 0.1)
    monkeypatch.setattr(auth, "_KNOWN_FOR_S", 0.0)
    settings = Settings(data_dir=tmp_path, redis_url=redis_url, auth="on")
    record = JobRecord(settings.resolved_database_url)
    key, text = record.keys.create("studio")
    job = record.create(NewJob(JobRequest(prompt="a vase"), {"asset": stored_file()}, owner_id="studio"))
    with serving(settings) as url, contextlib.ExitStack() as stack:
        path = f"{url}/v1/jobs/{job.id}"
        link = httpx.post(f"{path}/url", headers={"Authorization": f"Bearer {text}"}).json()["url"].rpartition("/")[2]
        streams = []
        for secret in (text, link):
            headers = {"Authorization": f"Bearer {secret}", "Accept": "text/event-stream"}
            stream = httpx.stream("GET", f"{path}/events", headers=headers, timeout=DEADLINE_S)
            streams.append(stack.enter_context(stream).iter_lines())
            while next(streams[-1]) != ": keep-alive":
                pass
        record.keys.revoke(key.id)
        for lines in streams:
            assert not [line for line in lines if line.startswith("event: ")]
        for secret in (text, link):
            assert httpx.get(path, headers={"Authorization": f"Bearer {secret}"}).status_code == 401
    record.close()


def test_what_anybody_may_ask_for_is_done_once(redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """/readyz asks the store every few seconds at most."""
    done = []
    ping = ObjectStore.ping
    monkeypatch.setattr(ObjectStore, "ping", lambda *given: (done.append("ping"), ping(*given))[1])
    monkeypatch.setattr("service.state._STORE_HEALTH_S", 1e9)
    with serving(Settings(data_dir=tmp_path, redis_url=redis_url)) as url:
        for _ in range(3):
            assert httpx.get(f"{url}/readyz").status_code == 200
    assert done == ["ping"]


def test_an_outage_is_one_line_in_the_log(
    redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def away(*_: object, **__: object) -> None:
        raise UnavailableError("The record does not answer.")

    with serving_app(Settings(data_dir=tmp_path, redis_url=redis_url)) as (url, _):
        monkeypatch.setattr(JobRecord, "list_jobs", away)
        assert httpx.get(f"{url}/v1/jobs").status_code == 503
    (line,) = [record for record in caplog.records if record.name == "service.http.errors"]
    assert (line.levelno, line.exc_info) == (logging.WARNING, None)


def test_a_key_whose_request_died_says_when_to_try_again(
    redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, repository: Path
) -> None:
    settings = Settings(data_dir=tmp_path, redis_url=redis_url)
    monkeypatch.setattr(IdempotencyLedger, "abandon", lambda *_: None)
    monkeypatch.setattr(JobRecord, "create", lambda *_, **__: 1 / 0)
    files = {
        "asset": ("sphere.glb", (repository / "examples" / "sphere.glb").read_bytes()),
        "request": (None, '{"prompt": "a vase"}'),
    }
    with serving(settings) as url:
        codes = []
        for _ in range(2):
            answer = httpx.post(f"{url}/v1/jobs", files=files, headers={"Idempotency-Key": "a"}, timeout=DEADLINE_S)
            codes.append(answer.status_code)
        assert codes == [500, 409]
        assert 1 <= int(answer.headers["retry-after"]) <= 5
