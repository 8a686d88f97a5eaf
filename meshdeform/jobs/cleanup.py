"""Remove what nobody can reach any more: the objects of deleted jobs, and uploaded files without a job."""

from __future__ import annotations

from meshdeform.jobs.record import JobRecord
from meshdeform.storage import ObjectStore

__all__ = ["remove_unreachable"]


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
    for key in record.files.unused():
        record.files.remove_unused(key, store.delete)
