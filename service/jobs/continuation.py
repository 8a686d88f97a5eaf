"""Create jobs that start from a checkpoint of another job: retries, which continue its request, and branches."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from meshdeform.errors import (
    ConflictError,
    NotFoundError,
    ParameterError,
    StoredFileError,
)
from meshdeform.record.files import FileLeases
from meshdeform.record.models import CheckpointRef, Job, JobState, Origin, OriginMode, StoredFile
from meshdeform.requests.document import JobRequest
from meshdeform.requests.parameters import WORDS_FIELD
from meshdeform.runs import kind_of
from meshdeform.words import in_use
from service.http.idempotency import Caller, KeptAnswer, claimed, request_hash
from service.jobs.documents import BranchDocument, FileReference, FileSource, RetryDocument
from service.jobs.intake import (
    check,
    decoded,
    fetch,
    in_order,
    key_of,
    new_job,
    record_job,
    store_file,
)
from service.state import AppState
from service.words.known import named_words, pin_words, words_of_job

_RETRYABLE = (JobState.FAILED, JobState.CANCELED, JobState.EXPIRED)


def retry(app: AppState, caller: Caller, job_id: str, document: RetryDocument | None = None) -> KeptAnswer:
    """Create a new job from one that did not succeed; it continues from the last intact checkpoint."""
    changes = None if document is None else document.model_dump(mode="json", exclude_unset=True) or None
    with claimed(app.record, caller, request_hash(caller.method, caller.path, changes, {})) as claim:
        if isinstance(claim, KeptAnswer):
            return claim
        job = app.record.get(job_id, owner=caller.owner_id)
        if job.state not in _RETRYABLE:
            raise ConflictError(
                f"The job is {job.state}; only a failed, canceled or expired job can be retried.",
                state=job.state.value,
            )
        request = job.request if changes is None else job.request.model_copy(update=changes)
        if not job.files:
            raise ConflictError("The job has no files, because they were never fetched.", advice="Send the job again.")
        with in_use(words_of_job(app, job)):
            params = check(request, app.settings, files=job.files)
        app.record.check_room(caller.owner_id, {}, app.settings.max_stored_bytes)
        with app.record.files.leases() as leases:
            _lease(app, leases, job.files.values())
            checkpoints = app.record.leases.checkpoints(job_id)
            newest = sorted(checkpoints, key=lambda each: (each.step, each.attempt), reverse=True)
            origin = _copy_checkpoint(app, leases, job, newest, OriginMode.RETRY) or _initial_origin(app, leases, job)
            size = {"faces": job.faces, "meshes": job.meshes}
            new = new_job(app, caller, request, job.files, origin=origin, resolved=params, claim=claim, **size)
            return record_job(app, new, leases)


def branch(app: AppState, caller: Caller, job_id: str, step: int, document: BranchDocument, folder: Path) -> KeptAnswer:
    """Create a new job that starts with the shape of a checkpoint and follows another document.

    Where several attempts have a checkpoint of the step, the newest intact one is used. The files that the document
    names are fetched to the folder.
    """
    body = document.model_dump(mode="json", exclude_unset=True)
    with claimed(app.record, caller, request_hash(caller.method, caller.path, body, {})) as claim:
        if isinstance(claim, KeptAnswer):
            return claim
        job = app.record.get(job_id, owner=caller.owner_id)
        of = job.request
        if document.kind is not of.kind:
            detail = f"A branch has the kind of its job: {of.kind}."
            raise ParameterError.at(["kind"], detail, f'Set "kind": "{of.kind}".')
        references = document.references
        sent = words_of_job(app, job)
        with in_use(named_words(app, caller.owner_id, sent=sent)):
            request = kind_of(of.kind).as_branch(of, document)
        request, pinned, words = pin_words(app, caller.owner_id, request, folder, sent=sent)
        inherited = _inherited(job, request, references)
        with in_use(words):
            params = check(request, app.settings, files={*inherited, *references, *([WORDS_FIELD] if pinned else [])})
        with app.record.files.leases() as leases:
            files = dict(inherited)
            for name, reference in references.items():
                file = fetch(app, caller.owner_id, *reference, folder)
                decoded(app, caller.owner_id, kind_of(job.kind), name, file)
                app.record.check_room(caller.owner_id, {key_of(file): file.size}, app.settings.max_stored_bytes)
                files[name] = store_file(app, leases, file)
            if pinned is not None:
                files[WORDS_FIELD] = store_file(app, leases, pinned)
            _lease(app, leases, inherited.values())
            known = app.record.leases.checkpoints(job_id)
            origin = _copy_checkpoint(
                app, leases, job, [checkpoint for checkpoint in known if checkpoint.step == step], OriginMode.BRANCH
            )
            if origin is None:
                steps = sorted({checkpoint.step for checkpoint in known})
                raise NotFoundError(
                    f"The job has no checkpoint of step {step}.",
                    advice=f"It has: {', '.join(map(str, steps)) or 'none'}. Older ones are deleted.",
                    steps=steps,
                )
            files = in_order(request, files)
            size = {"faces": job.faces, "meshes": job.meshes}
            new = new_job(app, caller, request, files, origin=origin, resolved=params, claim=claim, **size)
            return record_job(app, new, leases)


def _inherited(
    job: Job, request: JobRequest, named: Mapping[str, tuple[FileReference | FileSource, list[str]]]
) -> dict[str, StoredFile]:
    """Return the files of the other job that a branch keeps."""
    # `ParameterError`: the request replaces a file to which the checkpoint belongs.
    kind = kind_of(job.kind)
    for field in kind.reads:
        if field.required and field.name in named:
            raise ParameterError.at(
                [field.name], f"A branch keeps its job's `{field.name}`.", "Post a new job for another file."
            )
    kept = kind.inherits(request) - set(named)
    return {name: file for name, file in job.files.items() if name in kept}


def _lease(app: AppState, leases: FileLeases, files: Iterable[StoredFile]) -> None:
    """Lease the other job's files, because that job may be deleted concurrently, and verify them."""
    for file in files:
        leases.take(file.key)
        if not app.store.exists(file.key):
            raise NotFoundError(f"The job's file {file.filename!r} is gone.", advice="Post it as a new job.")
        if not app.store.holds(file.key, file.sha256):
            raise StoredFileError(f"The stored copy of the job's file {file.filename!r} is damaged.")


def _copy_checkpoint(
    app: AppState, leases: FileLeases, job: Job, checkpoints: Iterable[CheckpointRef], mode: OriginMode
) -> Origin | None:
    """Copy the first intact checkpoint to a key that outlives its job, and return it as an origin, if there is one."""
    for checkpoint in checkpoints:
        key = f"assets/{checkpoint.sha256}"
        try:
            if app.store.sha256_of(checkpoint.key) != checkpoint.sha256:
                continue
            leases.take(key)
            if not app.store.holds(key, checkpoint.sha256):
                app.store.copy(checkpoint.key, key)
        except NotFoundError:
            # It was deleted meanwhile, when a newer one was stored.
            continue
        return Origin(
            job_id=job.id,
            step=checkpoint.step,
            mode=mode,
            key=key,
            sha256=checkpoint.sha256,
            size=checkpoint.size,
            made_by=checkpoint.made_by or "",
        )
    return None


def _initial_origin(app: AppState, leases: FileLeases, job: Job) -> Origin:
    """Return the origin of a job without checkpoints of its own: the checkpoint that it started from, or step 0."""
    if job.origin is not None and job.origin.key:
        leases.take(job.origin.key)
        if app.store.holds(job.origin.key, job.origin.sha256):
            return job.origin
    return Origin(job_id=job.id, step=0, mode=OriginMode.RETRY)
