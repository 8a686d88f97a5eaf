"""Describe HTTP requests and responses: paths, addresses, keys, and bodies read from files."""

from __future__ import annotations

import json
import os
from collections.abc import AsyncIterator, Iterator, Mapping
from dataclasses import dataclass, field
from typing import IO, Any
from urllib.parse import quote, urlencode

import anyio
import httpx

from meshdeform._version import __version__
from meshdeform.api.jobs import JobView
from meshdeform.errors import UnavailableError
from meshdeform.serving import DEFAULT_URL

_CHUNK = 256 * 1024


JobLike = str | JobView
"""A job, or its id."""


def identity(job: JobLike) -> str:
    """Return a job's id."""
    job_id = job.id if isinstance(job, JobView) else job
    if not job_id:
        raise ValueError("The job's id is empty.")
    return job_id


def _segment(text: str) -> str:
    """Return a text escaped as one segment of a path."""
    quoted = quote(text, safe="")
    return {".": "%2E", "..": "%2E%2E"}.get(quoted, quoted)


def job_path(job: JobLike, *rest: str | int) -> str:
    """Return the path of a job, or of something below it."""
    return "/".join(["/v1/jobs", *(_segment(str(each)) for each in (identity(job), *rest))])


def word_path(noun: str, *rest: str) -> str:
    """Return the path of a word, or of something below it."""
    if not noun:
        raise ValueError("The word's noun is empty.")
    return "/".join(["/v1/words", *(_segment(each) for each in (noun, *rest))])


def artifact_path(job: JobLike, name: str, strength: float | None = None, pose: str | None = None) -> str:
    """Return the path of an artifact, with the query for another strength or a pose."""
    asked = {"strength": None if strength is None else f"{strength:.10g}", "pose": pose}
    query = urlencode({key: value for key, value in asked.items() if value is not None})
    return job_path(job, "artifacts", name) + (f"?{query}" if query else "")


@dataclass(frozen=True)
class FormFile:
    """A file in a multipart form, positioned at its beginning."""

    name: str
    filename: str
    file: IO[bytes]


@dataclass(frozen=True)
class FileRange:
    """A range of a file, in bytes, that is the whole body of a request."""

    file: IO[bytes]
    start: int
    size: int


@dataclass(frozen=True)
class Call:
    """One HTTP request."""

    method: str
    url: str  # absolute, or a path of the service
    query: Mapping[str, str | int] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    document: Any = None  # the body; with `files`, the form's field `request`
    files: tuple[FormFile, ...] = ()  # the files of a form
    # The body
    piece: FileRange | None = None
    content: bytes | None = None
    signed: bool = False  # whether the URL is signed; then the API key is not sent
    read_timeout_s: float | None = None  # seconds to wait for data of the response


@dataclass(frozen=True)
class Answer:
    """An HTTP response. Header names are in lower case; a stream has its body elsewhere."""

    status: int
    url: str
    headers: Mapping[str, str]
    content: bytes = b""

    @property
    def ok(self) -> bool:
        """Whether the request succeeded."""
        return 200 <= self.status < 300 or self.status == 304

    def json(self) -> Any:
        """Return the JSON document."""
        try:
            return json.loads(self.content)
        except ValueError:
            raise UnavailableError(
                f"{self.url} answered {self.status} without a JSON document.", advice="Check the service's address."
            ) from None


@dataclass(frozen=True)
class Endpoint:
    """The address of a service, without a trailing slash, and the credentials for it."""

    base_url: str
    api_key: str | None = field(default=None, repr=False)
    timeout_s: float = 60.0

    @classmethod
    def of(cls, base_url: str | None, api_key: str | None, timeout_s: float) -> Endpoint:
        """Return the endpoint given by the arguments, else by MESHDEFORM_URL and MESHDEFORM_API_KEY."""
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
        if call.files:
            fields: list[tuple[str, Any]] = [("request", (None, json.dumps(call.document), "application/json"))]
            for file in call.files:
                file.file.seek(0)
                fields.append((file.name, (file.filename, file.file, "application/octet-stream")))
            body = {"files": fields}
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

    def __init__(self, piece: FileRange) -> None:
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
