"""A Redis that answers and refuses is as good as away: jobs are accepted and run, and who asks is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.acceptance.cluster import deployed
from tests.acceptance.service import until
from tests.shut_redis import HALF_SHUT, shut_redis

pytestmark = pytest.mark.acceptance


def test_jobs_run_while_redis_refuses(tmp_path: Path, subtests: pytest.Subtests) -> None:
    with deployed(tmp_path) as cluster:
        cluster.start_api()
        worker = cluster.start_worker()
        cluster.check(cluster.submit())
        process = worker.child()
        for way in ("full", "a replica of nobody", HALF_SHUT):
            lost, heard = (worker.log.count(f"Redis is {state}") for state in ("away", "back"))
            with subtests.test(way), shut_redis(cluster.redis.url, way) as reopen:
                assert cluster.http.get("/readyz").status_code == (200 if way == HALF_SHUT else 503)
                posted = cluster.post()
                assert posted.status_code == 202, posted.text
                cluster.check(posted.json()["id"])
                # Its wait for a message may outlast all of the above.
                until("it is missed", lambda lost=lost: worker.log.count("Redis is away") > lost)
                reopen()
                until("it is heard again", lambda heard=heard: worker.log.count("Redis is back") > heard)
                assert cluster.http.get("/readyz").status_code == 200
                cluster.check(cluster.submit())
                assert process.is_running()


def test_a_worker_starts_while_redis_refuses(tmp_path: Path) -> None:
    with deployed(tmp_path) as cluster, shut_redis(cluster.redis.url, "full"):
        worker = cluster.start_worker()
        cluster.check(cluster.submit())
        assert worker.stop() == 0
    assert "Traceback" not in worker.log
