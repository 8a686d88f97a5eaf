"""Jobs that go on from a checkpoint of another one: retries, which go on as if never interrupted, and branches."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from meshdeform.errors import ConflictError, NotFoundError
from meshdeform.record.files import FileLeases
from meshdeform.record.models import CheckpointRef, Job, JobState, Origin, OriginMode, StoredFile
from meshdeform.requests.document import GuidanceKind
from service.http.caller import Caller
from service.http.idempotency import Answer, claimed, request_hash
from service.jobs.documents import BranchDocument
from service.jobs.intake import check_params, keep_file, new_job, record_job
from service.jobs.sources import fetch
from service.state import Parts

__all__ = ["branch", "retry"]

_AGAIN = (JobState.FAILED, JobState.CANCELED, JobState.EXPIRED)


def retry(parts: Parts, caller: Caller, job_id: str) -> Answer:
    """Make a new job of one that did not succeed; it goes on from the last checkpoint that is whole.

    Raises
    ------
    NotFoundError, ConflictError
        There is no such job, or it is not over, or it has succeeded.
    RequestError, ModelError
        The deployment would not accept it any more.
    """
    with claimed(parts.record, caller, request_hash(caller.method, caller.path, None, {})) as claim:
        if isinstance(claim, Answer):
            return claim
        job = parts.record.get(job_id, owner=caller.owner_id)
        if job.state not in _AGAIN:
            raise ConflictError(
                f"The job is {job.state}; only one that failed, was canceled or has expired can be tried again.",
                state=job.state.value,
            )
        params = check_params(job.request, parts.settings, has_target=job.target is not None)
        with parts.record.files.leases() as leases:
            _hold(parts, leases, job.asset, job.target)
            newest = sorted(parts.record.checkpoints(job_id), key=lambda found: (found.step, found.attempt))[::-1]
            origin = _copied(parts, leases, job, newest, OriginMode.RETRY) or _beginning(parts, leases, job)
            new = new_job(
                parts, caller, job.request, job.asset, job.target, origin=origin, resolved=params, claim=claim
            )
            return record_job(parts, new, leases)


def branch(parts: Parts, caller: Caller, job_id: str, step: int, document: BranchDocument, folder: Path) -> Answer:
    """Make a new job that begins with the shape of a checkpoint and then does what the document says.

    Parameters
    ----------
    parts : Parts
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
    with claimed(parts.record, caller, request_hash(caller.method, caller.path, asked, {})) as claim:
        if isinstance(claim, Answer):
            return claim
        job = parts.record.get(job_id, owner=caller.owner_id)
        # The other job's target goes along only where it is looked at.
        target = job.target if document.params.guidance is GuidanceKind.TARGET else None
        has_target = (document.target or target) is not None
        params = check_params(document, parts.settings, has_target=has_target)
        with parts.record.files.leases() as leases:
            if document.target is not None:
                file = fetch(parts, caller.owner_id, document.target, "target", folder)
                parts.assets.check(file.path, file.filename, file.sha256)
                target = keep_file(parts, leases, file)
            _hold(parts, leases, job.asset, target)
            known = parts.record.checkpoints(job_id)
            origin = _copied(parts, leases, job, [found for found in known if found.step == step], OriginMode.BRANCH)
            if origin is None:
                steps = sorted({found.step for found in known})
                raise NotFoundError(
                    f"The job has no checkpoint of step {step}.",
                    advice=f"It has: {', '.join(map(str, steps)) or 'none'}. Older ones give way to newer ones.",
                    steps=steps,
                )
            new = new_job(parts, caller, document, job.asset, target, origin=origin, resolved=params, claim=claim)
            return record_job(parts, new, leases)


def _hold(parts: Parts, leases: FileLeases, *files: StoredFile | None) -> None:
    """Pin what the other job was made of: it may be deleted at this moment."""
    for file in files:
        if file is not None:
            leases.take(file.key)
            if not parts.store.exists(file.key):
                raise NotFoundError(f"The job's file {file.filename!r} is gone.", advice="Post it as a new job.")


def _copied(
    parts: Parts, leases: FileLeases, job: Job, checkpoints: Iterable[CheckpointRef], mode: OriginMode
) -> Origin | None:
    """Copy the first checkpoint that is whole to where it outlives its job."""
    for found in checkpoints:
        key = f"assets/{found.sha256}"
        try:
            if parts.store.sha256_of(found.key) != found.sha256:
                continue
            leases.take(key)
            if not parts.store.exists(key):
                parts.store.copy(found.key, key)
        except NotFoundError:
            # It gave way to a newer one while we looked.
            continue
        return Origin(job_id=job.id, step=found.step, mode=mode, key=key, sha256=found.sha256)
    return None


def _beginning(parts: Parts, leases: FileLeases, job: Job) -> Origin:
    """Where a job began that has no checkpoint of its own."""
    if job.origin is not None and job.origin.key:
        leases.take(job.origin.key)
        if parts.store.exists(job.origin.key):
            return job.origin
    return Origin(job_id=job.id, step=0, mode=OriginMode.RETRY)
