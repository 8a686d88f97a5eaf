"""Accept a job: check everything, store the files, record the job, and notify the workers, in this order.

`validate` and `list_parts` check a job in the same way, and create none.

Fetch the files of a job to disk from wherever they are: the request, a URL, an upload, or another job.

A URL is fetched from the checked addresses of its host alone, without redirects, within the upload limit and half a
minute. Such a file, and one that the document holds as base64, is taken in before an idempotency key is claimed, so
that the request's hash covers its bytes.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
import hashlib
import logging
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import unquote

import anyio
from anyio import to_thread

from meshdeform import __version__
from meshdeform.api.documents import AssetFound, FoundParts, Outlook, PictureFound, Validation
from meshdeform.api.jobs import accepted
from meshdeform.api.states import MAX_FETCH_S
from meshdeform.assets import AssetSummary
from meshdeform.assets.inspect import PictureSummary
from meshdeform.assets.limits import Limits
from meshdeform.errors import (
    AssetNotFetchedError,
    AssetTooLargeError,
    ConflictError,
    DrawingError,
    NotFoundError,
    ParameterError,
    SilhouetteError,
    UnavailableError,
    WebhookAddressError,
)
from meshdeform.priors import public_names
from meshdeform.record.files import FileLeases
from meshdeform.record.models import NewJob, StoredFile
from meshdeform.record.repository import check_priority
from meshdeform.requests.choices import GuidanceKind, PartsAs
from meshdeform.requests.default_kind import with_kind
from meshdeform.requests.document import JobRequest, ResolvedParams
from meshdeform.requests.parameters import WORDS_PART
from meshdeform.runs import check_request, kind_of
from meshdeform.runs.base import Kind
from meshdeform.runs.changes import parts_of
from meshdeform.settings import Settings
from meshdeform.storage import StoredObject
from meshdeform.support.failpoints import failpoint
from meshdeform.webhooks.addresses import LOOKUP_S, Destination, find_destination, parse_networks
from meshdeform.words import Word, in_use, read_words
from service.http.auth import Principal
from service.http.bodies import ReceivedFile, clean_filename
from service.http.idempotency import Answer, Caller, claimed, request_hash
from service.jobs.documents import FileReference, FileSource, JobDocument, PreviewSource
from service.jobs.estimates import estimate
from service.state import AppState
from service.words.known import pin_words, with_others

if TYPE_CHECKING:
    import ssl

    import httpcore
    from pydantic import BaseModel

_log = logging.getLogger(__name__)
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
    summaries = check_files(app, owner_id, submission.document, params, files)
    kind = kind_of(submission.document.kind)
    first = files[kind.parts[0]]
    kind.check_asset(submission.document, params, first.path, first.filename, app.assets.limits, app.readings)
    return params, files, summaries


def check_files(
    app: AppState, owner_id: str, request: JobRequest, params: BaseModel, files: Mapping[str, ReceivedFile]
) -> dict[str, AssetSummary | PictureSummary]:
    """Decode the files of a job completely, and refuse parameters that do not fit them; return their summaries."""
    kind = kind_of(request.kind)
    sent = [name for name in files if name != WORDS_PART]  # words are the owner's, or were checked when they were read
    summaries = {name: check_file(app, owner_id, kind, name, files[name]) for name in sent}
    meshes = {name: each for name, each in summaries.items() if isinstance(each, AssetSummary)}
    kind.check_files(request, params, meshes)
    return summaries


def check_file(
    app: AppState, owner_id: str, kind: Kind, part: str, file: ReceivedFile
) -> AssetSummary | PictureSummary:
    """Decode a file completely as what its part should be."""
    try:
        return app.assets.check(file.path, file.filename, file.sha256, owner_id, kind.content_of(part))
    except (SilhouetteError, DrawingError) as error:
        raise type(error)(f"`{part}`: {error.detail}", advice=error.advice_text, **error.extra) from error


def ready(app: AppState, owner_id: str, submission: Submission) -> tuple[Submission, list[Word]]:
    """Return the submission of a request that names its kind of guidance and pins its words, and these words.

    Words that were sent count before the owner's.
    """
    submission = submission.with_kind(app.settings)
    sent = list[Word]()
    if WORDS_PART in submission.names and WORDS_PART in kind_of(submission.document.kind).parts:
        submission = submission.with_fetched(app, owner_id, WORDS_PART)
        file = submission.files[WORDS_PART]
        check_file(app, owner_id, kind_of(submission.document.kind), WORDS_PART, file)
        sent = read_words(file.path.read_bytes())
    document, pinned, words = pin_words(app, owner_id, submission.document, submission.folder, sent=sent)
    files = submission.files if pinned is None else {**submission.files, WORDS_PART: pinned}
    return Submission(document, files, submission.folder), words


def accept_job(app: AppState, caller: Caller, submission: Submission) -> Answer:
    """Accept a job durably, or refuse it without leaving anything behind."""
    document = submission.document.model_dump(mode="json", exclude_unset=True)
    digests = {name: file.sha256 for name, file in submission.files.items()}
    with claimed(app.record, caller, request_hash(caller.method, caller.path, document, digests)) as claim:
        if isinstance(claim, Answer):
            return claim
        submission, words = ready(app, caller.owner_id, submission)
        with in_use(words):
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
    submission, words = ready(app, principal.owner_id, submission)
    with in_use(words):
        params, files, summaries = check_job(app, principal.owner_id, submission)
        outlook = _outlook(app, submission.document, params, files)
    reports: dict[str, AssetFound] = {}
    pictures: dict[str, PictureFound] = {}
    for name, summary in summaries.items():
        file = files[name]
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
        safeguard=getattr(params, "safeguard", None),
        turn_s=app.settings.turn_s,
        **_size(summaries),
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


def _outlook(
    app: AppState, request: JobRequest, params: BaseModel, files: Mapping[str, ReceivedFile]
) -> Outlook | None:
    kind = kind_of(request.kind)
    first = files[kind.parts[0]]
    found = kind.outlook(request, params, first.path, first.filename, app.assets.limits, app.readings)
    return None if found is None else Outlook(**found)


def _size(summaries: Mapping[str, AssetSummary | PictureSummary]) -> dict[str, int]:
    """Return the faces and parts of the first file, as far as it has any."""
    asset = next(iter(summaries.values()))
    return {"faces": asset.triangles, "parts": asset.meshes} if isinstance(asset, AssetSummary) else {}


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
        checked = replace(asked, document=asked.document.model_copy(update={"prompt": whole.document.prompt}))
        params, files, _ = check_job(app, owner_id, checked)
    if not isinstance(params, ResolvedParams):
        raise ParameterError("Jobs of this kind have no parts.")
    if params.guidance is GuidanceKind.EXEMPLAR:  # a job knows what it names, but this asset may be any of them
        words = with_others(app, owner_id, words)
        params = params.model_copy(update={"words": {word.noun: word.sha256 for word in words}})
    return params, files["asset"], words


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


_F = TypeVar("_F")


def file_advice(name: str) -> str:
    """Return advice on how to give a job a file."""
    return f"Send the file as the part `{name}`, or name an upload or an artifact in the document: `files.{name}`."


def in_order(request: JobRequest, files: Mapping[str, _F]) -> dict[str, _F]:
    """Return the files of a job in the order of the parts of its kind."""
    return {name: files[name] for name in kind_of(request.kind).parts if name in files}


def missing_files(document: JobDocument, received: Collection[str]) -> list[str]:
    """Return the names of required files that are neither sent nor named in the document."""
    present = {*received, *document.references}
    return [part.name for part in kind_of(document.kind).reads if part.required and part.name not in present]


@dataclass(frozen=True)
class Submission:
    """A request for a job, and the files sent with it, by part; those that are fetched join them in `folder`."""

    document: JobDocument
    files: dict[str, ReceivedFile]
    folder: Path

    def __post_init__(self) -> None:
        """Check that every file is given once, and every required one is given."""
        named = self.document.references
        for name in self.files:
            if name in named:
                raise ParameterError.at(
                    [name], f"`{name}` is both sent as a part and named in the document.", "Leave one of the two out."
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
        return Submission(self.document.without([name]), {**self.files, name: file}, self.folder)

    def fetch_all(self, app: AppState, owner_id: str) -> dict[str, ReceivedFile]:
        """Fetch the files that the document names, and return all files by name, in the order of the kind's parts."""
        named = self.document.references.items()
        fetched = {name: fetch(app, owner_id, *reference, self.folder) for name, reference in named}
        return in_order(self.document, {**self.files, **fetched})


def fetch(
    app: AppState, owner_id: str, reference: FileReference | FileSource, place: list[str], folder: Path
) -> ReceivedFile:
    """Copy the file that a reference names into the folder.

    `owner_id`: the owner of the uploads and jobs that may be named. `place`: the member that holds the reference; its
    last name is also that of the file in the folder.
    """
    path = folder / place[-1]
    if reference.upload_id is not None:
        with _reported_at([*place, "upload_id"], f"There is no upload {reference.upload_id}."):
            upload = app.record.uploads.get(reference.upload_id, owner=owner_id)
            if upload.key is None or upload.sha256 is None:
                raise ConflictError(
                    f"The upload {upload.id} is not complete.",
                    advice=f"Send the rest of it, then POST /v1/uploads/{upload.id}/complete.",
                )
            app.store.fetch(upload.key, path, sha256=upload.sha256)
        return ReceivedFile(path, upload.filename, upload.size, upload.sha256)
    assert reference.job_id is not None
    with _reported_at([*place, "job_id"], f"There is no job {reference.job_id}."):
        job = app.record.get(reference.job_id, owner=owner_id)
        artifacts = {artifact.name: artifact for artifact in app.record.artifacts(job.id, owner=owner_id)}
    if reference.artifact not in artifacts:
        if not job.state.terminal:
            raise ConflictError(f"The job {job.id} is {job.state}.", advice="Wait until it has succeeded.")
        detail = f"The {job.state} job {job.id} has no such artifact."
        raise ParameterError.at([*place, "artifact"], detail, f"It has: {', '.join(artifacts) or 'none'}.")
    artifact = artifacts[reference.artifact]
    Limits.from_settings(app.settings).check_bytes(artifact.size, "The artifact has")
    with _reported_at([*place, "job_id"], f"There is no job {reference.job_id}."):
        app.store.fetch(artifact.key, path, sha256=artifact.sha256)
    return ReceivedFile(path, artifact.name, artifact.size, artifact.sha256)


@contextmanager
def _reported_at(place: list[str], detail: str) -> Iterator[None]:
    """Turn NotFoundError into a ParameterError at `place`: the document is wrong, not the path of the request."""
    try:
        yield
    except NotFoundError as error:
        raise ParameterError.at(
            place, detail, "Check the id; the file may have been deleted or have expired."
        ) from error


async def take_along(app: AppState, owner_id: str, submission: Submission) -> Submission:
    """Return a submission whose files have come with it: those that its document held, or named by a URL, as well."""
    files = dict(submission.files)
    for name, (source, place) in submission.document.sources.items():
        path = submission.folder / name
        if isinstance(source, PreviewSource) and source.sha256 is not None:
            files[name] = app.kept_assets.fetch(owner_id, source.sha256, path)
            continue
        if source.url is None:
            files[name] = await to_thread.run_sync(_decode, source, place, path)
            continue
        if not app.settings.fetch_assets:
            raise AssetNotFetchedError("This server does not fetch assets from URLs (MESHDEFORM_FETCH_ASSETS).")
        destination = await _find(app, owner_id, source.url)
        files[name] = await to_thread.run_sync(
            _fetch, destination, source.filename, path, app.settings.max_upload_bytes
        )
    return Submission(submission.document.without(submission.document.sources), files, submission.folder)


def _decode(source: FileSource, place: list[str], path: Path) -> ReceivedFile:
    text = source.data or ""
    if text.startswith("data:"):
        text = text.partition(",")[2]
    try:
        data = base64.b64decode("".join(text.split()), validate=True)
    except (binascii.Error, ValueError) as error:
        raise ParameterError.at([*place, "data"], "The text is not base64.", "Encode the file's bytes.") from error
    path.write_bytes(data)
    return ReceivedFile(path, clean_filename(source.filename), len(data), hashlib.sha256(data).hexdigest())


async def _find(app: AppState, owner_id: str, url: str) -> Destination:
    networks = parse_networks(app.settings.fetch_networks)
    future = app.lookups.submit(owner_id, lambda: find_destination(url, networks))
    try:
        with anyio.fail_after(LOOKUP_S):
            return await asyncio.wrap_future(future)
    except WebhookAddressError as error:
        raise AssetNotFetchedError(error.detail) from error
    except TimeoutError as error:
        raise AssetNotFetchedError(f"The URL's host could not be resolved within {LOOKUP_S:g} s.") from error


def _fetch(destination: Destination, filename: str, path: Path, max_bytes: int) -> ReceivedFile:
    import httpcore

    from meshdeform.webhooks.sender import CONNECT_S, PinnedNetwork, network_error

    network = PinnedNetwork(destination.addresses, CONNECT_S, time.monotonic() + MAX_FETCH_S)
    url = httpcore.URL(
        scheme=destination.url.raw_scheme,
        host=destination.host.encode("ascii"),
        port=destination.url.port,
        target=destination.url.raw_path,
    )
    headers = [
        ("Host", destination.url.netloc.decode("ascii")),
        ("User-Agent", f"Meshdeform/{__version__}"),
        ("Accept-Encoding", "identity"),
    ]
    timeouts = {"timeout": dict.fromkeys(("connect", "read", "write", "pool"), MAX_FETCH_S)}
    try:
        with (
            httpcore.ConnectionPool(ssl_context=_tls(), network_backend=network, http2=False) as pool,
            pool.stream("GET", url, headers=headers, extensions=timeouts) as answer,
        ):
            _check_answer(answer)
            size, sha256 = _write(answer, path, max_bytes)
    except httpcore.TimeoutException as error:
        raise AssetNotFetchedError(f"The file did not arrive within {MAX_FETCH_S:g} s.") from error
    except httpcore.ProtocolError as error:
        raise AssetNotFetchedError("The answer is not HTTP, or was cut off.") from error
    except (httpcore.NetworkError, OSError) as error:
        raise AssetNotFetchedError(network_error(error, "host")) from error
    name = filename or unquote(destination.url.path)
    return ReceivedFile(path, clean_filename(name), size, sha256)


def _check_answer(answer: httpcore.Response) -> None:
    if 300 <= answer.status < 400:
        raise AssetNotFetchedError(f"The host answered {answer.status}; redirects are not followed.")
    if answer.status != 200:
        raise AssetNotFetchedError(f"The host answered {answer.status}.")
    coding = next((value for name, value in answer.headers if name.lower() == b"content-encoding"), b"identity")
    if coding.strip().lower() != b"identity":
        raise AssetNotFetchedError("The host answered with a compressed body, which was not asked for.")


def _write(answer: httpcore.Response, path: Path, max_bytes: int) -> tuple[int, str]:
    size, digest = 0, hashlib.sha256()
    with path.open("wb") as file:
        for chunk in answer.iter_stream():
            size += len(chunk)
            if size > max_bytes:
                raise AssetTooLargeError.more_than(max_bytes, "The file at the URL has")
            digest.update(chunk)
            file.write(chunk)
    return size, digest.hexdigest()


@lru_cache
def _tls() -> ssl.SSLContext:
    import httpx

    return httpx.create_ssl_context()
