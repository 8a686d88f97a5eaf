"""Several hosts: an API and two workers against one PostgreSQL, one Redis and one S3, and a cable that is pulled."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.acceptance.cluster import Cluster, until
from tests.acceptance.hosts import Network, network
from tests.s3_server import S3Server, s3_server
from tests.servers import NotInstalledError, PostgresServer, RedisServer

pytestmark = pytest.mark.acceptance

STEPS = 400


@pytest.fixture
def hosts() -> Iterator[Network]:
    try:
        with network(["core", "api", "left", "right"]) as made:
            yield made
    except NotInstalledError as missing:
        pytest.skip(str(missing))


@pytest.mark.timeout(600)
def test_a_worker_host_that_is_cut_off_loses_its_job_to_the_other(
    tmp_path: Path, server_folder: Path, hosts: Network
) -> None:
    core = hosts.address("core")
    folder = server_folder / f"hosts-{time.time_ns()}"
    for name in ("postgres", "redis", "s3"):
        (folder / name).mkdir(parents=True)
    folder.chmod(0o755)
    try:
        postgres = PostgresServer(folder / "postgres", core)
        redis = RedisServer(folder / "redis", core)
    except NotInstalledError as missing:
        pytest.skip(str(missing))
    postgres.start()
    redis.start()
    try:
        with s3_server(folder / "s3", core) as s3:
            _run(tmp_path, hosts, postgres, redis, s3)
    except NotInstalledError as missing:
        pytest.skip(str(missing))
    finally:
        redis.stop()
        postgres.kill()


def _run(folder: Path, hosts: Network, postgres: PostgresServer, redis: RedisServer, s3: S3Server) -> None:
    environment = {**s3.settings(), "MESHDEFORM_AUTH": "off"}
    s3.make_bucket("several-hosts")
    with pytest.MonkeyPatch.context() as patch:
        for name, value in s3.settings().items():
            patch.setenv(name, value)
        cluster = Cluster(
            folder,
            redis,
            database_url=postgres.url,
            storage_url="s3://several-hosts",
            environment=environment,
            api_host=hosts.address("api"),
        )
        try:
            cluster.start_api(inside=hosts.inside("api"))
            cluster.start_worker("left", inside=hosts.inside("left"))
            answer = cluster.post(STEPS)
            assert answer.status_code == 202, answer.text
            job_id = answer.json()["id"]
            cluster.at_step(job_id, 20)
            hosts.cut_off("left")
            cluster.start_worker("right", inside=hosts.inside("right"))
            cluster.when(job_id, "the second attempt", lambda job: job.attempt == 2)
            job = cluster.check(job_id, steps=STEPS)
            assert job.attempt == 2
            last = cluster.events(job_id)[-1].seq
            hosts.connect("left")
            # The one that was cut off finds that its job is over, and takes the next one.
            cluster.parts["right"].stop()
            cluster.check(cluster.submit(12), steps=12)
            until("it noticed", lambda: "lost its lease" in cluster.parts["left"].log)
            assert cluster.events(job_id)[-1].seq == last
            assert cluster.http.get(f"/v1/jobs/{job_id}/artifacts/result.glb").status_code == 200
        finally:
            cluster.clean_up()
