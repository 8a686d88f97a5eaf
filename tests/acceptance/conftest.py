"""What more than one file of faults starts."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.acceptance.cluster import Cluster, running_redis


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """A deployment on SQLite and a folder, with nothing started but Redis."""
    with running_redis(tmp_path) as redis:
        made = Cluster(tmp_path, redis)
        yield made
        made.clean_up()
