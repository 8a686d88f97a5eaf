"""Take a job in: check everything, store the files, record the job, tell the workers, in this order."""

from __future__ import annotations

import logging
from dataclasses import asdict, dataclass
from pathlib import Path

import sqlalchemy as sa

from meshdeform.api.jobs import JobView
from meshdeform.assets import AssetSummary
from meshdeform.errors import ParameterError, UnavailableError
from meshdeform.record.estimates import estimate
from meshdeform.record.models import Job, NewJob, Origin, StoredFile
from meshdeform.requests.document import JobRequest, ResolvedParams, resolve
from meshdeform.runs import check_request
from meshdeform.settings import Settings
from meshdeform.support.failpoints import failpoint
from service.http.caller import Caller
from service.http.idempotency import Answer, Keep, done_once, request_hash
from service.http.multipart import ReceivedFile
from service.jobs.file_leases import Pins
from service.jobs.sources import Submission
from service.schemas import AssetFound, JobEstimate, Validation
from service.state import Parts

__all__ = [
    "Checked",
    "check",
    "check_params",
    "job_headers",
    "keep_file",
    "record_job",
    "take_in",
    "try_out",
]

_log = logging.getLogger(__name__)
_CONTENT_TYPE = "application/octet-stream"
_POLL_S = "1"


@dataclass(frozen=True)
class Checked:
    """A job that could be made.

    Attributes
    ----------
    request : JobRequest
    params : ResolvedParams
    files : dict of str to ReceivedFile
        `asset`, and `target` if there is one.
    summaries : dict of str to AssetSummary
        What there is in each.
    """

    request: JobRequest
    params: ResolvedParams
    files: dict[str, ReceivedFile]
    summaries: dict[str, AssetSummary]


def check_params(request: JobRequest, settings: Settings, *, has_target: bool) -> ResolvedParams:
    """Refuse a request that no worker of this deployment could run, or that asks for more than it allows.

    Raises
    ------
    RequestError, ModelError
        What is wrong.
    """
    for name, value in request.metadata.items():
        # PostgreSQL keeps no text with this character.
        if "\0" in name + value:
            detail = "A label holds the character U+0000."
            errors = [{"loc": ["metadata", name], "msg": detail, "type": "value_error"}]
            raise ParameterError(detail, errors=errors)
    check_request(request, settings, files=["asset", "target"] if has_target else ["asset"])
    params = resolve(request.params, default_model=settings.model)
    if params.steps > settings.max_steps:
        detail = f"{params.steps} steps are more than this server allows: {settings.max_steps}."
        raise ParameterError(
            detail,
            advice="Set params.steps lower, or raise MESHDEFORM_MAX_STEPS.",
            errors=[{"loc": ["params", "steps"], "msg": detail, "type": "less_than_equal"}],
            limit=settings.max_steps,
        )
    return params


def check(parts: Parts, owner_id: str, submitted: Submission, folder: Path) -> Checked:
    """Check a job from its parameters to the last vertex of its files; nothing is stored.

    Parameters
    ----------
    parts : Parts
    owner_id : str
    submitted : Submission
    folder : Path
        Where files go that did not come along.

    Raises
    ------
    AssetError, RequestError, ModelError
        What is wrong with the asset or the request.
    """
    params = check_params(submitted.request, parts.settings, has_target=submitted.has_target)
    files = submitted.files(parts, owner_id, folder)
    summaries = {name: parts.assets.check(file) for name, file in files.items()}
    return Checked(submitted.request, params, files, summaries)


def take_in(parts: Parts, caller: Caller, submitted: Submission, folder: Path) -> Answer:
    """Accept a job for good, or refuse it and leave nothing behind.

    Parameters
    ----------
    parts : Parts
    caller : Caller
    submitted : Submission
        Its files may be gone when this returns.
    folder : Path
        Where files go that did not come along.

    Raises
    ------
    AssetError, RequestError, ModelError
        What is wrong with the asset or the request.
    TooManyJobsError
        The caller has as many unfinished jobs as it may.
    UnavailableError
        The record or the store does not answer. Redis may be away: workers are told when it is back.
    """

    def work(keep: Keep) -> Answer:
        checked = check(parts, caller.owner_id, submitted, folder)
        failpoint("api.received")
        with Pins(parts.record.files) as pins:
            stored = {name: keep_file(parts, pins, file) for name, file in checked.files.items()}
            failpoint("api.stored")
            return record_job(parts, caller, pins, checked.request, stored["asset"], stored.get("target"), keep=keep)

    document = submitted.document.model_dump(mode="json", exclude_unset=True)
    return done_once(parts.record, caller, request_hash(caller.method, caller.path, document, submitted.digests), work)


def try_out(parts: Parts, owner_id: str, submitted: Submission, folder: Path) -> Validation:
    """Check a job as `take_in` would, and say what it is and how long it would take. Nothing is stored."""
    checked = check(parts, owner_id, submitted, folder)
    found = {
        name: AssetFound(filename=file.filename, size=file.size, sha256=file.sha256, **asdict(checked.summaries[name]))
        for name, file in checked.files.items()
    }
    return Validation(
        asset=found["asset"],
        target=found.get("target"),
        params=checked.params,
        estimate=_estimate(parts, checked),
    )


def _estimate(parts: Parts, checked: Checked) -> JobEstimate:
    settings = parts.settings
    found = estimate(
        parts.record.database,
        parts.record.leases,
        checked.request,
        default_model=settings.model,
        queue=settings.queue,
    )
    return JobEstimate(**asdict(found))


def keep_file(parts: Parts, pins: Pins, file: ReceivedFile) -> StoredFile:
    """Store a file under a pin. The same bytes are stored once: the pin comes first, so they stay."""
    stored = StoredFile(key=f"assets/{file.sha256}", filename=file.filename, size=file.size, sha256=file.sha256)
    pins.take(stored.key)
    if not parts.store.exists(stored.key):
        parts.store.put(stored.key, file.path, _CONTENT_TYPE)
    return stored


def record_job(
    parts: Parts,
    caller: Caller,
    pins: Pins,
    request: JobRequest,
    asset: StoredFile,
    target: StoredFile | None,
    *,
    origin: Origin | None = None,
    keep: Keep,
) -> Answer:
    """Record a job whose files are stored and pinned, and tell the workers."""
    new = NewJob(
        request,
        asset,
        target,
        owner_id=caller.owner_id,
        origin=origin,
        retention_s=parts.settings.retention_s or None,
        max_active=caller.principal.max_active_jobs,
        request_id=caller.request_id,
        traceparent=caller.traceparent,
    )
    answers: list[Answer] = []

    def also(connection: sa.Connection, job: Job) -> None:
        answers.append(_accepted(job))
        keep(connection, answers[-1])

    job = parts.record.create(new, also=also)
    failpoint("api.recorded")
    pins.passed_on([file.key for file in (asset, target, origin) if file is not None])
    try:
        parts.queue.enqueue(job.id)
    except UnavailableError as error:
        # The job is on the record, so it is accepted: the reconciler tells the workers once Redis is back.
        _log.warning("job %s: the workers are not told yet: %s", job.id, error)
    failpoint("api.told")
    return answers[-1]


def job_headers(job: Job) -> dict[str, str]:
    """Headers of every answer that shows a job."""
    retry = {} if job.state.terminal else {"Retry-After": _POLL_S}
    return {"ETag": f'W/"{job.version}"', "Cache-Control": "no-cache", **retry}


def _accepted(job: Job) -> Answer:
    return Answer(202, JobView.of(job).as_json(), {**job_headers(job), "Location": f"/v1/jobs/{job.id}"})
