"""Which stored files are in use, by jobs, requests and uploads, on SQLite and PostgreSQL."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from pathlib import Path

import pytest
import sqlalchemy as sa

from meshdeform.errors import NotFoundError, UnavailableError
from meshdeform.record.models import NewJob, Origin, OriginMode
from meshdeform.record.reconciler import remove_job, remove_unreachable
from meshdeform.record.repository import JobRecord
from meshdeform.record.schema import files
from meshdeform.requests.document import JobRequest
from meshdeform.storage import ObjectStore
from tests.integration.conftest import DEADLINE_S, new_job, stored_file

pytestmark = pytest.mark.both_databases


def test_a_file_is_unused_when_neither_a_job_nor_a_request_needs_it(record: JobRecord) -> None:
    key = stored_file("d").key
    for _ in range(2):  # two requests of the same file
        record.files.pin(key)
    record.files.unpin([key])
    assert record.files.unused() == []
    job = new_job(record, letter="d")
    assert record.files.unused() == []
    record.request_cancel(job.id)
    record.delete(job.id)
    assert record.files.unused() == [key]
    record.files.pin(key)
    assert record.files.unused() == []
    removed: list[str] = []
    assert not record.files.remove_unused(key, removed.append)
    record.files.unpin([key])

    def away(_: str) -> None:
        raise UnavailableError("away")

    with pytest.raises(UnavailableError):
        record.files.remove_unused(key, away)
    assert record.files.unused() == [key]
    assert record.files.remove_unused(key, removed.append)
    assert not record.files.remove_unused(key, removed.append)
    assert removed == [key]


def test_a_pin_waits_until_the_file_that_is_being_removed_is_gone(record: JobRecord) -> None:
    key = stored_file("f").key
    record.files.unpin([key])
    order: list[str] = []
    with ThreadPoolExecutor(1) as pool:

        def remove(_: str) -> None:
            pin = pool.submit(lambda: (record.files.pin(key), order.append("pinned")))
            # It cannot get through while the removal holds the row; a moment in which it could is enough to show it.
            with pytest.raises(TimeoutError):
                pin.result(timeout=0.3)
            order.append("removed")

        assert record.files.remove_unused(key, remove)
    assert order == ["removed", "pinned"]
    assert record.files.unused() == []


def test_the_pin_of_a_request_that_died_does_not_last(record: JobRecord) -> None:
    key = stored_file("1").key
    record.files.pin(key)
    with record.database.write() as connection:
        connection.execute(sa.update(files).values(touched_at=record.database.now(-3590.0)))
    assert record.files.unused() == []
    with record.database.write() as connection:
        connection.execute(sa.update(files).values(touched_at=record.database.now(-3610.0)))
    assert record.files.unused() == [key]


def test_a_complete_upload_holds_its_file_until_it_is_forgotten(record: JobRecord) -> None:
    key = stored_file("2").key
    made = record.uploads.create("me", "sphere.glb", 7, 60.0)
    assert (made.complete, made.key, made.sha256) == (False, None, None)
    assert made.expires_at - made.created_at >= timedelta(seconds=60)
    assert record.uploads.get(made.id, "me") == made
    record.files.pin(key)
    done = record.uploads.complete(made.id, "2" * 64, key)
    assert (done.complete, done.key, done.sha256) == (True, key, "2" * 64)
    assert record.uploads.get(made.id) == done
    assert record.files.unused() == []
    # The same again, as after an answer that was lost: with a pin of its own, which goes too.
    record.files.pin(key)
    assert record.uploads.complete(made.id, "2" * 64, key) == done
    record.uploads.delete(made.id, "me")
    assert record.files.unused() == [key]


def test_an_upload_is_its_owners_and_ends_with_its_time(record: JobRecord) -> None:
    made, over = record.uploads.create("me", "a.glb", 7, 60.0), record.uploads.create("me", "b.glb", 7, -1.0)
    with pytest.raises(NotFoundError):
        record.uploads.get(made.id, "them")
    with pytest.raises(NotFoundError):
        record.uploads.delete(made.id, "them")
    with pytest.raises(NotFoundError):
        record.uploads.get(over.id, "me")
    with pytest.raises(NotFoundError):
        record.uploads.complete(over.id, "3" * 64, "assets/3")
    assert record.files.unused() == []
    assert record.upkeep.expired_uploads() == [over.id]
    record.uploads.delete(over.id)
    assert record.upkeep.expired_uploads() == []
    with pytest.raises(NotFoundError):
        record.uploads.delete(over.id)


def test_others_write_while_the_store_takes_its_time_to_remove_a_file(record: JobRecord) -> None:
    key = stored_file("4").key
    record.files.unpin([key])

    def remove(_: str) -> None:
        with ThreadPoolExecutor(1) as pool:
            assert pool.submit(new_job, record).result(timeout=DEADLINE_S).attempt == 0
            # Nobody else removes it at the same time.
            assert not pool.submit(record.files.remove_unused, key, _never).result(timeout=DEADLINE_S)
        assert record.files.unused() == []

    assert record.files.remove_unused(key, remove)
    assert record.files.unused() == []


def test_a_removal_whose_process_died_is_taken_over(record: JobRecord) -> None:
    for letter, take in (("6", "remove"), ("7", "pin")):
        key = stored_file(letter).key
        with record.database.write() as connection:
            connection.execute(sa.insert(files).values(key=key, pins=-1, touched_at=record.database.now(-890.0)))
        assert key not in record.files.unused()
        with record.database.write() as connection:
            connection.execute(sa.update(files).values(touched_at=record.database.now(-910.0)))
        assert record.files.unused() == [key]
        if take == "remove":
            assert record.files.remove_unused(key, lambda _: None)
        else:
            record.files.pin(key)
            record.files.unpin([key])
            assert record.files.unused() == [key]


def _never(key: str) -> None:
    raise AssertionError(key)


# Objects that nobody can reach any more


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
