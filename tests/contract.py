"""The service against its own description: Schemathesis makes requests up and compares the answers with OpenAPI.

The suite runs a little of it (tests/integration/test_schemathesis.py); ``python -m tests.contract --examples 200``
runs it for as long as that takes.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import httpx

import service.http.auth
from meshdeform.errors import MeshdeformError
from meshdeform.record.models import JobState
from meshdeform.record.repository import JobRecord
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from service.http.limits import Rate
from tests.contract_links import add_links
from tests.integration.conftest import serving, stored_result
from tests.servers import redis_server

ROOT = Path(__file__).resolve().parent.parent
PHASES = "examples,coverage,fuzzing,stateful"


@contextmanager
def service_under_test(folder: Path, redis_url: str) -> Iterator[tuple[str, str]]:
    """A service that wants keys, with a worker that needs no time: its URL and a key."""
    settings = Settings(
        data_dir=folder,
        redis_url=redis_url,
        queue=f"test-{folder.name}",
        auth="on",
        requests_per_minute=0,
        max_active_jobs=0,
        max_priority=100,
        max_upload_bytes=2**20,
        webhook_networks=["127.0.0.0/8"],
    )
    guesses = service.http.auth._FAILURES
    # Every request is also made without a key and with a wrong one: more guesses than one address may make.
    service.http.auth._FAILURES = Rate(per_minute=10**9, burst=10**9)
    over = threading.Event()
    try:
        with serving(settings) as url:
            record, store = JobRecord(settings.resolved_database_url), ObjectStore(settings.resolved_storage_url)
            worker = threading.Thread(target=_work, args=(record, store, over))
            worker.start()
            try:
                yield url, record.keys.create("contract")[1]
            finally:
                over.set()
                worker.join()
                record.close()
    finally:
        service.http.auth._FAILURES = guesses


def _work(record: JobRecord, store: ObjectStore, over: threading.Event) -> None:
    """Bring two of three jobs to their end; the third runs until somebody cancels it."""
    taken = 0
    while not over.is_set():
        job = record.leases.claim_next("worker", 3600.0)
        if job is None:
            over.wait(0.05)
            continue
        taken += 1
        with suppress(MeshdeformError):  # canceled meanwhile
            key = f"jobs/{job.id}/{job.attempt}/result.glb"
            result = stored_result(store, key, store.get(job.files["asset"].key))
            record.leases.set_checkpoint(job.id, job.attempt, key, 5, result.sha256, size=result.size, mesh=result)
            if taken % 3:
                record.leases.finish(job.id, job.attempt, JobState.SUCCEEDED, results=[result])


def run(
    url: str, key: str, *, examples: int, chains: int = 60, phases: str = PHASES
) -> subprocess.CompletedProcess[str]:
    """Run Schemathesis with every check and so many chains of requests; the same requests each time."""
    # Fetched here, because Schemathesis waits ten seconds at most, whatever the machine is busy with.
    document = httpx.get(f"{url}/openapi.json", timeout=120).raise_for_status().json()
    add_links(document)
    command = [sys.executable, "-m", "schemathesis.cli", "--config-file", "schemathesis.toml"]
    command += ["--no-color", "run", "openapi.json", "--url", url]
    command += ["--checks", "all", "--phases", phases, "--max-examples", str(examples), "--request-timeout", "120"]
    command += ["--generation-deterministic", "--continue-on-failure", "--suppress-health-check", "all"]
    environment = {
        **os.environ,
        "CONTRACT_KEY": key,
        "SCHEMATHESIS_HOOKS": "tests.contract_hooks",
        "PYTHONPATH": str(ROOT),
    }
    settings = (ROOT / "tests/schemathesis.toml").read_text().replace("${CHAINS}", str(chains))
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "schemathesis.toml").write_text(settings)
        (Path(folder) / "openapi.json").write_text(json.dumps(document))
        return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def main() -> int:
    """Run it against a service of its own."""
    parser = argparse.ArgumentParser(prog="python -m tests.contract", description=__doc__)
    parser.add_argument("--examples", type=int, default=200, help="requests for each operation (default: %(default)s)")
    parser.add_argument("--phases", default=PHASES, help="default: %(default)s")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="meshdeform-contract-") as name:
        folder = Path(name)
        (folder / "redis").mkdir()
        with redis_server(folder / "redis") as redis_url, service_under_test(folder, redis_url) as (url, key):
            done = run(url, key, examples=options.examples, phases=options.phases)
    print(done.stdout, done.stderr, sep="\n")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
