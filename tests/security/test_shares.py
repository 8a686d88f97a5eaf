"""One owner takes as much as it can of what all share: another owner's requests are answered all the same."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import httpx
import pytest

from meshdeform.assets import check
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from service.http.auth import principal
from service.state import AppState
from tests.integration.conftest import Api, serving_app
from tests.integration.http_calls import PROMPT, check_problem, post
from tests.integration.test_api_owners import named
from tests.waiting import until

HEAD = b'--x\r\nContent-Disposition: form-data; name="asset"; filename="a.glb"\r\n\r\n'


@dataclass(frozen=True)
class Tenants:
    """A server as two owners see it, and what it shares between them."""

    ann: Api
    bob: Api
    shared: AppState


@pytest.fixture(scope="module")
def tenants(own_settings: Callable[..., Settings]) -> Iterator[Tenants]:
    settings = own_settings(max_upload_bytes=2**20)
    record, store = JobRecord(settings.database_url), ObjectStore(settings.resolved_storage_url)
    with serving_app(settings) as (url, app), contextlib.ExitStack() as clients:
        app.dependency_overrides[principal] = named
        ann, bob = (
            clients.enter_context(httpx.Client(base_url=url, timeout=240, headers={"x-owner": name}))
            for name in ("ann", "bob")
        )
        api = Api(url, settings, record, store, ann)
        yield Tenants(api, replace(api, http=bob), app.state.app_state)
    record.close()


@contextlib.contextmanager
def sending(api: Api, path: str, method: str = "POST", length: int = 1000) -> Iterator[socket.socket]:
    """A connection on which the beginning of a body has been sent."""
    host, port = api.url.removeprefix("http://").split(":")
    owner = api.http.headers["x-owner"]
    head = f"{method} {path} HTTP/1.1\r\nHost: {host}\r\nContent-Length: {length}\r\nx-owner: {owner}\r\n"
    with socket.create_connection((host, int(port)), timeout=240) as connection:
        connection.sendall(head.encode() + b"Content-Type: multipart/form-data; boundary=x\r\n\r\n" + HEAD)
        yield connection


def upload(api: Api, content: bytes) -> dict[str, Any]:
    made: dict[str, Any] = api.http.post("/v1/uploads", json={"filename": "a.glb", "size": len(content)}).json()
    return made


def test_slow_bodies_of_one_owner_leave_slots_for_others(
    tenants: Tenants, sphere: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    ann, bob, slots = tenants.ann, tenants.bob, tenants.shared.bodies
    monkeypatch.setattr(slots, "wait_s", 0.2)
    with contextlib.ExitStack() as stack:
        for _ in range(8):
            stack.enter_context(sending(ann, "/v1/jobs"))
        for _ in range(8):
            # The signed URL of an upload counts for the upload's owner.
            stack.enter_context(sending(ann, upload(ann, b"x" * 1000)["url"], "PUT"))
        until(lambda: slots._held["ann"] == slots.per_owner)
        refused = post(ann, sphere)
        assert "8 of yours" in check_problem(refused, 503, "unavailable")["detail"]
        assert refused.headers["retry-after"]
        assert ann.http.get("/v1/jobs").status_code == 200, "a request without a file needs no slot"
        assert post(bob, sphere).status_code == 202
        sent = upload(bob, sphere)
        assert httpx.put(f"{bob.url}{sent['url']}", content=sphere).status_code == 204
    until(lambda: not slots._held)
    assert post(ann, sphere).status_code == 202


def test_a_body_that_trickles_ends_however_steadily_it_comes(tenants: Tenants, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.http.bodies.IDLE_S", 0.5)
    monkeypatch.setattr("service.http.bodies._LEAST_BYTES", 1)
    monkeypatch.setattr("service.http.bodies.MIN_BODY_RATE", 1000)
    with sending(tenants.ann, "/v1/jobs", length=2**20) as connection:
        connection.settimeout(0.05)
        answer = b""
        deadline = time.monotonic() + 240
        while b"request_timeout" not in answer:
            assert time.monotonic() < deadline, "the sender keeps its slot"
            with contextlib.suppress(TimeoutError):
                connection.sendall(b"12345")
                answer += connection.recv(65536)
    assert answer.startswith(b"HTTP/1.1 408 ")
    assert b"1000 bytes per second" in answer


def test_slow_files_of_one_owner_do_not_delay_the_checks_of_others(
    tenants: Tenants, sphere: bytes, repository: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ann, bob, slots = tenants.ann, tenants.bob, tenants.shared.intake
    release, real = threading.Event(), check.check_asset_subprocess

    def slow(path: Path, filename: str, *more: Any, **others: Any) -> object:
        if filename == "slow.glb":
            assert release.wait(60)
        return real(path, filename, *more, **others)

    monkeypatch.setattr(check, "check_asset_subprocess", slow)
    cube = (repository / "examples" / "cube.glb").read_bytes()
    with ThreadPoolExecutor(6) as pool:
        slow_posts = [pool.submit(post, ann, cube, PROMPT, "slow.glb") for _ in range(6)]
        try:
            until(lambda: slots._held["ann"] == slots.per_owner and len(slots._waiting.get("ann", ())) == 4)
            assert post(bob, sphere).status_code == 202
        finally:
            release.set()
        assert {each.result().status_code for each in slow_posts} == {202}
