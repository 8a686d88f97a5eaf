"""Fetch the files of a job to disk from wherever they are: the request, a URL, an upload, or another job.

A URL is fetched from the checked addresses of its host alone, without redirects, within the upload limit and half a
minute. Such a file, and one that the document holds as base64, is taken in before an idempotency key is claimed, so
that the request's hash covers its bytes.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
import hashlib
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar
from urllib.parse import unquote

import anyio
from anyio import to_thread

from meshdeform import __version__
from meshdeform.api.states import MAX_FETCH_S
from meshdeform.assets.limits import Limits
from meshdeform.errors import (
    AssetNotFetchedError,
    AssetTooLargeError,
    ConflictError,
    NotFoundError,
    ParameterError,
    WebhookAddressError,
)
from meshdeform.requests.document import JobRequest
from meshdeform.runs import kind_of
from meshdeform.webhooks.addresses import LOOKUP_S, Destination, find_destination, parse_networks
from service.http.bodies import ReceivedFile, clean_filename
from service.jobs.documents import FileReference, FileSource, JobDocument
from service.state import AppState

if TYPE_CHECKING:
    import ssl

    import httpcore

_F = TypeVar("_F")


def file_advice(name: str) -> str:
    """Return advice on how to give a job a file."""
    return f"Send the file as the part `{name}`, or name an upload or an artifact in the document: `files.{name}`."


def in_order(request: JobRequest, files: Mapping[str, _F]) -> dict[str, _F]:
    """Return the files of a job in the order of the parts of its kind."""
    return {name: files[name] for name in kind_of(request.kind).parts if name in files}


def missing_files(document: JobDocument, sent: Collection[str]) -> list[str]:
    """Return the names of required files that are neither sent nor named in the document."""
    present = {*sent, *document.references}
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
        with _reported_at(_inside(place, "upload_id"), f"There is no upload {reference.upload_id}."):
            upload = app.record.uploads.get(reference.upload_id, owner=owner_id)
            if upload.key is None or upload.sha256 is None:
                raise ConflictError(
                    f"The upload {upload.id} is not complete.",
                    advice=f"Send the rest of it, then POST /v1/uploads/{upload.id}/complete.",
                )
            app.store.fetch(upload.key, path, sha256=upload.sha256)
        return ReceivedFile(path, upload.filename, upload.size, upload.sha256)
    assert reference.job_id is not None
    with _reported_at(_inside(place, "job_id"), f"There is no job {reference.job_id}."):
        job = app.record.get(reference.job_id, owner=owner_id)
        artifacts = {artifact.name: artifact for artifact in app.record.artifacts(job.id, owner=owner_id)}
    if reference.artifact not in artifacts:
        if not job.state.terminal:
            raise ConflictError(f"The job {job.id} is {job.state}.", advice="Wait until it has succeeded.")
        detail = f"The {job.state} job {job.id} has no such artifact."
        raise ParameterError.at(_inside(place, "artifact"), detail, f"It has: {', '.join(artifacts) or 'none'}.")
    artifact = artifacts[reference.artifact]
    Limits.from_settings(app.settings).check_bytes(artifact.size, "The artifact has")
    with _reported_at(_inside(place, "job_id"), f"There is no job {reference.job_id}."):
        app.store.fetch(artifact.key, path, sha256=artifact.sha256)
    return ReceivedFile(path, artifact.name, artifact.size, artifact.sha256)


def _inside(place: list[str], member: str) -> list[str]:
    """Return the place of a reference's member; a parameter is a name alone."""
    return place if place[0] == "params" else [*place, member]


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
