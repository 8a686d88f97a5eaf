"""Make other strengths of a result, each once, and keep the latest of them beside the job's artifacts."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager
from pathlib import Path

from anyio import CapacityLimiter, to_thread

from meshdeform.assets import Limits
from meshdeform.errors import NotFoundError, ParameterError
from meshdeform.record.models import Artifact, Job
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import DeformParams
from meshdeform.runs import kind_of
from meshdeform.runs.derive import STRENGTH, DerivedInput, derive
from meshdeform.storage import ObjectStore, StoredObject
from meshdeform.support.recent import Recent
from service.http.limits import FairSlots
from service.workspace import Workspace

MAX_STRENGTH, STRENGTH_STEP = 1.5, 0.01
_AT_ONCE, _PER_OWNER, _WAIT_S = 2, 1, 120.0
_KEPT_PER_JOB = 16
_REMEMBERED = 512


class Strengths:
    """The strengths that this process has made or found in the store."""

    def __init__(self, record: JobRecord, store: ObjectStore, workspace: Workspace, limits: Limits) -> None:
        self._record, self._store, self._workspace, self._limits = record, store, workspace, limits
        self._slots = FairSlots(_AT_ONCE, _PER_OWNER, wait_s=_WAIT_S, purpose="strengths or maps are being applied")
        self._threads: CapacityLimiter | None = None
        self._known = Recent[StoredObject](_REMEMBERED)

    async def get(self, job: Job, artifact: Artifact, strength: float) -> tuple[str, StoredObject]:
        """Return the key, size and SHA-256 of an artifact at another strength, after making it if necessary."""
        kinds = {kind.name: kind for kind in kind_of(job.request.kind).artifacts}
        if artifact.name not in kinds or not kinds[artifact.name].strengths:
            having = [name for name, kind in kinds.items() if kind.strengths]
            detail = f"{artifact.name} has only one strength."
            advice = f"Ask for another strength of {', '.join(having)}." if having else "Omit the strength."
            raise ParameterError.at(["query", "strength"], detail, advice)
        self._threads = self._threads or CapacityLimiter(_AT_ONCE)
        key = f"{_prefix(job)}{artifact.sha256[:16]}-{round(100 * strength):03d}.glb"
        if (known := await to_thread.run_sync(self._find, key)) is not None:
            return key, known
        async with self.slot(job.owner_id):
            stored = await to_thread.run_sync(self._make, job, artifact, strength, key, limiter=self._threads)
        return key, stored

    def slot(self, owner_id: str) -> AbstractAsyncContextManager[None]:
        """Return a context that holds a slot for making a file of a result."""
        return self._slots.slot(owner_id)

    def _find(self, key: str) -> StoredObject | None:
        """Return the size and SHA-256 of a stored object; None if there is none."""
        known = self._known.get(key)
        if known is not None and self._store.exists(key):
            return known
        try:
            stored = self._store.measure(key)
        except NotFoundError:
            return None
        self._known.put(key, stored)
        return stored

    def _make(self, job: Job, artifact: Artifact, strength: float, key: str) -> StoredObject:
        if (known := self._find(key)) is not None:  # another request has made it meanwhile
            return known
        with self._workspace.temporary_folder() as folder:
            source, result, output = (folder / name for name in ("source", "result", "output"))
            deformed = job.source
            self._store.fetch(deformed.key, source, sha256=deformed.sha256)
            self._store.fetch(artifact.key, result, sha256=artifact.sha256)
            params = job.request.params
            exclude = params.control.exclude if isinstance(params, DeformParams) else ()
            derived = DerivedInput(source, result, deformed.filename, job.request.output, exclude, strength)
            derive(STRENGTH, derived, output, self._limits)
            stored = self._keep(job, artifact, output, key)
        self._known.put(key, stored)
        return stored

    def _keep(self, job: Job, artifact: Artifact, file: Path, key: str) -> StoredObject:
        others = [other for other, _ in self._store.list(_prefix(job)) if other != key]
        for other in others[: max(0, len(others) + 1 - _KEPT_PER_JOB)]:
            self._store.delete(other)
        stored = self._store.put_verified(key, file, artifact.content_type)
        try:
            self._record.get(job.id)
        except NotFoundError:  # deleted meanwhile, with its other objects
            self._store.delete(key)
            raise
        return stored


def _prefix(job: Job) -> str:
    """Return where a job's strengths are stored: deleting the job removes them with its other objects."""
    return f"jobs/{job.id}/strengths/"
