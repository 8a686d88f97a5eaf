"""A record, a store and a real server on SQLite; what is marked `both_databases` runs on PostgreSQL, too."""

from __future__ import annotations

import json
import socket
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
import sqlalchemy as sa
import uvicorn
from fastapi import FastAPI

from meshdeform.record.models import Artifact, Job, NewJob, StoredFile
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import metadata
from meshdeform.requests.document import JobRequest
from meshdeform.serving.connections import http_options
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from meshdeform.webhooks.delivery import WebhookDelivery
from service.app import create_app
from tests.in_process import children_in_process
from tests.servers import free_port, postgres_database
from tests.unit.webhooks.receiver import Receiver, receiving

DEADLINE_S = 240.0
WEBHOOK_SETTINGS = Settings(webhook_networks=["127.0.0.0/8"])
"""What lets messages go to a receiver on loopback."""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run what is marked `both_databases` on PostgreSQL as well."""
    if "database_url" not in metafunc.fixturenames or "database_url" in _own_parameters(metafunc):
        return
    both = metafunc.definition.get_closest_marker("both_databases")
    databases = ["sqlite", "postgresql"] if both else ["sqlite"]
    metafunc.parametrize("database_url", databases, indirect=True, scope="module")


def _own_parameters(metafunc: pytest.Metafunc) -> list[str]:
    """Return what the test's own `parametrize` marks name."""
    return [str(mark.args[0]) for mark in metafunc.definition.iter_markers("parametrize")]


@pytest.fixture(scope="module")
def database_url(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A database of its own for the module: "sqlite" or "postgresql", as `pytest_generate_tests` says."""
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path_factory.mktemp('record') / 'record.sqlite'}"
        return
    with postgres_database(request.getfixturevalue("postgres_port")) as url:
        yield url.replace("+pg8000", "")


@pytest.fixture
def record(database_url: str) -> Iterator[JobRecord]:
    """An empty record."""
    opened = JobRecord(database_url)
    with opened._database.write() as connection:
        for table in reversed(metadata.sorted_tables):
            connection.execute(sa.delete(table))
    yield opened
    opened.close()


def stored_file(letter: str = "a", filename: str = "sphere.glb") -> StoredFile:
    """A file that nobody really stored."""
    return StoredFile(key=f"assets/{letter * 64}", filename=filename, size=3, sha256=letter * 64)


def stored_result(store: ObjectStore, key: str, content: bytes, content_type: str = "model/gltf-binary") -> Artifact:
    """An artifact that is stored, named like the end of its key."""
    stored = store.put(key, content, content_type)
    name = key.rpartition("/")[2]
    return Artifact(name=name, content_type=content_type, size=stored.size, sha256=stored.sha256, key=key)


def new_job(record: JobRecord, prompt: str = "a mushroom", letter: str = "a") -> Job:
    """A queued job."""
    return record.create(NewJob(JobRequest(prompt=prompt), {"asset": stored_file(letter)}))


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    """Something that takes messages to webhooks."""
    with receiving() as found:
        yield found


@pytest.fixture
def delivery(record: JobRecord) -> WebhookDelivery:
    """What sends them."""
    return WebhookDelivery(record, WEBHOOK_SETTINGS)


@pytest.fixture(scope="session")
def sphere(repository: Path) -> bytes:
    """A small GLB."""
    return (repository / "examples" / "sphere.glb").read_bytes()


@pytest.fixture(scope="session")
def openapi(repository: Path) -> dict[str, Any]:
    """The OpenAPI document as it is committed."""
    document: dict[str, Any] = json.loads((repository / "openapi" / "openapi.json").read_text())
    return document


@dataclass(frozen=True)
class Api:
    """A real server on loopback, and the parts behind it."""

    url: str
    settings: Settings
    record: JobRecord
    store: ObjectStore
    http: httpx.Client


class _Server(uvicorn.Server):
    """In a thread no signal tells the application that it ends; this does."""

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self.app.state.app_state.waiters.close()
        await super().shutdown(sockets)

    app: FastAPI


@contextmanager
def serving_app(settings: Settings) -> Iterator[tuple[str, FastAPI]]:
    """Run the application on uvicorn, in a thread, and give its URL and itself."""
    port = free_port()
    app = create_app(settings)
    config = uvicorn.Config(app, host="127.0.0.1", port=port, log_level="warning", **http_options(settings))
    server = _Server(config)
    server.app = app
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        deadline = time.monotonic() + DEADLINE_S
        while not server.started:
            assert thread.is_alive(), "the server did not start"
            assert time.monotonic() < deadline, "the server did not start in time"
            time.sleep(0.01)
        yield f"http://127.0.0.1:{port}", app
    finally:
        server.should_exit = True
        thread.join()


@contextmanager
def serving(settings: Settings) -> Iterator[str]:
    """Run the application as `serving_app` does; what it leaves to child processes is done in this one."""
    with children_in_process(), serving_app(settings) as (url, _):
        yield url


@pytest.fixture(scope="module")
def own_settings(
    database_url: str, redis_server_url: str, tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Settings]:
    """Make the settings of a server that has a folder and a queue of its own; by name, what else is set."""

    def make(**more: Any) -> Settings:
        given = {"data_dir": tmp_path_factory.mktemp("api"), "queue": f"test-{uuid.uuid4().hex}"}
        return Settings(database_url=database_url, redis_url=redis_server_url, **{**given, **more})

    return make


@contextmanager
def serving_api(settings: Settings) -> Iterator[Api]:
    """Run the application as `serving` does, and open what is behind it."""
    with serving(settings) as url, httpx.Client(base_url=url, timeout=DEADLINE_S) as http:
        record = JobRecord(settings.resolved_database_url)
        yield Api(url, settings, record, ObjectStore(settings.resolved_storage_url), http)
        record.close()


Start = Callable[..., httpx.Client]


@pytest.fixture
def start(record: JobRecord, database_url: str, redis_url: str, tmp_path: Path) -> Iterator[Start]:
    """Start a server on the record with these settings; several may run at the same time."""
    queue = f"test-{uuid.uuid4().hex}"
    with ExitStack() as cleanup:

        def run(**settings: Any) -> httpx.Client:
            defaults = {"data_dir": tmp_path, "database_url": database_url, "redis_url": redis_url, "queue": queue}
            url = cleanup.enter_context(serving(Settings(**{**defaults, **settings})))
            return cleanup.enter_context(httpx.Client(base_url=url, timeout=DEADLINE_S))

        yield run


@pytest.fixture(scope="module")
def api(own_settings: Callable[..., Settings]) -> Iterator[Api]:
    """The API with nothing faked behind it; what it leaves to child processes is done in this one."""
    with serving_api(own_settings(max_upload_bytes=2**20)) as found:
        yield found
