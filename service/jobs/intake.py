"""Accept a job: check everything, store the files, record the job, and notify the workers, in this order.

`validate` and `list_parts` check a job in the same way, and create none.

Stored files come to disk from uploads and other jobs; what the request names itself, `arrivals.py` brings. A file that
the document holds as base64 is there before an idempotency key is claimed, so that the request's hash covers its bytes.
Of a URL it covers the text: the file may still be on its way when the request is answered.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from anyio import to_thread

from meshdeform.api.documents import AssetFound, FoundParts, Outlook, PictureFound, Validation
from meshdeform.api.jobs import accepted
from meshdeform.assets import AssetSummary
from meshdeform.assets.inspect import PictureSummary
from meshdeform.assets.limits import Limits
from meshdeform.errors import ConflictError, NotFoundError, ParameterError, SilhouetteError, UnavailableError
from meshdeform.priors import public_names
from meshdeform.record.files import FileLeases
from meshdeform.record.models import Claim, NewJob, StoredFile
from meshdeform.record.repository import check_priority
from meshdeform.record.turns import Turns
from meshdeform.requests.choices import GuidanceKind, PartsAs
from meshdeform.requests.default_kind import with_kind
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.requests.parameters import WORDS_FIELD
from meshdeform.runs import check_request, kind_of
from meshdeform.runs.base import JobFile, Kind
from meshdeform.runs.changes import parts_of
from meshdeform.settings import Settings
from meshdeform.storage import StoredObject
from meshdeform.support.failpoints import failpoint
from meshdeform.words import Word, in_use, read_words
from service.http.auth import Principal
from service.http.forms import ReceivedFile
from service.http.idempotency import Caller, KeptAnswer, claimed, request_hash
from service.jobs.documents import FileReference, FileSource, JobDocument
from service.jobs.estimates import JobSize, estimate
from service.state import AppState
from service.words.known import pin_words, with_others

if TYPE_CHECKING:
    from pydantic import BaseModel

_log = logging.getLogger(__name__)
_CONTENT_TYPE = "application/octet-stream"
_F = TypeVar("_F")


def check(
    request: JobRequest, settings: Settings, *, files: Collection[str], known: Mapping[str, JobFile] | None = None
) -> BaseModel:
    """Check a request for a job that has these files, and return the parameters that it would run with.

    `known`: what is known of some of the files.
    """
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
    params = check_request(request, settings, files=files, known=known)
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


@dataclass(frozen=True)
class CheckedJob:
    """A job that could run: its parameters, and its files and what is known of them, by field."""

    params: BaseModel
    files: dict[str, ReceivedFile]
    known: dict[str, JobFile]

    @property
    def summaries(self) -> dict[str, AssetSummary | PictureSummary]:
        """Summaries of the files by field, of those that were decoded."""
        return {name: file.summary for name, file in self.known.items() if file.summary is not None}


def checked(app: AppState, owner_id: str, submission: Submission, *, look: bool = True) -> CheckedJob:
    """Fetch a job's files, decode them completely, and check the job with them, once it is checked without.

    `look`: whether what takes longer is looked for in the first file, such as the parts that the prompt names. Nothing
    is stored.
    """
    request = submission.document
    check(request, app.settings, files=submission.names)
    files = submission.fetch_all(app, owner_id)
    kind = kind_of(request.kind)
    sent = {name: file for name, file in files.items() if name != WORDS_FIELD}  # which `ready` has checked, or made
    known = {name: JobFile(decoded(app, owner_id, kind, name, file)) for name, file in sent.items()}
    if look:
        first = kind.fields[0]
        path, filename = files[first].path, files[first].filename
        known[first] = replace(known[first], path=path, filename=filename, readings=app.readings)
    return CheckedJob(check(request, app.settings, files=files, known=known), files, known)


def decoded(app: AppState, owner_id: str, kind: Kind, name: str, file: ReceivedFile) -> AssetSummary | PictureSummary:
    """Decode a file completely as what its field should hold."""
    try:
        return app.assets.check(file.path, file.filename, file.sha256, owner_id, kind.content_of(name))
    except SilhouetteError as error:
        raise type(error)(f"`{name}`: {error.detail}", advice=error.advice_text, **error.extra) from error


def ready(app: AppState, owner_id: str, submission: Submission) -> tuple[Submission, list[Word]]:
    """Return the submission of a request that names its kind of guidance and pins its words, and these words.

    Words that were sent count before the owner's.
    """
    submission = submission.with_kind(app.settings)
    sent = list[Word]()
    if WORDS_FIELD in submission.names and WORDS_FIELD in kind_of(submission.document.kind).fields:
        submission = submission.with_fetched(app, owner_id, WORDS_FIELD)
        file = submission.files[WORDS_FIELD]
        decoded(app, owner_id, kind_of(submission.document.kind), WORDS_FIELD, file)
        sent = read_words(file.path.read_bytes())
    document, pinned, words = pin_words(app, owner_id, submission.document, submission.folder, sent=sent)
    files = submission.files if pinned is None else {**submission.files, WORDS_FIELD: pinned}
    return replace(submission, document=document, files=files), words


def accept_job(app: AppState, caller: Caller, submission: Submission) -> KeptAnswer:
    """Accept a job durably, or refuse it without leaving anything behind."""
    with claimed(app.record, caller, _hash_of(caller, submission)) as claim:
        if isinstance(claim, KeptAnswer):
            return claim
        with _stored(app, caller, submission, claim) as (new, leases):
            return record_job(app, new, leases)


def accept_early(app: AppState, caller: Caller, submission: Submission) -> KeptAnswer:
    """Accept a job some of whose files are still being fetched, once all else is checked. `complete_job` does the rest.

    Nobody takes it before, and it fails by itself if that is not done in time.
    """
    with claimed(app.record, caller, _hash_of(caller, submission)) as claim:
        if isinstance(claim, KeptAnswer):
            return claim
        asked = submission.with_kind(app.settings)
        check(asked.document, app.settings, files=asked.names)
        kind = kind_of(asked.document.kind)
        for name, file in asked.files.items():
            decoded(app, caller.owner_id, kind, name, file)
        new = new_job(app, caller, asked.document.without(asked.document.references), {}, claim=claim, fetching=True)
        return KeptAnswer(**accepted(app.record.create(new)))


def complete_job(app: AppState, caller: Caller, submission: Submission, job_id: str) -> None:
    """Check the files of a job that was accepted early, store them, and give it to the workers."""
    with _stored(app, caller, submission, None) as (new, leases):
        if app.record.fetching.complete(job_id, new):
            leases.passed_on(new.sizes)
            _announce(app, job_id)


def _hash_of(caller: Caller, submission: Submission) -> str:
    document = submission.document.without(submission.document.sources)
    digests = {name: file.sha256 for name, file in submission.files.items()} | submission.urls
    body = document.model_dump(mode="json", exclude_unset=True)
    return request_hash(caller.method, caller.path, body, digests)


@contextmanager
def _stored(
    app: AppState, caller: Caller, submission: Submission, claim: Claim | None
) -> Iterator[tuple[NewJob, FileLeases]]:
    """Check a job and store its files; the leases on these end with the block."""
    submission, words = ready(app, caller.owner_id, submission)
    with in_use(words):
        job = checked(app, caller.owner_id, submission)
    failpoint("api.received")
    sizes = {key_of(file): file.size for file in job.files.values()}

    def check_room() -> None:
        app.record.check_room(caller.owner_id, sizes, app.settings.max_stored_bytes)

    with app.record.files.leases() as leases:
        stored = {name: store_file(app, leases, file, check_room) for name, file in job.files.items()}
        failpoint("api.stored")
        size = _size(job.summaries)
        yield new_job(app, caller, submission.document, stored, resolved=job.params, claim=claim, **size), leases


def validate(app: AppState, principal: Principal, submission: Submission) -> Validation:
    """Check a job as `accept_job` does, and return its parameters, summaries and estimated time. Nothing is stored."""
    check_priority(submission.document.priority, principal.max_priority)
    submission, words = ready(app, principal.owner_id, submission)
    with in_use(words):
        job = checked(app, principal.owner_id, submission)
        outlook = _outlook(app, submission.document, job)
    params = job.params
    reports: dict[str, AssetFound] = {}
    pictures: dict[str, PictureFound] = {}
    for name, summary in job.summaries.items():
        file = job.files[name]
        members = {"filename": file.filename, "size": file.size, "sha256": file.sha256, **asdict(summary)}
        members.pop("bounds", None)
        if isinstance(summary, AssetSummary):
            reports[name] = AssetFound(**members)
        else:
            pictures[name] = PictureFound(**members)
    expected = estimate(
        app.record.database,
        app.record.leases,
        submission.document,
        default_model=app.settings.model,
        queue=app.settings.queue,
        owner_id=principal.owner_id,
        size=JobSize(**_size(job.summaries), safeguard=getattr(params, "safeguard", None)),
        turns=Turns.of(app.settings),
    )
    model = getattr(params, "model", None)
    if model is not None:  # as clients name it
        params = params.model_copy(update={"model": public_names(app.settings.offered_models).get(model, model)})
    return Validation(
        files=reports,
        pictures=pictures,
        asset=next(iter(reports.values())),
        target=reports.get("target"),
        params=params,
        estimate=expected,
        outlook=outlook,
    )


def _outlook(app: AppState, request: JobRequest, job: CheckedJob) -> Outlook | None:
    kind = kind_of(request.kind)
    found = kind.outlook(request, job.params, app.settings, job.known[kind.fields[0]])
    return None if found is None else Outlook(**found)


def _size(summaries: Mapping[str, AssetSummary | PictureSummary]) -> dict[str, int]:
    """Return the faces and meshes of the first file, as far as it has any."""
    asset = next(iter(summaries.values()))
    return {"faces": asset.triangles, "meshes": asset.meshes} if isinstance(asset, AssetSummary) else {}


async def list_parts(app: AppState, owner_id: str, submission: Submission, glb: PartsAs | None = None) -> FoundParts:
    """Check a job as `validate` does, but for its prompt, and find the parts of its asset in a child process.

    `glb`: the form in which the result has them.
    """
    prompt = submission.document.prompt
    # The child reads the prompt; whatever it is, the rest is checked as that of a change that needs no part.
    whole = replace(submission, document=submission.document.model_copy(update={"prompt": "taller"}))
    params, asset, words = await app.take_in(owner_id, _with_parts, app, owner_id, whole, prompt)
    async with app.naming.slot(owner_id):
        limits = app.assets.limits
        find = partial(parts_of, asset.path, asset.filename, prompt, params, limits, app.readings, glb=glb)
        with in_use(words):
            parts = await to_thread.run_sync(find)
    return FoundParts(**parts)


def _with_parts(
    app: AppState, owner_id: str, whole: Submission, prompt: str
) -> tuple[ResolvedParams, ReceivedFile, list[Word]]:
    """Check a submission, and return its parameters, its asset, and the words that it may be.

    They are those that it and the real prompt name, and the owner's others.
    """
    whole = whole.with_kind(app.settings)
    asked = replace(whole, document=whole.document.model_copy(update={"prompt": prompt}))
    asked, words = ready(app, owner_id, asked)
    with in_use(words):
        prompted = asked.document.model_copy(update={"prompt": whole.document.prompt})
        job = checked(app, owner_id, replace(asked, document=prompted))
    params = job.params
    if not isinstance(params, ResolvedParams):
        raise ParameterError("Jobs of this kind have no parts.")
    if params.guidance is GuidanceKind.EXEMPLAR:  # a job knows what it names, but this asset may be any of them
        words = with_others(app, owner_id, words)
        params = params.model_copy(update={"words": {word.noun: word.sha256 for word in words}})
    return params, job.files["asset"], words


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


def record_job(app: AppState, new: NewJob, leases: FileLeases) -> KeptAnswer:
    """Record a job whose files are stored and leased, enqueue it, and return the answer."""
    job = app.record.create(new)
    failpoint("api.recorded")
    leases.passed_on(new.sizes)
    _announce(app, job.id)
    failpoint("api.enqueued")
    return KeptAnswer(**accepted(job))


def _announce(app: AppState, job_id: str) -> None:
    try:
        app.queue.enqueue(job_id)
    except UnavailableError as error:
        # The job is recorded and therefore accepted: the reconciler enqueues it once Redis is back.
        _log.warning("job %s: not enqueued yet: %s", job_id, error)


def file_advice(name: str) -> str:
    """Return advice on how to give a job a file."""
    return f"Send the file as the field `{name}`, or name an upload or an artifact in the document: `files.{name}`."


def in_order(request: JobRequest, files: Mapping[str, _F]) -> dict[str, _F]:
    """Return the files of a job in the order of the fields of its kind."""
    return {name: files[name] for name in kind_of(request.kind).fields if name in files}


def missing_files(document: JobDocument, received: Collection[str]) -> list[str]:
    """Return the names of required files that are neither sent nor named in the document."""
    present = {*received, *document.references}
    return [field.name for field in kind_of(document.kind).reads if field.required and field.name not in present]


@dataclass(frozen=True)
class Submission:
    """A request for a job, and the files sent with it, by field; those that are fetched join them in `folder`."""

    document: JobDocument
    files: dict[str, ReceivedFile]
    folder: Path
    urls: dict[str, str] = field(default_factory=dict)
    """SHA-256 of the URLs, by field, that the document named."""

    def __post_init__(self) -> None:
        """Check that every file is given once, and every required one is given."""
        named = self.document.references
        for name in self.files:
            if name in named:
                raise ParameterError.at(
                    [name], f"`{name}` is both sent as a field and named in the document.", "Leave one of the two out."
                )
        for name in missing_files(self.document, self.files):
            raise ParameterError.at([name], f"`{name}` is missing.", file_advice(name))

    @property
    def names(self) -> set[str]:
        """The names of all files, sent or named."""
        return {*self.files, *self.document.references}

    def with_kind(self, settings: Settings) -> Submission:
        """Return the submission of a request that names its kind of guidance."""
        return replace(self, document=with_kind(self.document, settings.model, self.names))

    def with_fetched(self, app: AppState, owner_id: str, name: str) -> Submission:
        """Return the submission with one of its files here, if the document only names it."""
        if name in self.files:
            return self
        file = fetch(app, owner_id, *self.document.references[name], self.folder)
        return replace(self, document=self.document.without([name]), files={**self.files, name: file})

    def fetch_all(self, app: AppState, owner_id: str) -> dict[str, ReceivedFile]:
        """Fetch the files that the document names, and return all files by name, in the order of the kind's fields."""
        named = self.document.references.items()
        fetched = {name: fetch(app, owner_id, *reference, self.folder) for name, reference in named}
        return in_order(self.document, {**self.files, **fetched})


def fetch(
    app: AppState, owner_id: str, reference: FileReference | FileSource, location: list[str], folder: Path
) -> ReceivedFile:
    """Copy the file that a reference names into the folder.

    `owner_id`: the owner of the uploads and jobs that may be named. `location`: that of the member that holds the
    reference; its last name is also that of the file in the folder.
    """
    path = folder / location[-1]
    if reference.upload_id is not None:
        with _reported_at([*location, "upload_id"], f"There is no upload {reference.upload_id}."):
            upload = app.record.uploads.get(reference.upload_id, owner=owner_id)
            if upload.key is None or upload.sha256 is None:
                raise ConflictError(
                    f"The upload {upload.id} is not complete.",
                    advice=f"Send the rest of it, then POST /v1/uploads/{upload.id}/complete.",
                )
            app.store.fetch(upload.key, path, sha256=upload.sha256)
        return ReceivedFile(path, upload.filename, upload.size, upload.sha256)
    assert reference.job_id is not None
    with _reported_at([*location, "job_id"], f"There is no job {reference.job_id}."):
        job = app.record.get(reference.job_id, owner=owner_id)
        artifacts = {artifact.name: artifact for artifact in app.record.artifacts(job.id, owner=owner_id)}
    if reference.artifact not in artifacts:
        if not job.state.terminal:
            raise ConflictError(f"The job {job.id} is {job.state}.", advice="Wait until it has succeeded.")
        detail = f"The {job.state} job {job.id} has no such artifact."
        raise ParameterError.at([*location, "artifact"], detail, f"It has: {', '.join(artifacts) or 'none'}.")
    artifact = artifacts[reference.artifact]
    Limits.from_settings(app.settings).check_bytes(artifact.size, "The artifact has")
    with _reported_at([*location, "job_id"], f"There is no job {reference.job_id}."):
        app.store.fetch(artifact.key, path, sha256=artifact.sha256)
    return ReceivedFile(path, artifact.name, artifact.size, artifact.sha256)


@contextmanager
def _reported_at(location: list[str], detail: str) -> Iterator[None]:
    """Turn NotFoundError into a ParameterError at `location`: the document is wrong, not the path of the request."""
    try:
        yield
    except NotFoundError as error:
        raise ParameterError.at(
            location, detail, "Check the id; the file may have been deleted or have expired."
        ) from error
