"""Accept a job: check everything, store the files, record the job, and notify the workers, in this order.

`validate`, `orient` and `list_parts` check a job in the same way, and create none.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anyio import to_thread

from meshdeform.api.documents import AssetFound, FoundOrientation, FoundParts, PictureFound, Validation
from meshdeform.api.jobs import accepted
from meshdeform.assets import AssetSummary
from meshdeform.assets.inspect import PictureSummary
from meshdeform.errors import DrawingError, ParameterError, SilhouetteError, UnavailableError
from meshdeform.priors import public_names
from meshdeform.priors.builtin import taught
from meshdeform.record.files import FileLeases
from meshdeform.record.models import NewJob, StoredFile
from meshdeform.record.repository import check_priority
from meshdeform.requests.choices import WEIGHTS_PART
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.runs import check_request, kind_of
from meshdeform.runs.base import Kind
from meshdeform.runs.changes import parts_of
from meshdeform.runs.orientation_process import check_searchable, orientation_of
from meshdeform.settings import Settings
from meshdeform.storage import StoredObject
from meshdeform.support.failpoints import failpoint
from service.http.auth import Principal
from service.http.bodies import ReceivedFile
from service.http.idempotency import Answer, Caller, claimed, request_hash
from service.jobs.estimates import estimate
from service.jobs.sources import Submission
from service.state import AppState

if TYPE_CHECKING:
    from pydantic import BaseModel

_log = logging.getLogger(__name__)
_ORIENT_TIMEOUT_S = 240.0
_CONTENT_TYPE = "application/octet-stream"


def check_params(request: JobRequest, settings: Settings, *, files: Collection[str]) -> BaseModel:
    """Check a request for a job that has these files, and return the parameters that it would run with."""
    for name, value in request.metadata.items():
        # PostgreSQL cannot store this character.
        if "\0" in name + value:
            raise ParameterError.at(["metadata", name], "A label contains the character U+0000.")
    if settings.max_run_s and (request.max_run_s or 0.0) > settings.max_run_s:
        raise ParameterError.at(
            ["max_run_s"],
            f"{request.max_run_s:g} s are longer than a job of this server may run: {settings.max_run_s:g} s.",
            "Set max_run_s lower, or leave it out. The service's operator can raise MESHDEFORM_MAX_RUN_S.",
        )
    params = check_request(request, settings, files=files)
    steps = kind_of(request.kind).steps(request, settings.model, None)
    if steps > settings.max_steps:
        detail = f"{steps} steps are more than this server allows: {settings.max_steps}."
        raise ParameterError(
            detail,
            advice="Set params.steps lower, or raise MESHDEFORM_MAX_STEPS.",
            errors=[{"loc": ["params", "steps"], "msg": detail, "type": "less_than_equal"}],
            limit=settings.max_steps,
        )
    return params


def check_job(
    app: AppState, owner_id: str, submission: Submission
) -> tuple[BaseModel, dict[str, ReceivedFile], dict[str, AssetSummary | PictureSummary]]:
    """Check a job's parameters and decode its files completely. Nothing is stored.

    Return the parameters that it would run with, and its files and their summaries by part.
    """
    params = check_params(submission.document, app.settings, files=submission.names)
    files = submission.fetch_all(app, owner_id)
    kind = kind_of(submission.document.kind)
    found = {name: check_file(app, owner_id, kind, name, file) for name, file in files.items()}
    meshes = {name: each for name, each in found.items() if isinstance(each, AssetSummary)}
    kind.check_files(submission.document, params, meshes)
    first = files[kind.parts[0]]
    kind.check_asset(submission.document, params, first.path, first.filename, app.assets.limits)
    if WEIGHTS_PART in files:
        check_words(submission.document, files[WEIGHTS_PART].path, meshes)
    return params, files, found


def check_words(request: JobRequest, weights: Path, meshes: Mapping[str, AssetSummary]) -> None:
    """Check a request against the words of taught weights, which have passed `check_file`."""
    check = kind_of(request.kind).check_words
    if check is not None:
        check(request, taught.check(weights), meshes)


def check_file(
    app: AppState, owner_id: str, kind: Kind, part: str, file: ReceivedFile
) -> AssetSummary | PictureSummary:
    """Decode a file completely as what its part should be."""
    try:
        return app.assets.check(file.path, file.filename, file.sha256, owner_id, kind.content_of(part))
    except (SilhouetteError, DrawingError) as error:
        raise type(error)(f"`{part}`: {error.detail}", advice=error.advice_text, **error.extra) from error


def accept_job(app: AppState, caller: Caller, submission: Submission) -> Answer:
    """Accept a job durably, or refuse it without leaving anything behind."""
    document = submission.document.model_dump(mode="json", exclude_unset=True)
    digests = {name: file.sha256 for name, file in submission.files.items()}
    with claimed(app.record, caller, request_hash(caller.method, caller.path, document, digests)) as claim:
        if isinstance(claim, Answer):
            return claim
        params, files, summaries = check_job(app, caller.owner_id, submission)
        failpoint("api.received")
        sizes = {key_of(file): file.size for file in files.values()}

        def check_room() -> None:
            app.record.check_room(caller.owner_id, sizes, app.settings.max_stored_bytes)

        with app.record.files.leases() as leases:
            stored = {part: store_file(app, leases, file, check_room) for part, file in files.items()}
            failpoint("api.stored")
            size = _size(summaries)
            new = new_job(app, caller, submission.document, stored, resolved=params, claim=claim, **size)
            return record_job(app, new, leases)


def validate(app: AppState, principal: Principal, submission: Submission) -> Validation:
    """Check a job as `accept_job` does, and return its parameters, summaries and estimated time. Nothing is stored."""
    check_priority(submission.document.priority, principal.max_priority)
    params, files, summaries = check_job(app, principal.owner_id, submission)
    found: dict[str, AssetFound] = {}
    pictures: dict[str, PictureFound] = {}
    for name, file in files.items():
        members = {"filename": file.filename, "size": file.size, "sha256": file.sha256, **asdict(summaries[name])}
        members.pop("bounds", None)
        if isinstance(summaries[name], AssetSummary):
            found[name] = AssetFound(**members)
        else:
            pictures[name] = PictureFound(**members)
    expected = estimate(
        app.record.database,
        app.record.leases,
        submission.document,
        default_model=app.settings.model,
        queue=app.settings.queue,
        owner_id=principal.owner_id,
        safeguard=getattr(params, "safeguard", None),
        turn_s=app.settings.turn_s,
        **_size(summaries),
    )
    model = getattr(params, "model", None)
    if model is not None:  # as clients name it
        params = params.model_copy(update={"model": public_names(app.settings.offered_models).get(model, model)})
    return Validation(
        files=found,
        pictures=pictures,
        asset=next(iter(found.values())),
        target=found.get("target"),
        params=params,
        estimate=expected,
    )


def _size(summaries: Mapping[str, AssetSummary | PictureSummary]) -> dict[str, int]:
    """Return the faces and parts of the first file, as far as it has any."""
    asset = next(iter(summaries.values()))
    return {"faces": asset.triangles, "parts": asset.meshes} if isinstance(asset, AssetSummary) else {}


async def orient(app: AppState, owner_id: str, submission: Submission) -> FoundOrientation:
    """Check a job as `validate` does, and search its front in a child process."""
    params, asset = await app.take_in(owner_id, _searchable, app, owner_id, submission)
    async with app.orienting.slot(owner_id):
        return await to_thread.run_sync(_front, app, submission.document, params, asset)


def _searchable(app: AppState, owner_id: str, submission: Submission) -> tuple[ResolvedParams, ReceivedFile]:
    params = check_params(submission.document, app.settings, files=submission.names)
    if not isinstance(params, ResolvedParams):
        raise ParameterError("Jobs of this kind have no front.")
    check_searchable(params)  # before the files are decoded
    _, files, _ = check_job(app, owner_id, submission)
    return params, files["asset"]


def _front(app: AppState, request: JobRequest, params: ResolvedParams, asset: ReceivedFile) -> FoundOrientation:
    found = orientation_of(
        asset.path,
        asset.filename,
        request.prompt,
        params,
        subdivide=request.output.subdivide,
        limits=app.assets.limits,
        dtype=app.settings.dtype,
        timeout_s=_ORIENT_TIMEOUT_S,
    )
    return FoundOrientation(**found)


async def list_parts(app: AppState, owner_id: str, submission: Submission) -> FoundParts:
    """Check a job as `validate` does, but for its prompt, and find the parts of its asset in a child process."""
    prompt = submission.document.prompt
    # The child reads the prompt; whatever it is, the rest is checked as that of a change that needs no part.
    whole = submission.document.model_copy(update={"prompt": "taller"})
    params, asset = await app.take_in(owner_id, _with_parts, app, owner_id, replace(submission, document=whole))
    async with app.naming.slot(owner_id):
        limits = app.assets.limits
        found = await to_thread.run_sync(parts_of, asset.path, asset.filename, prompt, params, limits)
    return FoundParts(**found)


def _with_parts(app: AppState, owner_id: str, submission: Submission) -> tuple[ResolvedParams, ReceivedFile]:
    params, files, _ = check_job(app, owner_id, submission)
    if not isinstance(params, ResolvedParams):
        raise ParameterError("Jobs of this kind have no parts.")
    return params, files["asset"]


def store_file(
    app: AppState, leases: FileLeases, file: ReceivedFile, check_room: Callable[[], None] | None = None
) -> StoredFile:
    """Store a file under a lease, unless the store already holds an intact copy.

    The lease is taken first, so that the object stays. A damaged copy is replaced. `check_room` is called before
    anything is stored.
    """
    stored = StoredFile(key=key_of(file), filename=file.filename, size=file.size, sha256=file.sha256)
    leases.take(stored.key)
    if not app.store.holds(stored.key, file.sha256):
        if check_room is not None:
            check_room()
        app.store.put(stored.key, file.path, _CONTENT_TYPE, known=StoredObject(file.size, file.sha256))
    return stored


def key_of(file: ReceivedFile) -> str:
    """Return the key under which a file is stored: equal files have equal keys."""
    return f"assets/{file.sha256}"


def new_job(app: AppState, caller: Caller, request: JobRequest, files: Mapping[str, StoredFile], **more: Any) -> NewJob:
    """Return a new job of this caller, not yet recorded; `more` holds further fields of `NewJob`."""
    return NewJob(
        request,
        files,
        owner_id=caller.owner_id,
        retention_s=app.settings.retention_s or None,
        max_active=caller.principal.max_active_jobs,
        max_stored_bytes=app.settings.max_stored_bytes,
        max_priority=caller.principal.max_priority,
        request_id=caller.request_id,
        traceparent=caller.traceparent,
        answer=accepted,
        **more,
    )


def record_job(app: AppState, new: NewJob, leases: FileLeases) -> Answer:
    """Record a job whose files are stored and leased, enqueue it, and return the answer."""
    job = app.record.create(new)
    failpoint("api.recorded")
    leases.passed_on(new.sizes)
    try:
        app.queue.enqueue(job.id)
    except UnavailableError as error:
        # The job is recorded and therefore accepted: the reconciler enqueues it once Redis is back.
        _log.warning("job %s: not enqueued yet: %s", job.id, error)
    failpoint("api.enqueued")
    return Answer(**accepted(job))
