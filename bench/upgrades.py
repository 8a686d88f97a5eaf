"""Upgrade a deployment that is at work: ``scripts/upgrade-test COMMIT ...``.

For each commit, its API and its worker fill a record with a job in every state; then those of this tree start beside
them, which migrates the record, and both go on: each lists all jobs, takes new ones, and finishes what the other has
begun. At the end every job must have ended once, with the result of an undisturbed run. The interpreter's packages must
suit both. Exits with 1, and says what was wrong, if anything was.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import TypedDict, Unpack

import httpx
import sqlalchemy as sa

from meshdeform.record.models import JobState
from tests.acceptance.cluster import ROOT, Cluster, running_redis
from tests.acceptance.service import until
from tests.servers import PostgresServer, free_port

STEPS, LONG = 12, 1200
"""Steps of a job, and of one that an old worker has not done before the new version has started."""
_STEP_S = {"old": "0.1", "new": "0.001"}
WORKER = ("-m", "tests.fake_worker", "--supervised")


class Limits(TypedDict, total=False):
    """Limits of a job, as its request has them."""

    max_run_s: float
    deadline_s: float


class Versions(Cluster):
    """A deployment with parts of two versions, named `old` and `new`, on one record."""

    ports: dict[str, int]
    trees: dict[str, Path]

    def start(self, version: str, part: str) -> None:
        """Start the API or the worker of a version."""
        command = ("-m", "meshdeform", "api", "--port", str(self.ports[version])) if part == "api" else WORKER
        environment = {"PYTHONPATH": str(self.trees[version]), "FAKE_STEP_S": _STEP_S[version]}
        # Without the folder in which it is started, where this tree is.
        self._start(f"{version} {part}", [sys.executable, "-P", *command], environment)
        if part == "api":
            until(f"the {version} API answers", lambda: httpx.get(f"{self.url(version)}/healthz").is_success)

    def url(self, version: str) -> str:
        """The address of a version's API."""
        return f"http://127.0.0.1:{self.ports[version]}"

    def send_job(self, version: str, steps: int = STEPS, **limits: Unpack[Limits]) -> str:
        """Post a job to a version's API."""
        self.http.base_url = httpx.URL(self.url(version))
        answer = self.post(steps, **limits)
        assert answer.status_code == 202, f"{version}: {answer.text}"
        return str(answer.json()["id"])

    def states(self, version: str) -> dict[str, str]:
        """The states of all jobs, as a version's API lists them."""
        answer = httpx.get(f"{self.url(version)}/v1/jobs", params={"limit": 200}, timeout=60.0)
        assert answer.status_code == 200, f"{version}: {answer.text}"
        return {job["id"]: job["state"] for job in answer.json()["jobs"]}


def filled(cluster: Versions) -> tuple[dict[str, str], dict[str, JobState]]:
    """Let the old version make a job in every state; return them by name, and the end that each must have."""
    done = cluster.send_job("old")
    cluster.finished(done)
    failed = cluster.send_job("old", LONG, max_run_s=1.0)
    cluster.finished(failed)
    running = cluster.send_job("old", LONG)
    cluster.at_step(running, 5)
    canceled, expired = cluster.send_job("old"), cluster.send_job("old", deadline_s=1.0)
    httpx.post(f"{cluster.url('old')}/v1/jobs/{canceled}/cancel")
    cluster.finished(expired)
    queued = cluster.send_job("old", LONG)
    jobs = {"succeeded": done, "failed": failed, "canceled": canceled, "expired": expired}
    jobs |= {"running": running, "queued": queued}
    ends = {name: JobState(name) for name in ("succeeded", "failed", "canceled", "expired")}
    return jobs, {**ends, "running": JobState.SUCCEEDED, "queued": JobState.SUCCEEDED}


def upgraded(cluster: Versions) -> None:
    """Fill the record, start the new version beside the old one, and let both go on."""
    cluster.start("old", "api")
    cluster.start("old", "worker")
    jobs, ends = filled(cluster)
    cluster.start("new", "api")
    assert cluster.states("old").keys() == cluster.states("new").keys()
    for version in ("new", "old"):
        jobs[f"posted to the {version} one"] = cluster.send_job(version)
    cluster.start("new", "worker")
    jobs["retried"] = httpx.post(f"{cluster.url('new')}/v1/jobs/{jobs['canceled']}/retry").json()["id"]
    # The old worker dies in the middle of a job, and one that is to be canceled with it.
    cluster.at_step(jobs["running"], 10)
    cluster.parts["old worker"].kill()
    for name in ("posted to the new one", "posted to the old one", "retried", "running", "queued"):
        ends[name] = JobState.SUCCEEDED
    for name, job_id in jobs.items():
        steps = LONG if name in ("running", "queued") else STEPS
        job = cluster.check(job_id, steps=steps, state=ends[name])
        print(f"    {name}: {job.state}, attempt {job.attempt}, made by {job.made_by}", flush=True)
    assert cluster.states("old") == cluster.states("new")
    # The old version still takes what comes after the upgrade.
    cluster.parts["new worker"].stop()
    cluster.start("old", "worker")
    cluster.check(cluster.send_job("new"), steps=STEPS)
    canceling = cluster.send_job("old", LONG)
    cluster.at_step(canceling, 3)
    cluster.parts["old worker"].kill()
    httpx.post(f"{cluster.url('old')}/v1/jobs/{canceling}/cancel")
    cluster.check(canceling, state=JobState.CANCELED)


def tree_of(commit: str, folder: Path) -> Path:
    """Put the files of a commit into a new folder, and return it."""
    folder.mkdir()
    archive = subprocess.run(["git", "archive", commit], check=True, stdout=subprocess.PIPE, cwd=ROOT).stdout
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive, check=True)
    return folder


def tried(commit: str, database: str) -> None:
    """Upgrade from a commit on one kind of database."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="meshdeform-upgrade-")))
        folder.chmod(0o755)
        tree = tree_of(commit, folder / "tree")
        redis, url = stack.enter_context(running_redis(folder)), ""
        if database == "postgresql":
            (folder / "postgres").mkdir()
            server = PostgresServer(folder / "postgres")
            server.start()
            stack.callback(server.stop)
            operator = sa.make_url(server.url).set(drivername="postgresql+pg8000")
            with sa.create_engine(
                operator, isolation_level="AUTOCOMMIT", poolclass=sa.NullPool
            ).connect() as connection:
                connection.execute(sa.text("CREATE DATABASE service"))
            url = server.url.replace("/postgres", "/service")
        # Before this process opens the record, which migrates it: the old version makes it.
        open_record = "import sys; from meshdeform.record.repository import JobRecord; JobRecord(sys.argv[1]).close()"
        made = url or f"sqlite:///{folder / 'record.sqlite'}"
        environment = {"PYTHONPATH": str(tree), "PATH": "/usr/bin:/bin"}
        subprocess.run([sys.executable, "-P", "-c", open_record, made], check=True, env=environment)
        cluster = Versions(folder, redis, database_url=url)
        stack.callback(cluster.clean_up)
        cluster.trees, cluster.ports = {"old": tree, "new": ROOT}, {"old": free_port(), "new": free_port()}
        upgraded(cluster)


def main() -> int:
    """Try every commit on both databases, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("commits", nargs="+", metavar="COMMIT")
    parser.add_argument("--databases", nargs="+", default=["sqlite", "postgresql"])
    arguments, wrong = parser.parse_args(), 0
    for commit in arguments.commits:
        for database in arguments.databases:
            print(f"{commit} on {database}", flush=True)
            try:
                tried(commit, database)
            except AssertionError as error:
                wrong += 1
                print(f"    wrong: {error}", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
