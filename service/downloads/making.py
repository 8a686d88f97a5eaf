"""Make artifacts of a finished job that its request did not ask for, outside this process."""

from __future__ import annotations

import contextlib
import secrets
from pathlib import Path

from meshdeform.assets.limits import Limits
from meshdeform.errors import MeshdeformError, NotFoundError
from meshdeform.record.models import Artifact, Job
from meshdeform.runs import kind_of
from meshdeform.runs.base import RESULT, ArtifactKind
from meshdeform.runs.derive import ALIKE, DERIVED, OF_RESULT, DerivedInput, derive
from service.state import AppState

_MAP = "map.safetensors"


def makeable(job: Job) -> list[str]:
    """Return the names of the artifacts that can be made of a job that has succeeded."""
    if job.unreadable or all(artifact.name != RESULT for artifact in job.artifacts):
        return []
    return [kind.name for kind in kind_of(job.kind).artifacts if kind.afterwards and kind.name in DERIVED]


def made(app: AppState, job: Job, name: str) -> Artifact:
    """Make an artifact, one of `makeable`, of a job that has succeeded, and add it to the job.

    If another request has added it meanwhile, that one is returned.
    """
    kind = next(kind for kind in kind_of(job.kind).artifacts if kind.name == name)
    result = next(artifact for artifact in job.artifacts if artifact.name == RESULT)
    with app.workspace.temporary_folder() as folder:
        source, shape, target = folder / "source", folder / "result", folder / "target"
        app.store.fetch(result.key, shape, sha256=result.sha256)
        output = job.request.output
        if name in OF_RESULT:
            derived = DerivedInput(shape, shape, job.source.filename, output)
        else:
            deformed = job.source
            app.store.fetch(deformed.key, source, sha256=deformed.sha256)
            derived = DerivedInput(source, shape, deformed.filename, output, job.request.params.control.exclude)
        told = derive(name, derived, target, Limits.from_settings(app.settings))
        app.record.check_room(job.owner_id, {name: target.stat().st_size}, app.settings.max_stored_bytes)
        return _added(app, job, kind, target, told)


def deformed_alike(app: AppState, job: Job, file: Path, filename: str, outside: str) -> Path:
    """Deform another file as the asset of a job was, and return the GLB, in the folder of the file."""
    edit = next((artifact for artifact in job.artifacts if artifact.name == _MAP), None)
    if edit is None:
        if _MAP not in makeable(job):
            raise NotFoundError("The job deformed no asset.", advice="Name a job of the kind text_deform.")
        edit = made(app, job, _MAP)
    local, target = file.with_name("map"), file.with_name("alike.glb")
    app.store.fetch(edit.key, local, sha256=edit.sha256)
    derived = DerivedInput(file, local, filename, job.request.output, outside=outside)
    derive(ALIKE, derived, target, Limits.from_settings(app.settings))
    return target


def _added(app: AppState, job: Job, kind: ArtifactKind, file: Path, told: list[str]) -> Artifact:
    """Store a file and record it as an artifact; remove it if the job has one of that name, or is gone.

    `told`: what its format cannot hold.
    """
    key = f"jobs/{job.id}/made/{secrets.token_hex(8)}-{kind.name}"  # removed with the job
    stored = app.store.put_verified(key, file, kind.media_type)
    described = {"content_type": kind.media_type, "size": stored.size, "sha256": stored.sha256}
    new = Artifact(name=kind.name, key=key, warnings=told or None, **described)
    recorded = None
    try:
        recorded = app.record.add_artifact(job.id, new, job.owner_id)
    finally:
        if recorded != new:
            with contextlib.suppress(MeshdeformError):
                app.store.delete(key)
    return recorded
