"""Jobs that go on from a checkpoint of another one: retries, which go on as if never interrupted, and branches."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from meshdeform.assets import Limits, check_asset_subprocess
from meshdeform.errors import ConflictError, NotFoundError
from meshdeform.record.models import CheckpointRef, Job, JobState, Origin, OriginMode, StoredFile
from meshdeform.requests.document import GuidanceKind
from service.http.caller import Caller
from service.http.idempotency import Answer, Keep, done_once, request_hash
from service.jobs.documents import BranchDocument
from service.jobs.file_leases import Pins
from service.jobs.intake import check_params, keep_file, record_job
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

    def work(keep: Keep) -> Answer:
        job = parts.record.get(job_id, owner=caller.owner_id)
        if job.state not in _AGAIN:
            raise ConflictError(
                f"The job is {job.state}; only one that failed, was canceled or has expired can be tried again.",
                state=job.state.value,
            )
        check_params(job.request, parts.settings, has_target=job.target is not None)
        with Pins(parts.record.files) as pins:
            _hold(parts, pins, job.asset, job.target)
            found = parts.record.leases.checkpoints(job_id)
            newest = sorted(found, key=lambda each: (each.step, each.attempt), reverse=True)
            origin = _copied(parts, pins, job, newest, OriginMode.RETRY) or _beginning(parts, pins, job)
            return record_job(parts, caller, pins, job.request, job.asset, job.target, origin=origin, keep=keep)

    return done_once(parts.record, caller, request_hash(caller.method, caller.path, None, {}), work)


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

    def work(keep: Keep) -> Answer:
        request = document.request()
        job = parts.record.get(job_id, owner=caller.owner_id)
        # The other job's target goes along only where it is looked at.
        inherited = job.target if request.params.guidance is GuidanceKind.TARGET else None
        check_params(request, parts.settings, has_target=(document.target or inherited) is not None)
        with Pins(parts.record.files) as pins:
            target = inherited
            if document.target is not None:
                file = fetch(parts, caller.owner_id, document.target, "target", folder)
                limits = Limits.from_settings(parts.settings)
                check_asset_subprocess(file.path, file.filename, limits)
                target = keep_file(parts, pins, file)
            _hold(parts, pins, job.asset, target)
            known = parts.record.leases.checkpoints(job_id)
            origin = _copied(parts, pins, job, [found for found in known if found.step == step], OriginMode.BRANCH)
            if origin is None:
                steps = sorted({found.step for found in known})
                raise NotFoundError(
                    f"The job has no checkpoint of step {step}.",
                    advice=f"It has: {', '.join(map(str, steps)) or 'none'}. Older ones give way to newer ones.",
                    steps=steps,
                )
            return record_job(parts, caller, pins, request, job.asset, target, origin=origin, keep=keep)

    asked = document.model_dump(mode="json", exclude_unset=True)
    return done_once(parts.record, caller, request_hash(caller.method, caller.path, asked, {}), work)


def _hold(parts: Parts, pins: Pins, *files: StoredFile | None) -> None:
    """Pin what the other job was made of: it may be deleted at this moment."""
    for file in files:
        if file is not None:
            pins.take(file.key)
            if not parts.store.exists(file.key):
                raise NotFoundError(f"The job's file {file.filename!r} is gone.", advice="Post it as a new job.")


def _copied(
    parts: Parts, pins: Pins, job: Job, checkpoints: Iterable[CheckpointRef], mode: OriginMode
) -> Origin | None:
    """Copy the first checkpoint that is whole to where it outlives its job."""
    for found in checkpoints:
        key = f"assets/{found.sha256}"
        try:
            if parts.store.sha256_of(found.key) != found.sha256:
                continue
            pins.take(key)
            if not parts.store.exists(key):
                parts.store.copy(found.key, key)
        except NotFoundError:
            # It gave way to a newer one while we looked.
            continue
        return Origin(job_id=job.id, step=found.step, mode=mode, key=key, sha256=found.sha256)
    return None


def _beginning(parts: Parts, pins: Pins, job: Job) -> Origin:
    """Where a job began that has no checkpoint of its own."""
    if job.origin is not None and job.origin.key:
        pins.take(job.origin.key)
        if parts.store.exists(job.origin.key):
            return job.origin
    return Origin(job_id=job.id, step=0, mode=OriginMode.RETRY)
