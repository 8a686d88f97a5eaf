"""Take in the files that a document holds as base64, or that it names by a URL on the public internet.

A URL is fetched from the checked addresses of its host alone, without redirects, within the upload limit and half a
minute. Files are taken in before an idempotency key is claimed, so that the request's hash covers their bytes.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
import hashlib
import time
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote

import anyio
from anyio import to_thread

from meshdeform import __version__
from meshdeform.api.limits import MAX_FETCH_S
from meshdeform.errors import AssetNotFetchedError, AssetTooLargeError, ParameterError, WebhookAddressError
from meshdeform.webhooks.addresses import Destination, find_destination, parse_networks
from meshdeform.webhooks.lookups import LOOKUP_S
from service.http.bodies import ReceivedFile, clean_filename
from service.jobs.documents import FileSource
from service.jobs.sources import Submission
from service.state import AppState

if TYPE_CHECKING:
    import ssl

    import httpcore

__all__ = ["take_along"]


async def take_along(app: AppState, owner_id: str, submission: Submission) -> Submission:
    """Return a submission whose files have come with it: those that its document held, or named by a URL, as well.

    Raises
    ------
    AssetNotFetchedError
        A URL may not be fetched, or does not answer with the file.
    AssetTooLargeError
        A file is larger than an upload may be.
    ParameterError
        A text is not base64.
    """
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
                raise AssetTooLargeError(
                    f"The file at the URL has more than {max_bytes} bytes (MESHDEFORM_MAX_UPLOAD_BYTES).",
                    limit=max_bytes,
                )
            digest.update(chunk)
            file.write(chunk)
    return size, digest.hexdigest()


@lru_cache
def _tls() -> ssl.SSLContext:
    import httpx

    return httpx.create_ssl_context()
