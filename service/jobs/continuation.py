"""Jobs that go on from a checkpoint of another one: retries, which go on as if never interrupted, and branches."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from meshdeform.errors import ConflictError, NotFoundError
from meshdeform.record.files import FileLeases
from meshdeform.record.models import CheckpointRef, Job, JobState, Origin, OriginMode, StoredFile
from meshdeform.requests.document import GuidanceKind
from service.http.idempotency import Answer, Caller, claimed, request_hash
from service.jobs.documents import BranchDocument
from service.jobs.intake import check_params, keep_file, new_job, record_job
from service.jobs.sources import fetch
from service.state import AppState

__all__ = ["branch", "retry"]

_AGAIN = (JobState.FAILED, JobState.CANCELED, JobState.EXPIRED)


def retry(app: AppState, caller: Caller, job_id: str) -> Answer:
    """Make a new job of one that did not succeed; it goes on from the last checkpoint that is whole.

    Raises
    ------
    NotFoundError, ConflictError
        There is no such job, or it is not over, or it has succeeded.
    RequestError, ModelError
        The deployment would not accept it any more.
    """
    with claimed(app.record, caller, request_hash(caller.method, caller.path, None, {})) as claim:
        if isinstance(claim, Answer):
            return claim
        job = app.record.get(job_id, owner=caller.owner_id)
        if job.state not in _AGAIN:
            raise ConflictError(
                f"The job is {job.state}; only one that failed, was canceled or has expired can be tried again.",
                state=job.state.value,
            )
        params = check_params(job.request, app.settings, files=_files(job.target))
        with app.record.files.leases() as leases:
            _hold(app, leases, job.asset, job.target)
            found = app.record.leases.checkpoints(job_id)
            newest = sorted(found, key=lambda each: (each.step, each.attempt), reverse=True)
            origin = _copied(app, leases, job, newest, OriginMode.RETRY) or _beginning(app, leases, job)
            new = new_job(app, caller, job.request, job.asset, job.target, origin=origin, resolved=params, claim=claim)
            return record_job(app, new, leases)


def branch(app: AppState, caller: Caller, job_id: str, step: int, document: BranchDocument, folder: Path) -> Answer:
    """Make a new job that begins with the shape of a checkpoint and then does what the document says.

    Parameters
    ----------
    app : AppState
    caller : Caller
    job_id : str
    step : int
        Of the checkpoint; of the newest attempt that has one there which is whole.
    document : BranchDocument
    folder : Path
        Where a target goes that the document names.

    Raises
    ------
    NotFoundError
        There is no such job, or it has no such checkpoint.
    AssetError, RequestError, ModelError
        What is wrong with the request, or with the target that it names.
    """
    asked = document.model_dump(mode="json", exclude_unset=True)
    with claimed(app.record, caller, request_hash(caller.method, caller.path, asked, {})) as claim:
        if isinstance(claim, Answer):
            return claim
        job = app.record.get(job_id, owner=caller.owner_id)
        # The other job's target goes along only where it is looked at.
        target = job.target if document.params.guidance is GuidanceKind.TARGET else None
        params = check_params(document, app.settings, files=_files(document.target or target))
        with app.record.files.leases() as leases:
            if document.target is not None:
                file = fetch(app, caller.owner_id, document.target, "target", folder)
                app.assets.check(file.path, file.filename, file.sha256)
                target = keep_file(app, leases, file)
            _hold(app, leases, job.asset, target)
            known = app.record.leases.checkpoints(job_id)
            origin = _copied(app, leases, job, [found for found in known if found.step == step], OriginMode.BRANCH)
            if origin is None:
                steps = sorted({found.step for found in known})
                raise NotFoundError(
                    f"The job has no checkpoint of step {step}.",
                    advice=f"It has: {', '.join(map(str, steps)) or 'none'}. Older ones give way to newer ones.",
                    steps=steps,
                )
            new = new_job(app, caller, document, job.asset, target, origin=origin, resolved=params, claim=claim)
            return record_job(app, new, leases)


def _files(target: object) -> list[str]:
    """Return the names of the files of a job with this target or none; an asset it always has."""
    return ["asset"] if target is None else ["asset", "target"]


def _hold(app: AppState, leases: FileLeases, *files: StoredFile | None) -> None:
    """Pin what the other job was made of: it may be deleted at this moment."""
    for file in files:
        if file is not None:
            leases.take(file.key)
            if not app.store.exists(file.key):
                raise NotFoundError(f"The job's file {file.filename!r} is gone.", advice="Post it as a new job.")


def _copied(
    app: AppState, leases: FileLeases, job: Job, checkpoints: Iterable[CheckpointRef], mode: OriginMode
) -> Origin | None:
    """Copy the first checkpoint that is whole to where it outlives its job."""
    for found in checkpoints:
        key = f"assets/{found.sha256}"
        try:
            if app.store.sha256_of(found.key) != found.sha256:
                continue
            leases.take(key)
            if not app.store.exists(key):
                app.store.copy(found.key, key)
        except NotFoundError:
            # It gave way to a newer one while we looked.
            continue
        return Origin(job_id=job.id, step=found.step, mode=mode, key=key, sha256=found.sha256)
    return None


def _beginning(app: AppState, leases: FileLeases, job: Job) -> Origin:
    """Where a job began that has no checkpoint of its own."""
    if job.origin is not None and job.origin.key:
        leases.take(job.origin.key)
        if app.store.exists(job.origin.key):
            return job.origin
    return Origin(job_id=job.id, step=0, mode=OriginMode.RETRY)
