"""Find the file that a job deforms."""

from __future__ import annotations

from meshdeform.record.models import Job, StoredFile

__all__ = ["deformed_file"]

_FITTED = "source.glb"
"""The mesh that earlier editions fitted to an asset without triangles."""


def deformed_file(job: Job) -> StoredFile:
    """Return the file from which the job's result was made."""
    for artifact in job.artifacts:
        if artifact.name == _FITTED:
            return StoredFile(key=artifact.key, filename=artifact.name, size=artifact.size, sha256=artifact.sha256)
    return job.source
