"""Objects that nobody can reach any more, on SQLite and PostgreSQL."""

from __future__ import annotations

from pathlib import Path

import pytest

from meshdeform.errors import UnavailableError
from meshdeform.jobs.cleanup import remove_unreachable
from meshdeform.jobs.record import JobRecord
from meshdeform.storage import ObjectStore
from tests.integration.conftest import new_job, stored_file


def test_deleted_jobs_leave_nothing_and_shared_files_stay(record: JobRecord, tmp_path: Path) -> None:
    store = ObjectStore(tmp_path)
    shared, own = stored_file("a"), stored_file("b")
    for file in (shared, own):
        store.put(file.key, b"xyz")
    first, second, third = new_job(record, letter="a"), new_job(record, letter="a"), new_job(record, letter="b")
    for job in (first, third):
        store.put(f"jobs/{job.id}/1/result.glb", b"result")
        record.request_cancel(job.id)
        record.delete(job.id)
    remove_unreachable(record, store)
    assert store.exists(shared.key)
    assert not store.exists(own.key)
    assert not store.exists(f"jobs/{first.id}/1/result.glb")
    assert record.discarded_prefixes() == []
    record.request_cancel(second.id)
    record.delete(second.id)
    remove_unreachable(record, store)
    assert not store.exists(shared.key)


def test_what_the_store_could_not_remove_stays_on_the_record(record: JobRecord, tmp_path: Path) -> None:
    store = ObjectStore(tmp_path)
    job = new_job(record)
    record.request_cancel(job.id)
    record.delete(job.id)

    def away(prefix: str) -> None:
        raise UnavailableError("away")

    store.delete_prefix = away  # type: ignore[method-assign]
    with pytest.raises(UnavailableError):
        remove_unreachable(record, store)
    assert record.discarded_prefixes() == [f"jobs/{job.id}/"]
