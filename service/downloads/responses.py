"""Answer with stored bytes, whole or as one range, and sign URLs that need no API key.

Entity tags and byte ranges: RFC 9110, sections 8.8.3, 13.1 and 14.
"""

from __future__ import annotations

import base64
import re
import string
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Annotated, Any
from urllib.parse import quote

from anyio import to_thread
from fastapi import Depends, Header, Request, Response
from fastapi.responses import StreamingResponse

from meshdeform.api.jobs import SignedUrl
from meshdeform.errors import NotFoundError, RangeError, StoredFileError
from meshdeform.record.models import Artifact
from meshdeform.storage import sign_path, verify_path
from service.documentation.responses import BYTES, CALLER_ERRORS, header
from service.http.errors import problem_responses
from service.http.links import SIGNING_KEY, Viewer, lifetime_s, viewer
from service.state import AppState, AppStateDep

_ONE_RANGE = re.compile(r"\s*bytes\s*=\s*([0-9]{0,18})\s*-\s*([0-9]{0,18})\s*", re.IGNORECASE)
_ENTITY_TAG = re.compile(r'(?:W/)?"[^"]*"')
_CHUNK = 256 * 1024
_AT_ONCE = 4 * _CHUNK
"""Bytes of a file that is read as a whole and then sent."""
_LONGEST = 2000
_PLAIN = frozenset(string.ascii_letters + string.digits + " !#$&'()+,-.;=@[]^_`{}~")
_TAG = '"9f86d081884c7d65..."'
_HEADERS = {
    "ETag": header("SHA-256 of the whole file.", _TAG),
    "Accept-Ranges": header("Byte ranges are supported.", "bytes"),
    "Content-Disposition": header("The name to save the file under.", 'attachment; filename="result.glb"'),
    "Meshdeform-Warnings": header("What the file's format cannot hold, if anything.", "Without animations: 2."),
}
_CONTENT_RANGE = {
    "Content-Range": header("The range that is sent, and the size of the whole file.", "bytes 0-1023/30720")
}


@dataclass(frozen=True)
class ByteRange:
    """Bytes [start, end)."""

    start: int
    end: int


def matches(header: str | None, tag: str) -> bool:
    """Return whether `If-None-Match` contains the tag, by weak comparison."""
    if header is None:
        return False
    if header.strip() == "*":
        return True
    return tag.removeprefix("W/") in {tag_of_client.removeprefix("W/") for tag_of_client in _ENTITY_TAG.findall(header)}


def requested_range(header: str | None, if_range: str | None, tag: str, size: int) -> ByteRange | None:
    """Return the requested range, or None for the whole file; `RangeError`: it begins past the end.

    An invalid header, several ranges, and a range of another version (`If-Range`) select the whole file, as the RFC
    says.
    """
    if header is None or (if_range is not None and if_range.strip() != tag):
        return None
    match = _ONE_RANGE.fullmatch(header)
    if match is None or match.groups() == ("", ""):
        return None
    first, last = match.groups()
    if first == "":
        start, end = max(0, size - int(last)), size
    else:
        start, end = int(first), min(size, int(last) + 1) if last else size
        if last and int(last) < start:
            return None
    if start >= size:
        raise RangeError(f"The file has {size} bytes.", size=size)
    return ByteRange(start, end)


def download_responses(media_types: str) -> dict[int | str, dict[str, Any]]:
    """Return the OpenAPI description of a download's responses; `media_types` is a sentence about their `Content-Type`.

    Code generators would parse bytes as JSON if one of several media types were JSON, so the document has a single one.
    """
    return {
        200: {"description": f"The bytes. {media_types}", "content": BYTES, "headers": _HEADERS},
        206: {
            "description": f"The bytes in `Range`. {media_types}",
            "content": BYTES,
            "headers": {**_HEADERS, **_CONTENT_RANGE},
        },
        304: {"description": "Unchanged: `If-None-Match` holds its `ETag`."},
        **problem_responses(NotFoundError, RangeError, StoredFileError, *CALLER_ERRORS),
    }


@dataclass
class Conditions:
    """The conditional headers of a request for bytes."""

    range: Annotated[
        str | None,
        Header(
            alias="Range",
            description="One range of bytes. Default: the whole file.",
            max_length=200,
            examples=["bytes=1024-"],
        ),
    ] = None
    if_range: Annotated[
        str | None,
        Header(
            description="Send the range only if this is still the `ETag`, otherwise the whole file. Default: none.",
            max_length=200,
            examples=[_TAG],
        ),
    ] = None
    if_none_match: Annotated[
        str | None,
        Header(description="The `ETag` of your copy. Default: none.", max_length=1000, examples=[_TAG]),
    ] = None


ConditionsDep = Annotated[Conditions, Depends()]


@dataclass(frozen=True)
class Download:
    """An object in the store, with the name and type to send it under."""

    key: str
    name: str
    content_type: str
    size: int
    sha256: str
    warnings: tuple[str, ...] = ()  # what its format cannot hold

    @property
    def headers(self) -> dict[str, str]:
        """The headers of every answer about this object."""
        digest = base64.b64encode(bytes.fromhex(self.sha256)).decode()
        return {
            "ETag": f'"{self.sha256}"',
            "Accept-Ranges": "bytes",
            "Cache-Control": "private, no-cache",
            "Content-Disposition": _disposition(self.name),
            "Repr-Digest": f"sha-256=:{digest}:",
            "X-Content-Type-Options": "nosniff",
            **({"Meshdeform-Warnings": _ascii(self.warnings)} if self.warnings else {}),
        }


def _ascii(sentences: tuple[str, ...]) -> str:
    """Return sentences as the value of a header, which is ASCII and short."""
    return " ".join(sentences).encode("ascii", "replace").decode()[:_LONGEST]


def _disposition(name: str) -> str:
    """Return Content-Disposition with an ASCII name, and the full name where it differs (RFC 6266, RFC 8187)."""
    # The name comes from the file's sender, so no character of it may end the quoted string or the header.
    plain = "".join(letter if letter in _PLAIN else "_" for letter in name) or "file"
    short = f'attachment; filename="{plain}"'
    return short if plain == name else f"{short}; filename*=UTF-8''{quote(name, safe='', errors='replace')}"


def download(request: Request, app: AppState, file: Download, conditions: Conditions) -> Response:
    """Return the answer to a request for stored bytes: all of them, a range, or 304."""
    headers = file.headers
    if matches(conditions.if_none_match, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    wanted = requested_range(conditions.range, conditions.if_range, headers["ETag"], file.size)
    start, end = (wanted.start, wanted.end) if wanted else (0, file.size)
    headers["Content-Length"] = str(end - start)
    if wanted:
        headers["Content-Range"] = f"bytes {start}-{end - 1}/{file.size}"
    status = 206 if wanted else 200
    if request.method == "HEAD":
        return Response(status_code=status, headers=headers, media_type=file.content_type)
    # Checked and opened before the response starts, so that a missing or cut object still gives an error status.
    if app.store.size(file.key) != file.size:
        raise StoredFileError(f"The stored copy of {file.name!r} has another size than was recorded.")
    if file.size <= _AT_ONCE:
        data = app.store.get(file.key, sha256=file.sha256)
        return Response(data[start:end], status, headers, file.content_type)
    # Twice the reading, but nobody gets a byte of a damaged file, and whoever asks for it a status.
    if app.store.sha256_of(file.key) != file.sha256:
        raise StoredFileError(f"The stored copy of {file.name!r} is damaged ({file.key}).")
    return StreamingResponse(app.store.stream(file.key, start, end, _CHUNK), status, headers, file.content_type)


def signed_url(app: AppState, path: str, artifact: Artifact) -> SignedUrl:
    """Return a URL that grants read access to an artifact: the bucket's own, or that of its path on this server."""
    seconds = lifetime_s(app)
    # Computed before signing, so that the signature is valid for at least as long as the answer says.
    until = int(time.time()) + seconds
    url = app.store.presign_get(artifact.key, seconds)
    if url is None:
        url = f"{path}?{sign_path('GET', path, until, app.record.secret(SIGNING_KEY))}"
    return SignedUrl(url=url, expires_at=datetime.fromtimestamp(until, UTC))


async def _reader(request: Request, app: AppStateDep) -> Viewer:
    """Return who reads an artifact: a caller with its key, the holder of a link, or of a URL for this very path."""
    query = request.url.query
    if "signature" not in request.query_params and "expires" not in request.query_params:
        return await viewer(request, app, None)
    secret = await to_thread.run_sync(app.record.secret, SIGNING_KEY)
    # A signature for GET also allows HEAD.
    verify_path("GET", request.scope["path"], query, secret)
    return Viewer(None)


ReaderDep = Annotated[Viewer, Depends(_reader)]
"""Who reads an artifact. Its owner is None for links and signed paths, which count whoever owns the job."""


def _parameter(name: str, description: str, example: str) -> dict[str, Any]:
    schema = {"type": "string", "maxLength": 64, "examples": [example]}
    return {
        "name": name,
        "in": "query",
        "required": False,
        "description": f"{description} Default: none.",
        "schema": schema,
    }


OPEN_TO_SIGNED: dict[str, Any] = {
    "security": [{"apiKey": []}, {}],
    "parameters": [
        _parameter("expires", "The expiry time of a signed URL, in Unix seconds.", "1769864400"),
        _parameter("signature", "The signature of a signed URL, in place of an API key.", "3b1f"),
    ],
}
"""The OpenAPI description of a route that accepts signed URLs as well as API keys."""
