"""Remove what nobody can reach any more: objects of deleted jobs, files without a job, uploads over their time."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

from meshdeform.errors import NotFoundError
from meshdeform.record.repository import JobRecord
from meshdeform.storage import ObjectStore

__all__ = ["remove_job", "remove_unreachable", "remove_upload"]


def remove_unreachable(record: JobRecord, store: ObjectStore) -> None:
    """Bring the store in line with the record. Safe to interrupt, to repeat, and to run twice at once.

    Raises
    ------
    UnavailableError
        The record or the store does not answer; what is left to do stays on the record.
    """
    for prefix in record.upkeep.discarded_prefixes():
        _remove_prefix(record, store, prefix)
    for upload_id in record.upkeep.expired_uploads():
        remove_upload(store, upload_id)
        with suppress(NotFoundError):
            record.uploads.delete(upload_id)
    for key in record.files.unused():
        record.files.remove_unused(key, store.delete)


def remove_job(record: JobRecord, store: ObjectStore, job_id: str, files: Iterable[str]) -> None:
    """Remove what a deleted job leaves, and nothing else: how long that takes depends on no other job.

    Parameters
    ----------
    record : JobRecord
    store : ObjectStore
    job_id : str
    files : iterable of str
        What it used, as `JobRecord.delete` says; those that others use stay.

    Raises
    ------
    UnavailableError
        As of `remove_unreachable`, which finishes it.
    """
    _remove_prefix(record, store, f"jobs/{job_id}/")
    for key in files:
        record.files.remove_unused(key, store.delete)


def remove_upload(store: ObjectStore, upload_id: str) -> None:
    """Remove what has come of an upload; the file that it became is another thing."""
    if store.appends:
        store.discard_append(upload_id)
    store.delete_prefix(f"uploads/{upload_id}/")


def _remove_prefix(record: JobRecord, store: ObjectStore, prefix: str) -> None:
    store.delete_prefix(prefix)
    record.upkeep.forget_discarded(prefix)
