"""Build httpx requests from calls: addresses, keys, and bodies read from files."""

from __future__ import annotations

import json
import os
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from typing import Any

import anyio
import httpx

from meshdeform._version import __version__
from meshdeform.client.commands import Answer, Call, Piece
from meshdeform.serving.defaults import DEFAULT_URL

__all__ = ["Endpoint"]

_CHUNK = 256 * 1024


@dataclass(frozen=True)
class Endpoint:
    """The address of a service, and the credentials for it.

    Attributes
    ----------
    base_url : str
        Without a trailing slash.
    api_key : str, optional
    timeout_s : float
    """

    base_url: str
    api_key: str | None = field(default=None, repr=False)
    timeout_s: float = 60.0

    @classmethod
    def of(cls, base_url: str | None, api_key: str | None, timeout_s: float) -> Endpoint:
        """Return the endpoint given by the arguments, else by MESHDEFORM_URL and MESHDEFORM_API_KEY.

        Raises
        ------
        ValueError
            The URL is not http or https, the key has characters not allowed in a header, or the time is not positive.
        """
        where = base_url or os.environ.get("MESHDEFORM_URL") or DEFAULT_URL
        try:
            url = httpx.URL(where)
        except httpx.InvalidURL as error:
            raise ValueError(f"The service's address {where!r} is not a URL ({error}).") from None
        if url.scheme not in ("http", "https") or not url.host:
            raise ValueError(f"The service's address {where!r} is not a URL such as {DEFAULT_URL}.")
        key = api_key if api_key is not None else os.environ.get("MESHDEFORM_API_KEY")
        if key and not (key.isascii() and key.isprintable() and " " not in key):
            raise ValueError("The API key has invalid characters: use it as it was created, without a newline.")
        if not timeout_s > 0:
            raise ValueError(f"timeout_s must be above 0, not {timeout_s!r}.")
        return cls(where.rstrip("/"), key or None, timeout_s)

    def request(self, http: httpx.Client | httpx.AsyncClient, call: Call) -> httpx.Request:
        """Return the httpx request for a call."""
        url = call.url if "://" in call.url else self.base_url + call.url
        headers = {"User-Agent": f"meshdeform/{__version__}", **call.headers}
        if self.api_key and not call.signed:
            headers["Authorization"] = f"Bearer {self.api_key}"
        body: dict[str, Any] = {}
        if call.parts:
            files: list[tuple[str, Any]] = [("request", (None, json.dumps(call.document), "application/json"))]
            for part in call.parts:
                part.file.seek(0)
                files.append((part.name, (part.filename, part.file, "application/octet-stream")))
            body = {"files": files}
        elif call.document is not None:
            body = {"json": call.document}
        elif call.content is not None:
            body = {"content": call.content}
        timeout = httpx.Timeout(self.timeout_s, read=call.read_timeout_s or self.timeout_s)
        if call.piece is not None:
            # Not built by the caller's httpx client, whose default headers are for the service, not for a bucket.
            headers |= {"Host": httpx.URL(url).netloc.decode("ascii"), "Content-Length": str(call.piece.size)}
            options = {"timeout": timeout.as_dict()}
            return httpx.Request(call.method, url, headers=headers, stream=_PieceStream(call.piece), extensions=options)
        return http.build_request(
            call.method, url, params=dict(call.query) or None, headers=headers, timeout=timeout, **body
        )

    def answer(self, response: httpx.Response, content: bytes) -> Answer:
        """Return the answer for an httpx response."""
        return Answer(response.status_code, _shown(response.request.url), response.headers, content)


def _shown(url: httpx.URL) -> str:
    """Return a URL for messages, without its query, which is secret in a signed URL."""
    return str(url.copy_with(query=None, userinfo=b""))


class _PieceStream(httpx.SyncByteStream, httpx.AsyncByteStream):
    """A request body that streams a range of a file."""

    def __init__(self, piece: Piece) -> None:
        self._piece = piece

    def _read(self, done: int) -> bytes:
        self._piece.file.seek(self._piece.start + done)
        return self._piece.file.read(min(_CHUNK, self._piece.size - done))

    def __iter__(self) -> Iterator[bytes]:
        done = 0
        while done < self._piece.size and (data := self._read(done)):
            done += len(data)
            yield data

    async def __aiter__(self) -> AsyncIterator[bytes]:
        done = 0
        while done < self._piece.size and (data := await anyio.to_thread.run_sync(self._read, done)):
            done += len(data)
            yield data
