"""Bring the files that a request names itself: by a URL, as base64, or as the asset of a preview that is kept.

A URL is fetched from the checked addresses of its host alone, without redirects, within the upload limit and half a
minute, and no slower than a body may come. Fetches have slots of their own, so that nobody who sends bytes waits for a
slow host.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
import hashlib
import logging
import time
from collections.abc import AsyncIterator, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote

import anyio
from anyio import to_thread

from meshdeform import __version__
from meshdeform.api.limits import MAX_FETCH_S, MIN_BODY_RATE
from meshdeform.errors import (
    AssetNotFetchedError,
    AssetTooLargeError,
    LimitError,
    MeshdeformError,
    ParameterError,
    UnavailableError,
)
from meshdeform.outgoing.addresses import Destination, find_destination, parse_networks
from meshdeform.outgoing.lookups import LOOKUP_S
from meshdeform.record.fetching import FETCHING_S
from meshdeform.record.models import JobError
from service.http.forms import ReceivedFile, clean_filename
from service.http.idempotency import Caller
from service.jobs.documents import FileSource, PreviewSource
from service.jobs.intake import Submission, complete_job
from service.state import AppState

if TYPE_CHECKING:
    import ssl

    import httpcore

_log = logging.getLogger(__name__)

FETCHES_WAITING = 32
"""Files of one owner that wait for a slot."""
_SLOW_AFTER_S = 10.0
"""Seconds for a host to begin; after them the file must come at the least rate of a body."""
_AGAIN_S = 1.0
"""Seconds between two tries while the record or the store is away."""


@dataclass(frozen=True)
class Arrivals:
    """A request whose URLs are being fetched."""

    submission: Submission
    _fetches: dict[str, asyncio.Task[ReceivedFile]]

    async def within(self, seconds: float | None) -> bool:
        """Wait so long, or until all files are there, which this returns; raises why one cannot be fetched."""
        if self._fetches:
            done, waiting = await asyncio.wait(
                self._fetches.values(), timeout=seconds, return_when=asyncio.FIRST_EXCEPTION
            )
            for fetch in done:
                fetch.result()
            return not waiting
        return True

    async def all(self) -> Submission:
        """Return the request with all its files."""
        await self.within(None)
        files = {name: fetch.result() for name, fetch in self._fetches.items()}
        document = self.submission.document.without(self._fetches)
        return replace(self.submission, document=document, files={**self.submission.files, **files})


@asynccontextmanager
async def arriving(app: AppState, owner_id: str, submission: Submission) -> AsyncIterator[Arrivals]:
    """Start to fetch the URLs that a request names; what is not there when the block ends is given up."""
    urls = {name: source.url for name, (source, _) in submission.document.sources.items() if source.url is not None}
    if urls and not app.settings.fetch_assets:
        raise AssetNotFetchedError("This server does not fetch assets from URLs (MESHDEFORM_FETCH_ASSETS).")
    hashes = {name: hashlib.sha256(url.encode()).hexdigest() for name, url in urls.items()}
    sources = {name: submission.document.sources[name][0] for name in urls}
    fetches = {
        name: asyncio.create_task(_fetched(app, owner_id, source, submission.folder / name))
        for name, source in sources.items()
    }
    try:
        yield Arrivals(replace(submission, urls=hashes), fetches)
    finally:
        await _given_up(fetches.values())


async def _given_up(fetches: Iterable[asyncio.Task[ReceivedFile]]) -> None:
    for fetch in fetches:
        fetch.cancel()
    await asyncio.gather(*fetches, return_exceptions=True)


async def with_inline_files(app: AppState, owner_id: str, submission: Submission) -> Submission:
    """Return a request with the files that its document holds, or that are kept of an earlier preview."""
    files = dict(submission.files)
    for name, (source, location) in submission.document.sources.items():
        path = submission.folder / name
        if isinstance(source, PreviewSource) and source.sha256 is not None:
            files[name] = app.kept_assets.fetch(owner_id, source.sha256, path)
        elif source.data is not None:
            files[name] = await to_thread.run_sync(_decode, source, location, path)
    return replace(submission, document=submission.document.without(files), files=files)


def _decode(source: FileSource, location: list[str], path: Path) -> ReceivedFile:
    text = source.data or ""
    if text.startswith("data:"):
        text = text.partition(",")[2]
    try:
        data = base64.b64decode("".join(text.split()), validate=True)
    except (binascii.Error, ValueError) as error:
        raise ParameterError.at([*location, "data"], "The text is not base64.", "Encode the file's bytes.") from error
    path.write_bytes(data)
    return ReceivedFile(path, clean_filename(source.filename), len(data), hashlib.sha256(data).hexdigest())


async def _fetched(app: AppState, owner_id: str, source: FileSource, path: Path) -> ReceivedFile:
    async with app.fetches.slot(owner_id, soon_s=app.fetches.wait_s, most=FETCHES_WAITING):
        destination = await _find(app, owner_id, source.url or "")
        return await _fetch(destination, source.filename, path, app.settings.max_upload_bytes)


async def _find(app: AppState, owner_id: str, url: str) -> Destination:
    networks = parse_networks(app.settings.fetch_networks, "MESHDEFORM_FETCH_NETWORKS")
    future = app.fetch_lookups.submit(owner_id, lambda: find_destination(url, networks, AssetNotFetchedError))
    try:
        with anyio.fail_after(LOOKUP_S):
            return await asyncio.wrap_future(future)
    except TimeoutError as error:
        raise AssetNotFetchedError(f"The URL's host could not be resolved within {LOOKUP_S:g} s.") from error


async def _fetch(destination: Destination, filename: str, path: Path, max_bytes: int) -> ReceivedFile:
    import httpcore

    from meshdeform.outgoing.network import PinnedAsyncNetwork, network_error

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
    network = PinnedAsyncNetwork(destination.addresses)
    try:
        with anyio.fail_after(MAX_FETCH_S):
            async with (
                httpcore.AsyncConnectionPool(ssl_context=_tls(), network_backend=network, http2=False) as pool,
                pool.stream("GET", url, headers=headers) as answer,
            ):
                _check_answer(answer)
                size, sha256 = await _write(answer, path, max_bytes)
    except (TimeoutError, httpcore.TimeoutException) as error:
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


async def _write(answer: httpcore.Response, path: Path, max_bytes: int) -> tuple[int, str]:
    size, digest, began = 0, hashlib.sha256(), time.monotonic()
    chunks: AsyncIterator[bytes] = aiter(answer.aiter_stream())
    with path.open("wb") as file:
        while True:
            left_s = _SLOW_AFTER_S + size / MIN_BODY_RATE - (time.monotonic() - began)
            try:
                with anyio.fail_after(max(0.0, left_s)):
                    chunk = await anext(chunks, None)
            except TimeoutError as error:
                slow = f"After {_SLOW_AFTER_S:g} s the file came at less than {MIN_BODY_RATE} bytes per second."
                raise AssetNotFetchedError(slow) from error
            if chunk is None:
                return size, digest.hexdigest()
            size += len(chunk)
            if size > max_bytes:
                raise AssetTooLargeError.more_than(max_bytes, "The file at the URL has")
            digest.update(chunk)
            file.write(chunk)


@lru_cache
def _tls() -> ssl.SSLContext:
    import httpx

    return httpx.create_ssl_context()


def complete_later(app: AppState, caller: Caller, job_id: str, arrivals: Arrivals, held: AsyncExitStack) -> None:
    """Wait for the files of a job that was accepted early, after its request was answered; then close what is held."""
    late = asyncio.create_task(_completed(app, caller, job_id, arrivals, held))
    app.late.add(late)
    late.add_done_callback(app.late.discard)


async def _completed(app: AppState, caller: Caller, job_id: str, arrivals: Arrivals, held: AsyncExitStack) -> None:
    async with held:
        failure = await _failure(app, caller, job_id, arrivals)
        # Whatever stops: nobody else knows of it. A process that ends cannot wait for the record.
        with anyio.CancelScope(shield=True):
            while failure is not None and not await to_thread.run_sync(_failed, app, job_id, failure):
                if app.waiters.closing:
                    return
                await anyio.sleep(_AGAIN_S)


async def _failure(app: AppState, caller: Caller, job_id: str, arrivals: Arrivals) -> MeshdeformError | None:
    """Complete a job, and return None, or why that cannot be."""
    try:
        with anyio.fail_after(FETCHING_S):
            submission = await arrivals.all()
            while not await _taken_in(app, caller, submission, job_id):
                await anyio.sleep(_AGAIN_S)
    except LimitError as error:
        return AssetNotFetchedError(error.detail)
    except MeshdeformError as error:
        return error
    except TimeoutError:
        return AssetNotFetchedError(f"The file could not be fetched and checked within {FETCHING_S:g} s.")
    except asyncio.CancelledError:
        return AssetNotFetchedError("The server stopped while it fetched the file.", advice="Send the job again.")
    except Exception:
        _log.exception("job %s: its files could not be taken in", job_id)
        return MeshdeformError("An unexpected error occurred while the files were fetched and checked.")
    return None


async def _taken_in(app: AppState, caller: Caller, submission: Submission, job_id: str) -> bool:
    """Complete a job whose files are there; False: the record or the store does not answer."""
    try:
        async with app.bodies.slot(caller.owner_id):
            await app.take_in(caller.owner_id, complete_job, app, caller, submission, job_id)
    except UnavailableError as error:
        _log.warning("job %s: its files wait: %s", job_id, error.detail)
        return False
    return True


def _failed(app: AppState, job_id: str, failure: MeshdeformError) -> bool:
    """Let a job fail; False: the record does not answer."""
    try:
        app.record.fetching.fail(job_id, JobError.of(failure))
    except UnavailableError as error:
        _log.warning("job %s: fails once the record answers: %s", job_id, error.detail)
        return False
    return True


async def give_up_fetching(app: AppState) -> None:
    """Let all jobs fail whose files are still being fetched, when the server stops."""
    for late in list(app.late):
        late.cancel()
    await asyncio.gather(*app.late, return_exceptions=True)
