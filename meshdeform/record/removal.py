"""Remove from the object store what the record no longer refers to."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

from meshdeform.errors import NotFoundError
from meshdeform.record.repository import JobRecord
from meshdeform.storage import ObjectStore

__all__ = ["remove_job", "remove_unreachable", "remove_upload"]


def remove_unreachable(record: JobRecord, store: ObjectStore) -> None:
    """Remove from the store what the record no longer refers to. Safe to interrupt, repeat, and run concurrently.

    If the record or the store does not answer (`UnavailableError`), the remaining work stays recorded.
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
    """Remove the objects of one deleted job, and nothing else, so that the duration depends on no other job.

    `files` are the keys that `JobRecord.delete` returned; files in use elsewhere stay. If the record or the store does
    not answer (`UnavailableError`), `remove_unreachable` does the rest.
    """
    _remove_prefix(record, store, f"jobs/{job_id}/")
    for key in files:
        record.files.remove_unused(key, store.delete)


def remove_upload(store: ObjectStore, upload_id: str) -> None:
    """Remove the received bytes of an upload; the file stored from a complete upload is not affected."""
    if store.appends:
        store.discard_append(upload_id)
    store.delete_prefix(f"uploads/{upload_id}/")


def _remove_prefix(record: JobRecord, store: ObjectStore, prefix: str) -> None:
    store.delete_prefix(prefix)
    record.upkeep.forget_discarded(prefix)
