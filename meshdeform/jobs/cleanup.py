"""Remove what nobody can reach any more: objects of deleted jobs, files without a job, uploads over their time."""

from __future__ import annotations

from contextlib import suppress

from meshdeform.errors import NotFoundError
from meshdeform.jobs.record import JobRecord
from meshdeform.storage import ObjectStore

__all__ = ["remove_unreachable", "remove_upload"]


def remove_unreachable(record: JobRecord, store: ObjectStore) -> None:
    """Bring the store in line with the record. Safe to interrupt, to repeat, and to run twice at once.

    Raises
    ------
    UnavailableError
        The record or the store does not answer; what is left to do stays on the record.
    """
    for prefix in record.discarded_prefixes():
        store.delete_prefix(prefix)
        record.forget_discarded(prefix)
    for upload_id in record.expired_uploads():
        remove_upload(store, upload_id)
        with suppress(NotFoundError):
            record.uploads.delete(upload_id)
    for key in record.files.unused():
        record.files.remove_unused(key, store.delete)


def remove_upload(store: ObjectStore, upload_id: str) -> None:
    """Remove what has come of an upload; the file that it became is another thing."""
    if store.appends:
        store.discard_append(upload_id)
    store.delete_prefix(f"uploads/{upload_id}/")
