"""The one place that makes httpx requests out of calls: addresses, keys, bodies that are read from files."""

from __future__ import annotations

import json
import os
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from typing import Any

import anyio
import httpx

import meshdeform
from meshdeform.client.commands import Answer, Call, Piece
from meshdeform.serving.defaults import DEFAULT_URL

__all__ = ["Endpoint"]

_CHUNK = 256 * 1024


@dataclass(frozen=True)
class Endpoint:
    """A service, and what opens it.

    Attributes
    ----------
    base_url : str
        Without a slash at the end.
    api_key : str, optional
    timeout_s : float
    """

    base_url: str
    api_key: str | None = field(default=None, repr=False)
    timeout_s: float = 60.0

    @classmethod
    def of(cls, base_url: str | None, api_key: str | None, timeout_s: float) -> Endpoint:
        """Return what the arguments say, else the environment: MESHDEFORM_URL, MESHDEFORM_API_KEY.

        Raises
        ------
        ValueError
            No http or https URL; a key with characters that no header can carry; a time that is not positive.
        """
        where = base_url or os.environ.get("MESHDEFORM_URL") or DEFAULT_URL
        try:
            url = httpx.URL(where)
        except httpx.InvalidURL as error:
            raise ValueError(f"The service's address {where!r} is no URL ({error}).") from None
        if url.scheme not in ("http", "https") or not url.host:
            raise ValueError(f"The service's address {where!r} is no URL such as {DEFAULT_URL}.")
        key = api_key if api_key is not None else os.environ.get("MESHDEFORM_API_KEY")
        if key and not (key.isascii() and key.isprintable() and " " not in key):
            raise ValueError("The API key holds characters that no key has: give it as it was made, without a newline.")
        if not timeout_s > 0:
            raise ValueError(f"timeout_s must be above 0, not {timeout_s!r}.")
        return cls(where.rstrip("/"), key or None, timeout_s)

    def request(self, http: httpx.Client | httpx.AsyncClient, call: Call) -> httpx.Request:
        """Return the request that a call means."""
        url = call.url if "://" in call.url else self.base_url + call.url
        headers = {"User-Agent": f"meshdeform/{meshdeform.__version__}", **call.headers}
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
        timeout = httpx.Timeout(self.timeout_s, read=call.read_timeout_s or self.timeout_s)
        if call.piece is not None:
            # Made by itself: what the caller's httpx client adds to each request is for the service, not for a bucket.
            headers |= {"Host": httpx.URL(url).netloc.decode("ascii"), "Content-Length": str(call.piece.size)}
            told = {"timeout": timeout.as_dict()}
            return httpx.Request(call.method, url, headers=headers, stream=_PieceStream(call.piece), extensions=told)
        return http.build_request(
            call.method, url, params=dict(call.query) or None, headers=headers, timeout=timeout, **body
        )

    def answer(self, response: httpx.Response, content: bytes) -> Answer:
        """Return what came back."""
        return Answer(response.status_code, _shown(response.request.url), response.headers, content)


def _shown(url: httpx.URL) -> str:
    """A URL as messages tell it: the query of a signed one is a permission."""
    return str(url.copy_with(query=None, userinfo=b""))


class _PieceStream(httpx.SyncByteStream, httpx.AsyncByteStream):
    """Part of a file, a little at a time."""

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
