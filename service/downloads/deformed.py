"""Find the file that a job deforms: its asset, or the mesh that was fitted to an asset without triangles."""

from __future__ import annotations

from meshdeform.record.models import Job, StoredFile
from meshdeform.runs.base import FITTED_SOURCE

__all__ = ["deformed_file"]


def deformed_file(job: Job) -> StoredFile:
    """Return the file from which the job's result was made."""
    for artifact in job.artifacts:
        if artifact.name == FITTED_SOURCE.name:
            return StoredFile(key=artifact.key, filename=artifact.name, size=artifact.size, sha256=artifact.sha256)
    return job.source
