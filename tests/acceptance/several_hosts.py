"""Run an API and two workers on separate hosts against one PostgreSQL, one Redis and one S3, and pull a cable.

Run as a program: `python -m tests.acceptance.several_hosts FOLDER SERVERS`. It moves into a network namespace, which
must not happen in the process of the tests: threads that libraries start meanwhile (obstore's) would stay there.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.acceptance.cluster import Cluster, until
from tests.acceptance.hosts import Network, network
from tests.s3_server import S3Server, s3_server
from tests.servers import NotInstalledError, PostgresServer, RedisServer

STEPS = 100
# The exit code of a run that lacks a program or a right, and says so on standard error.
NOT_INSTALLED = 77


def main(folder: Path, servers: Path) -> None:
    """Run the scenario; `servers` is a folder for servers that run as users of their own, readable by all."""
    for name in ("postgres", "redis", "s3"):
        (servers / name).mkdir(parents=True)
    servers.chmod(0o755)
    with network(["core", "api", "left", "right"]) as hosts:
        core = hosts.address("core")
        postgres = PostgresServer(servers / "postgres", core)
        redis = RedisServer(servers / "redis", core)
        postgres.start()
        redis.start()
        try:
            with s3_server(servers / "s3", core) as s3:
                _run(folder, hosts, postgres, redis, s3)
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
            # Slow enough to be cut off; few checkpoints, because each costs the S3 server much.
            cluster.start_worker("left", inside=hosts.inside("left"), FAKE_STEP_S="0.05")
            answer = cluster.post(STEPS, every=10)
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


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
    except NotInstalledError as missing:
        print(missing, file=sys.stderr)
        sys.exit(NOT_INSTALLED)
