"""Describe the taught weights that an owner's jobs have made."""

from __future__ import annotations

import dataclasses
import os

from meshdeform.errors import NotFoundError
from meshdeform.priors.catalogue import ModelInfo, describe_taught
from meshdeform.record.models import Artifact, JobState
from meshdeform.record.repository import JobRecord
from meshdeform.requests.choices import JobKind, model_of_job
from meshdeform.runs.base import WEIGHTS_ARTIFACT
from meshdeform.storage import ObjectStore
from meshdeform.support.recent import Recent
from service.workspace import Workspace

_LISTED = 100
_REMEMBERED = 512


class TaughtModels:
    """List the results of an owner's jobs of kind `prior_teach`.

    Descriptions are remembered by owner and hash: if owners shared them, the time of an answer would reveal whether
    another owner has the same weights.
    """

    def __init__(self, record: JobRecord, store: ObjectStore, workspace: Workspace) -> None:
        self._record, self._store, self._workspace = record, store, workspace
        self._known = Recent[ModelInfo](_REMEMBERED)

    def of(self, owner_id: str) -> list[ModelInfo]:
        """Return the newest models that this owner's jobs have made, newest first, at most 100."""
        page = self._record.list_jobs(JobState.SUCCEEDED, limit=_LISTED, owner=owner_id, kind=JobKind.PRIOR_TEACH)
        models = []
        for job in page.jobs:
            weights = next((artifact for artifact in job.artifacts if artifact.name == WEIGHTS_ARTIFACT), None)
            if weights is None:
                continue
            try:
                described = self._described(owner_id, weights)
            except NotFoundError:
                continue  # the job was deleted meanwhile
            models.append(dataclasses.replace(described, id=model_of_job(job.id)))
        return models

    def _described(self, owner_id: str, weights: Artifact) -> ModelInfo:
        known = (owner_id, weights.sha256)
        if (found := self._known.get(known)) is not None:
            return found
        with self._workspace.temporary_folder() as folder:
            path = folder / WEIGHTS_ARTIFACT
            path.write_bytes(self._header(weights))
            os.truncate(path, weights.size)  # the tensors, which nothing here reads
            described = describe_taught(str(path), WEIGHTS_ARTIFACT)
        nouns = [lesson.noun for lesson in described.lessons]
        described = dataclasses.replace(described, title=nouns[-1] if nouns else described.title)
        self._known.put(known, described)
        return described

    def _header(self, weights: Artifact) -> bytes:
        """Read the header of safetensors, and no more."""
        length = b"".join(self._store.stream(weights.key, 0, 8))
        end = min(8 + int.from_bytes(length, "little"), weights.size)
        return length + b"".join(self._store.stream(weights.key, 8, end))
