"""Take a job in: check everything, store the files, record the job, tell the workers, in this order."""

from __future__ import annotations

import logging
from collections.abc import Collection
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from meshdeform.api.jobs import accepted
from meshdeform.assets import AssetSummary
from meshdeform.errors import ParameterError, UnavailableError
from meshdeform.record.estimates import estimate
from meshdeform.record.files import FileLeases
from meshdeform.record.models import NewJob, StoredFile
from meshdeform.requests.document import JobRequest
from meshdeform.runs import check_request, kind_of
from meshdeform.settings import Settings
from meshdeform.storage import StoredObject
from meshdeform.support.failpoints import failpoint
from service.http.idempotency import Answer, Caller, claimed, request_hash
from service.http.multipart import ReceivedFile
from service.jobs.sources import Submission
from service.schemas import AssetFound, JobEstimate, Validation
from service.state import AppState

if TYPE_CHECKING:
    from pydantic import BaseModel

__all__ = ["check_params", "keep_file", "new_job", "record_job", "take_in", "try_out"]

_log = logging.getLogger(__name__)
_CONTENT_TYPE = "application/octet-stream"


def check_params(request: JobRequest, settings: Settings, *, files: Collection[str]) -> BaseModel:
    """Return the parameters that a request would run with.

    Parameters
    ----------
    request : JobRequest
    settings : Settings
    files : collection of str
        The names of the files that it has.

    Raises
    ------
    RequestError, ModelError
        No worker of this deployment could run it, or it asks for more than the deployment allows.
    """
    for name, value in request.metadata.items():
        # PostgreSQL keeps no text with this character.
        if "\0" in name + value:
            detail = "A label holds the character U+0000."
            errors = [{"loc": ["metadata", name], "msg": detail, "type": "value_error"}]
            raise ParameterError(detail, errors=errors)
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


def _checked(
    app: AppState, owner_id: str, sent: Submission
) -> tuple[BaseModel, dict[str, ReceivedFile], dict[str, AssetSummary]]:
    """Check a job from its parameters to the last vertex of its files; nothing is stored.

    Returns
    -------
    What it would run with, its files, and what there is in each: `asset`, and `target` if there is one.

    Raises
    ------
    AssetError, RequestError, ModelError
        What is wrong with the asset or the request.
    """
    params = check_params(sent.document, app.settings, files=sent.names)
    files = sent.fetched(app, owner_id)
    found = {name: app.assets.check(file.path, file.filename, file.sha256) for name, file in files.items()}
    return params, files, found


def take_in(app: AppState, caller: Caller, sent: Submission) -> Answer:
    """Accept a job for good, or refuse it and leave nothing behind.

    Parameters
    ----------
    app : AppState
    caller : Caller
    sent : Submission
        Its files may be gone when this returns.

    Raises
    ------
    AssetError, RequestError, ModelError
        What is wrong with the asset or the request.
    TooManyJobsError
        The caller has as many unfinished jobs as it may.
    UnavailableError
        The record or the store does not answer. Redis may be away: workers are told when it is back.
    """
    document = sent.document.model_dump(mode="json", exclude_unset=True)
    digests = {name: file.sha256 for name, file in sent.files.items()}
    with claimed(app.record, caller, request_hash(caller.method, caller.path, document, digests)) as claim:
        if isinstance(claim, Answer):
            return claim
        params, files, _ = _checked(app, caller.owner_id, sent)
        failpoint("api.received")
        with app.record.files.leases() as leases:
            asset = keep_file(app, leases, files["asset"])
            target = keep_file(app, leases, files["target"]) if "target" in files else None
            failpoint("api.stored")
            new = new_job(app, caller, sent.document, asset, target, resolved=params, claim=claim)
            return record_job(app, new, leases)


def try_out(app: AppState, owner_id: str, sent: Submission) -> Validation:
    """Check a job as `take_in` would, and say what it is and how long it would take. Nothing is stored."""
    params, files, summaries = _checked(app, owner_id, sent)
    found = {
        name: AssetFound(filename=file.filename, size=file.size, sha256=file.sha256, **asdict(summaries[name]))
        for name, file in files.items()
    }
    expected = estimate(
        app.record.database,
        app.record.leases,
        sent.document,
        default_model=app.settings.model,
        queue=app.settings.queue,
    )
    return Validation(
        asset=found["asset"], target=found.get("target"), params=params, estimate=JobEstimate(**asdict(expected))
    )


def keep_file(app: AppState, leases: FileLeases, file: ReceivedFile) -> StoredFile:
    """Store a file under a pin. The same bytes are stored once: the pin comes first, so they stay."""
    stored = StoredFile(key=f"assets/{file.sha256}", filename=file.filename, size=file.size, sha256=file.sha256)
    leases.take(stored.key)
    if not app.store.exists(stored.key):
        app.store.put(stored.key, file.path, _CONTENT_TYPE, known=StoredObject(file.size, file.sha256))
    return stored


def new_job(
    app: AppState, caller: Caller, request: JobRequest, asset: StoredFile, target: StoredFile | None, **more: Any
) -> NewJob:
    """Return a job of this caller's, to be recorded; `more` are further fields of `NewJob`."""
    return NewJob(
        request,
        asset,
        target,
        owner_id=caller.owner_id,
        retention_s=app.settings.retention_s or None,
        max_active=caller.principal.max_active_jobs,
        max_priority=caller.principal.max_priority,
        request_id=caller.request_id,
        traceparent=caller.traceparent,
        **more,
    )


def record_job(app: AppState, new: NewJob, leases: FileLeases) -> Answer:
    """Record a job whose files are stored and pinned, and tell the workers."""
    job = app.record.create(new)
    failpoint("api.recorded")
    leases.passed_on([file.key for file in (new.asset, new.target, new.origin) if file is not None])
    try:
        app.queue.enqueue(job.id)
    except UnavailableError as error:
        # The job is on the record, so it is accepted: the reconciler tells the workers once Redis is back.
        _log.warning("job %s: the workers are not told yet: %s", job.id, error)
    failpoint("api.told")
    return Answer(**accepted(job))
