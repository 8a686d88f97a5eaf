"""Fill the disk with jobs: what an owner's jobs keep is limited, files, checkpoints and artifacts together."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import event

from meshdeform.errors import TooMuchStoredError
from meshdeform.record import files
from meshdeform.record.models import Artifact, Job, JobState, NewJob, Origin, OriginMode, StoredFile
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest
from meshdeform.settings import Settings
from meshdeform.storage import ObjectStore
from service.http.auth import principal
from tests.claims import claim_job
from tests.integration.conftest import DEADLINE_S, serving_app
from tests.integration.http_calls import PROMPT, check_problem
from tests.integration.record_calls import artifact, set_to
from tests.integration.test_api_owners import named

LIMIT = 200_000


@pytest.fixture
def settings(own_settings: Callable[..., Settings]) -> Settings:
    return own_settings(max_stored_bytes=LIMIT)


@pytest.fixture
def url(settings: Settings) -> Iterator[str]:
    """A server on which the jobs of each owner keep 200,000 bytes at most."""
    with serving_app(settings) as (url, app):
        app.dependency_overrides[principal] = named
        yield url


def test_the_bytes_of_an_owners_jobs_are_limited(
    url: str, settings: Settings, record: JobRecord, sphere: bytes, repository: Path
) -> None:
    vase = (repository / "examples" / "vase.glb").read_bytes()
    assert len(sphere) < LIMIT < len(sphere) + len(vase)
    with httpx.Client(base_url=url, headers={"x-owner": "ann"}, timeout=DEADLINE_S) as ann:

        def post(asset: bytes, **headers: str) -> httpx.Response:
            files = {"asset": ("a.glb", asset), "request": (None, '{"prompt": "a mushroom"}')}
            return ann.post("/v1/jobs", files=files, headers=headers)

        assert ann.get("/v1/limits").json()["jobs"]["max_stored_bytes"] == LIMIT
        first: dict[str, Any] = post(sphere).json()
        assert post(sphere).status_code == 202, "the same file counts once"
        refused = post(vase)
        problem = check_problem(refused, 429, "too_much_stored")
        assert (problem["limit"], problem["stored"]) == (LIMIT, len(sphere))
        assert int(refused.headers["retry-after"]) >= 600
        # Nothing of it was stored.
        assert len(list(ObjectStore(settings.resolved_storage_url).list())) == 1
        assert post(vase, **{"x-owner": "bob"}).status_code == 202, "the files of others do not count"

        # What its job has written counts, and a retry needs room too.
        claim_job(record.leases, first["id"], "worker", 60.0)
        record.leases.set_checkpoint(first["id"], 1, "k", 5, "c" * 64, size=LIMIT)
        record.request_cancel(first["id"])
        record.leases.finish(first["id"], 1, JobState.CANCELED)
        check_problem(post(sphere), 429, "too_much_stored")
        check_problem(ann.post(f"/v1/jobs/{first['id']}/retry"), 429, "too_much_stored")
        # Deleting jobs makes files.
        assert ann.delete(f"/v1/jobs/{first['id']}").status_code == 204
        assert post(sphere).status_code == 202
        assert post(vase).status_code == 429


def made(record: JobRecord, size: int, limit: int = 0, origin: Origin | None = None, owner: str = "ann") -> Job:
    """Record a job with one file of this size."""
    file = StoredFile(key=f"assets/{uuid.uuid4().hex}", filename="a.glb", size=size, sha256="a" * 64)
    new = NewJob(JobRequest(**PROMPT), {"asset": file}, owner_id=owner, max_stored_bytes=limit, origin=origin)
    return record.create(new)


def stored(record: JobRecord) -> int:
    """Return the bytes of the jobs of the owner, as a refusal reports them."""
    with pytest.raises(TooMuchStoredError) as refused:
        record.check_room("ann", {"new": 2**40 + 1}, 2**40)
    return int(refused.value.extra["stored"])


@pytest.mark.both_databases
def test_the_sum_of_many_jobs_is_remembered_but_refuses_nobody(
    record: JobRecord, database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "_FEW", 2)
    monkeypatch.setattr(files, "_JOBS_PER_S", 0.001)
    sums: list[str] = []

    def note(_c: Any, _k: Any, statement: str, *_: Any) -> None:
        if "stored_bytes" in statement and "sum(" in statement and statement.startswith("SELECT"):
            sums.append(statement)

    for _ in range(3):
        made(record, 10)
    event.listen(record.database._engine, "before_cursor_execute", note)
    other = JobRecord(database_url)
    try:
        made(record, 10, limit=100)
        assert len(sums) == 1
        made(record, 10, limit=100)
        record.check_room("ann", {"a": 49}, 100)
        assert len(sums) == 1, "remembered, with the 20 bytes that were accepted since"
        made(other, 40)  # by another process
        record.check_room("ann", {"a": 50}, 100)
        assert len(sums) == 1, "not known here"
        with pytest.raises(TooMuchStoredError, match="keep 90 bytes"):
            record.check_room("ann", {"a": 51}, 100)
        assert len(sums) == 2, "nobody is refused by what is remembered"
        with pytest.raises(TooMuchStoredError):
            made(record, 11, limit=100)
        assert len(sums) == 3
        made(record, 10, limit=100, owner="bob")
        assert len(sums) == 4, "each owner has a sum of its own"
        monkeypatch.setattr(files, "_JOBS_PER_S", 1e9)
        for count in (5, 6):
            record.check_room("bob", {}, 100)
            assert len(sums) == count, "that of few jobs is made each time"
    finally:
        other.close()


@pytest.mark.both_databases
def test_what_workers_store_and_delete_is_counted(record: JobRecord) -> None:
    job = made(record, 1)
    made(record, 10**9, owner="bob")
    assert stored(record) == 1
    claim_job(record.leases, job.id, "worker", 60.0)
    mesh = artifact("mesh.glb")
    for step, size in ((5, 100), (10, 200)):
        record.leases.set_checkpoint(job.id, 1, f"k{step}", step, "c" * 64, size=size, mesh=mesh)
    assert stored(record) == 1 + 300 + 2 * mesh.size
    record.leases.forget_checkpoint(job.id, 1, "k5")
    assert stored(record) == 1 + 200 + mesh.size
    results: list[Artifact] = [artifact("result.glb"), artifact("preview.png")]
    record.leases.finish(job.id, 1, JobState.SUCCEEDED, results=results)
    assert stored(record) == 1 + 200 + mesh.size + sum(each.size for each in results)
    # The copy of a checkpoint that a branch begins with counts as long as any branch needs it.
    origin = Origin(job_id=job.id, step=10, mode=OriginMode.BRANCH, key="assets/c", sha256="c" * 64, size=1000)
    branches = [made(record, 2, origin=origin) for _ in range(2)]
    record.delete(job.id)
    assert stored(record) == 2 * 2 + 1000
    for branch in branches:
        record.request_cancel(branch.id)
        set_to(record, branch, retain_until=record.database.now(-1.0))
    record.upkeep.delete_retained()
    assert stored(record) == 0


@pytest.mark.both_databases
def test_jobs_that_come_at_once_are_counted_one_after_the_other(record: JobRecord) -> None:
    def create(_: int) -> bool:
        try:
            made(record, 10, limit=35)
        except TooMuchStoredError:
            return False
        return True

    with ThreadPoolExecutor(6) as pool:
        assert sum(pool.map(create, range(12))) == 3
