"""Objects that nobody can reach any more."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshdeform.record.models import NewJob, Origin, OriginMode
from meshdeform.record.reconciler import remove_job, remove_unreachable
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import JobRequest
from meshdeform.storage import ObjectStore
from tests.integration.conftest import new_job, stored_file


@pytest.mark.both_databases
def test_one_job_is_removed_with_what_only_it_used(record: JobRecord, tmp_path: Path) -> None:
    store = ObjectStore(tmp_path)
    files = {letter: stored_file(letter) for letter in "abc"}
    for file in files.values():
        store.put(file.key, b"xyz")
    gone, shared, other, _ = (new_job(record, letter=letter) for letter in "aabb")
    discarded = new_job(record, letter="c")
    unused: dict[str, list[str]] = {}
    for job in (gone, shared, discarded):
        store.put(f"jobs/{job.id}/1/result.glb", b"result")
        record.request_cancel(job.id)
    for job in (gone, discarded):
        unused[job.id] = record.delete(job.id)
    assert unused == {gone.id: [files["a"].key], discarded.id: [files["c"].key]}
    remove_job(record, store, gone.id, unused[gone.id])
    assert not store.exists(f"jobs/{gone.id}/1/result.glb")
    assert store.exists(files["a"].key)
    assert store.exists(f"jobs/{shared.id}/1/result.glb")
    # Due for removal, and left to the reconciler.
    assert store.exists(f"jobs/{discarded.id}/1/result.glb")
    assert store.exists(files["c"].key)
    assert record.upkeep.discarded_prefixes() == [f"jobs/{discarded.id}/"]
    remove_unreachable(record, store)
    assert not any(map(store.exists, (f"jobs/{discarded.id}/1/result.glb", files["c"].key)))
    assert store.exists(files["a"].key)
    assert record.upkeep.discarded_prefixes() == []
    remove_job(record, store, shared.id, record.delete(shared.id))
    assert not store.exists(files["a"].key)
    assert store.exists(files["b"].key)
    assert record.get(other.id).files["asset"] == files["b"]
    # A target and the copy of a checkpoint go with their job, too.
    asset, target, copied = stored_file("d"), stored_file("e"), stored_file("f")
    for file in (asset, target, copied):
        store.put(file.key, b"xyz")
    origin = Origin(job_id="job_before", step=4, mode=OriginMode.RETRY, key=copied.key, sha256=copied.sha256)
    job = record.create(NewJob(JobRequest(prompt="a vase"), {"asset": asset, "target": target}, origin=origin))
    record.request_cancel(job.id)
    unused[job.id] = record.delete(job.id)
    assert unused[job.id] == [asset.key, target.key, copied.key]
    remove_job(record, store, job.id, unused[job.id])
    assert not any(map(store.exists, unused[job.id]))
    assert record.files.unused() == []
