"""Name servers that do not answer must not hold up anything but the look-ups of whoever asks for them."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest

from meshdeform.outgoing import lookups
from meshdeform.outgoing.lookups import LookupPool
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from meshdeform.webhooks.sender import Sender
from service.webhooks import routes
from tests.integration.conftest import DEADLINE_S, serving
from tests.servers import free_port
from tests.waiting import until

MANY = 60  # more than the threads that serve requests


@pytest.fixture
def silence(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Make the look-ups of `*.silent.example` wait until this is set, or the test ends."""
    end, real = threading.Event(), socket.getaddrinfo

    def getaddrinfo(host: str, *arguments: Any, **options: Any) -> Any:
        if not str(host).endswith(".silent.example"):
            return real(host, *arguments, **options)
        end.wait(DEADLINE_S)
        raise OSError("no answer")

    monkeypatch.setattr(socket, "getaddrinfo", getaddrinfo)
    yield end
    end.set()


def test_slow_look_ups_hold_up_neither_other_requests_nor_other_owners_nor_files(
    silence: threading.Event, redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    networks = ["127.0.0.0/8"]
    settings = Settings(data_dir=tmp_path, redis_url=redis_url, webhook_networks=networks, fetch_networks=networks)
    record = JobRecord(settings.resolved_database_url)
    ann, bob = ({"Authorization": f"Bearer {record.keys.create(owner)[1]}"} for owner in ("ann", "bob"))
    record.close()
    with serving(settings) as url, httpx.Client(base_url=url, timeout=DEADLINE_S) as http:

        def create(number: int) -> int:
            body = {"url": f"https://{number}.silent.example/"}
            return httpx.post(f"{url}/v1/webhooks", json=body, headers=ann, timeout=DEADLINE_S).status_code

        monkeypatch.setattr(routes, "LOOKUP_S", 0.01)
        assert create(0) == 503
        monkeypatch.setattr(routes, "LOOKUP_S", DEADLINE_S)
        with ThreadPoolExecutor(MANY) as pool:
            slow = [pool.submit(create, number) for number in range(MANY)]
            until(lambda: sum(future.done() for future in slow) > MANY // 2, "her share is taken")
            assert http.get("/v1/jobs", headers=bob).status_code == 200
            assert http.post("/v1/webhooks", json={"url": "http://127.0.0.1:8080/"}, headers=bob).status_code == 201
            job = {"prompt": "a mushroom", "asset": {"url": f"http://127.0.0.1:{free_port()}/a.glb"}}
            assert http.post("/v1/jobs", json=job, headers=ann).json()["code"] == "asset_not_fetched"
            assert not all(future.done() for future in slow)
            silence.set()
            assert {future.result() for future in slow} == {429, 422}


@pytest.mark.usefixtures("silence")
def test_the_sender_gives_up_a_slow_look_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lookups, "LOOKUP_S", 0.1)
    sender = Sender(lookup=LookupPool(1).lookup)
    for number in range(2):  # the second one waits for the thread of the first
        outcome = sender.send(f"https://{number}.silent.example/", "msg_1", {}, [])
        assert "silent.example" in outcome.error
