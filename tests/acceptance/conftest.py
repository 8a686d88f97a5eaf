"""What more than one file of faults starts."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.acceptance.cluster import Cluster, deployed
from tests.servers import NotInstalledError, PostgresServer


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """A deployment on SQLite and a folder, with nothing started but Redis."""
    with deployed(tmp_path) as made:
        yield made


@pytest.fixture
def postgres(server_folder: Path) -> Iterator[PostgresServer]:
    """A PostgreSQL of the test's own, which may crash."""
    folder = server_folder / f"postgres-{time.time_ns()}"
    folder.mkdir()
    try:
        server = PostgresServer(folder, durable=True)
    except NotInstalledError as missing:
        pytest.skip(str(missing))
    server.start()
    yield server
    server.kill()
