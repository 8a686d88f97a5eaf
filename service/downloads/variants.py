"""Make other strengths and poses of a result, each once, and keep the latest of them beside the job's artifacts."""

from __future__ import annotations

import hashlib
import json
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from pathlib import Path

from anyio import CapacityLimiter, to_thread

from meshdeform.assets import Limits
from meshdeform.errors import NotFoundError, ParameterError
from meshdeform.record.models import Artifact, Job
from meshdeform.record.repository import JobRecord
from meshdeform.requests.document import DeformParams
from meshdeform.runs import kind_of
from meshdeform.runs.base import RESULT
from meshdeform.runs.derive import OF_RESULT, POSED, STRENGTH, DerivedInput, derive
from meshdeform.storage import ObjectStore, StoredObject
from meshdeform.support.recent import Recent
from service.http.limits import FairSlots
from service.workspace import Workspace

MAX_STRENGTH, STRENGTH_STEP = 1.5, 0.01
_AT_ONCE, _PER_OWNER, _WAIT_S = 2, 1, 120.0
_KEPT_PER_JOB = 16
_REMEMBERED = 512


@dataclass(frozen=True)
class Variant:
    """What is asked for of an artifact: another strength, or a pose, `CLIP@SECONDS`."""

    name: str
    strength: float | None = None
    pose: str | None = None

    @property
    def tag(self) -> str:
        """A short name of the variant, for keys and file names."""
        if self.strength is not None:
            return f"strength{round(100 * self.strength)}"
        return f"pose-{hashlib.sha256(str(self.pose).encode()).hexdigest()[:12]}"


@dataclass(frozen=True)
class Made:
    """A variant in the store; `warnings`: sentences about what its format cannot hold."""

    key: str
    stored: StoredObject
    warnings: list[str]


class Variants:
    """The variants that this process has made or found in the store."""

    def __init__(self, record: JobRecord, store: ObjectStore, workspace: Workspace, limits: Limits) -> None:
        self._record, self._store, self._workspace, self._limits = record, store, workspace, limits
        self._slots = FairSlots(_AT_ONCE, _PER_OWNER, wait_s=_WAIT_S, purpose="files of results are being made")
        self._threads: CapacityLimiter | None = None
        self._known = Recent[Made](_REMEMBERED)

    async def get(self, job: Job, artifact: Artifact, variant: Variant) -> Made:
        """Return a variant of a result, after making it if necessary; `artifact`: the one that it is made of."""
        _check(job, variant)
        self._threads = self._threads or CapacityLimiter(_AT_ONCE)
        key = f"{_prefix(job)}{artifact.sha256[:16]}-{variant.tag}/{variant.name}"
        if (known := await to_thread.run_sync(self._find, key)) is not None:
            return known
        async with self.slot(job.owner_id):
            return await to_thread.run_sync(self._make, job, artifact, variant, key, limiter=self._threads)

    def slot(self, owner_id: str) -> AbstractAsyncContextManager[None]:
        """Return a context that holds a slot for making a file of a result."""
        return self._slots.slot(owner_id)

    def _find(self, key: str) -> Made | None:
        """Return a stored variant; None if there is none."""
        known = self._known.get(key)
        if known is not None and self._store.exists(key):
            return known
        try:
            stored = self._store.measure(key)
        except NotFoundError:
            return None
        told = json.loads(self._store.get(_beside(key))) if self._store.exists(_beside(key)) else []
        self._known.put(key, found := Made(key, stored, told))
        return found

    def _make(self, job: Job, artifact: Artifact, variant: Variant, key: str) -> Made:
        if (known := self._find(key)) is not None:  # another request has made it meanwhile
            return known
        with self._workspace.temporary_folder() as folder:
            source, result, output = (folder / name for name in ("source", "result", "output"))
            self._store.fetch(artifact.key, result, sha256=artifact.sha256)
            if variant.strength is not None:
                self._store.fetch(job.source.key, source, sha256=job.source.sha256)
            params = job.request.params
            derived = DerivedInput(
                result if variant.strength is None else source,
                result,
                job.source.filename,
                job.request.output,
                params.control.exclude if isinstance(params, DeformParams) else (),
                1.0 if variant.strength is None else variant.strength,
                pose=variant.pose,
            )
            other = POSED if variant.name == RESULT else variant.name
            told = derive(STRENGTH if variant.strength is not None else other, derived, output, self._limits)
            made = self._keep(job, output, key, told)
        self._known.put(key, made)
        return made

    def _keep(self, job: Job, file: Path, key: str, told: list[str]) -> Made:
        folders = dict.fromkeys(other.rpartition("/")[0] for other, _ in self._store.list(_prefix(job)))
        others = [folder for folder in folders if folder != key.rpartition("/")[0]]
        for folder in others[: max(0, len(others) + 1 - _KEPT_PER_JOB)]:
            self._store.delete_prefix(f"{folder}/")
        if told:
            self._store.put(_beside(key), json.dumps(told).encode(), "application/json")
        made = Made(key, self._store.put_verified(key, file), told)
        try:
            self._record.get(job.id)
        except NotFoundError:  # deleted meanwhile, with its other objects
            self._store.delete_prefix(_prefix(job))
            raise
        return made


def _beside(key: str) -> str:
    """Return where the sentences about a variant are stored, if there are any."""
    return f"{key}.told"


def _check(job: Job, variant: Variant) -> None:
    """Refuse a variant that an artifact does not have."""
    if variant.pose is not None:
        having = [RESULT, *sorted(OF_RESULT)]
        if variant.name not in having:
            advice = f"Ask for {', '.join(having)} in a pose."
            raise ParameterError.at(["query", "pose"], f"{variant.name} has no poses.", advice)
        return
    kinds = {kind.name: kind for kind in kind_of(job.request.kind).artifacts}
    if variant.name not in kinds or not kinds[variant.name].strengths:
        having = [name for name, kind in kinds.items() if kind.strengths]
        detail = f"{variant.name} has only one strength."
        advice = f"Ask for another strength of {', '.join(having)}." if having else "Omit the strength."
        raise ParameterError.at(["query", "strength"], detail, advice)


def _prefix(job: Job) -> str:
    """Return where a job's variants are stored: deleting the job removes them with its other objects."""
    return f"jobs/{job.id}/variants/"
