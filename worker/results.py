"""The results of an attempt in the object store: uploaded and read back; nothing points at them until all are there."""

from __future__ import annotations

import datetime as dt

from meshdeform.record.models import Artifact, Job
from meshdeform.runs.base import ArtifactData
from meshdeform.storage import ObjectStore
from meshdeform.support.failpoints import failpoint
from worker.retry import Patience

__all__ = ["store_artifact", "store_results"]


def store_artifact(store: ObjectStore, job: Job, name: str, artifact: ArtifactData) -> Artifact:
    """Store one artifact under the job's attempt, so that no two attempts write the same object.

    Raises
    ------
    UnavailableError
        The store does not answer, or gives back something else than was written.
    """
    key = f"jobs/{job.id}/{job.attempt}/{name}"
    stored = store.put_verified(key, artifact.data, artifact.content_type)
    return Artifact(
        name=name,
        content_type=artifact.content_type,
        size=stored.size,
        sha256=stored.sha256,
        key=key,
        created_at=dt.datetime.now(dt.UTC),
    )


def store_results(
    store: ObjectStore, job: Job, artifacts: dict[str, ArtifactData], patience: Patience
) -> list[Artifact]:
    """Store all results of a job.

    Raises
    ------
    UnavailableError
        The store has not answered for as long as `patience` lasts.
    """
    results = []
    for name, artifact in artifacts.items():
        results.append(
            patience.insist(
                f"job {job.id}: {name}",
                lambda n=name, a=artifact: store_artifact(store, job, n, a),  # type: ignore[misc]
            )
        )
        failpoint("worker.result.stored")
    return results
