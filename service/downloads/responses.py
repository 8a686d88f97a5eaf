"""Stored bytes as answers: whole or one range, with a tag that tells versions apart, and URLs that need no API key."""

from __future__ import annotations

import base64
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
from meshdeform.errors import NotFoundError, RangeError
from meshdeform.record.models import Artifact
from meshdeform.storage import sign_path, verify_path
from service.documentation.responses import CALLER_ERRORS
from service.http.auth import principal
from service.http.errors import problem_responses
from service.http.ranges import matches, requested_range
from service.state import AppState, AppStateDep

__all__ = [
    "OPEN_TO_SIGNED",
    "Conditions",
    "ConditionsDep",
    "Download",
    "ReaderDep",
    "download",
    "download_responses",
    "signed_url",
]

_CHUNK = 256 * 1024
_KEY_NAME = "signed-urls"
_LONGEST_S = 7 * 86_400  # of a bucket's own signatures
_PLAIN = frozenset(string.ascii_letters + string.digits + " !#$&'()+,-.;=@[]^_`{}~")
_TAG = '"9f86d081884c7d65..."'
_HEADERS = {
    name: {"description": description, "schema": {"type": "string"}, "example": example}
    for name, description, example in (
        ("ETag", "SHA-256 of all the bytes.", _TAG),
        ("Accept-Ranges", "Parts can be asked for.", "bytes"),
        ("Content-Disposition", "The name to save it under.", 'attachment; filename="result.glb"'),
    )
}
_CONTENT_RANGE = {
    "Content-Range": {
        "description": "Which bytes of how many.",
        "schema": {"type": "string"},
        "example": "bytes 0-1023/30720",
    }
}


def download_responses(media_types: str) -> dict[int | str, dict[str, Any]]:
    """Return the OpenAPI description of a download's responses.

    Code generators would parse bytes as JSON if one of several media types were JSON, so the document has a single one.

    Parameters
    ----------
    media_types : str
        A sentence about the `Content-Type` that is sent.
    """
    content = {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}
    return {
        200: {"description": f"The bytes. {media_types}", "content": content, "headers": _HEADERS},
        206: {
            "description": f"The bytes in `Range`. {media_types}",
            "content": content,
            "headers": {**_HEADERS, **_CONTENT_RANGE},
        },
        304: {"description": "You have it: `If-None-Match` names it."},
        **problem_responses(NotFoundError, RangeError, *CALLER_ERRORS),
    }


@dataclass(frozen=True)
class Conditions:
    """What a request says about the bytes that it has and wants."""

    range: str | None = None
    if_range: str | None = None
    if_none_match: str | None = None


def _conditions(
    range_: Annotated[
        str | None,
        Header(
            alias="Range",
            description="One range of bytes. Default: all of them.",
            max_length=200,
            examples=["bytes=1024-"],
        ),
    ] = None,
    if_range: Annotated[
        str | None,
        Header(
            description="The `ETag` that the range belongs to; another one gets the whole. Default: none.",
            max_length=200,
            examples=[_TAG],
        ),
    ] = None,
    if_none_match: Annotated[
        str | None,
        Header(description="The `ETag` of what you have. Default: none.", max_length=1000, examples=[_TAG]),
    ] = None,
) -> Conditions:
    return Conditions(range_, if_range, if_none_match)


ConditionsDep = Annotated[Conditions, Depends(_conditions)]


@dataclass(frozen=True)
class Download:
    """Bytes in the object store, and what to call them."""

    key: str
    name: str
    content_type: str
    size: int
    sha256: str

    @property
    def headers(self) -> dict[str, str]:
        """Headers of every answer that is about them."""
        digest = base64.b64encode(bytes.fromhex(self.sha256)).decode()
        return {
            "ETag": f'"{self.sha256}"',
            "Accept-Ranges": "bytes",
            "Cache-Control": "private, no-cache",
            "Content-Disposition": _disposition(self.name),
            "Repr-Digest": f"sha-256=:{digest}:",
            "X-Content-Type-Options": "nosniff",
        }


def _disposition(name: str) -> str:
    """Return what names the file: in ASCII for everybody, and in full where that is not the same (RFC 6266, RFC 8187).

    Names come from whoever sent the file: nothing in one may end the header's string, or begin another line.
    """
    plain = "".join(letter if letter in _PLAIN else "_" for letter in name) or "file"
    header = f'attachment; filename="{plain}"'
    return header if plain == name else f"{header}; filename*=UTF-8''{quote(name, safe='', errors='replace')}"


def download(request: Request, app: AppState, found: Download, conditions: Conditions) -> Response:
    """Return the answer: the bytes, some of them, or that the client has them.

    Raises
    ------
    RangeError
        The range begins past the end.
    NotFoundError, UnavailableError
        The object store has lost them, or does not answer; told before the first byte.
    """
    headers = found.headers
    if "signature" in request.query_params:
        # Whoever has the URL may read it, so pages of other origins may, too: viewers fetch models that way.
        headers["Access-Control-Allow-Origin"] = "*"
    if matches(conditions.if_none_match, headers["ETag"]):
        return Response(status_code=304, headers=headers)
    part = requested_range(conditions.range, conditions.if_range, headers["ETag"], found.size)
    start, end = (part.start, part.end) if part else (0, found.size)
    headers["Content-Length"] = str(end - start)
    if part:
        headers["Content-Range"] = f"bytes {start}-{end - 1}/{found.size}"
    status = 206 if part else 200
    if request.method == "HEAD":
        return Response(status_code=status, headers=headers, media_type=found.content_type)
    # Opened here: an object that is not there is an error before the first byte.
    content = app.store.stream(found.key, start, end, _CHUNK)
    return StreamingResponse(content, status, headers, found.content_type)


def signed_url(app: AppState, path: str, artifact: Artifact) -> SignedUrl:
    """Return a URL that lets its bearer read an artifact: the bucket's own, or one of this server.

    Parameters
    ----------
    app : AppState
    path : str
        Where this server has it.
    artifact : Artifact
    """
    lifetime_s = min(int(app.settings.signed_url_ttl_s), _LONGEST_S)
    # Before the signature is made, so that it is valid for at least as long as the answer says.
    until = int(time.time()) + lifetime_s
    url = app.store.presign_get(artifact.key, lifetime_s)
    if url is None:
        url = f"{path}?{sign_path('GET', path, until, app.record.secret(_KEY_NAME))}"
    return SignedUrl(url=url, expires_at=datetime.fromtimestamp(until, UTC))


async def _reader(request: Request, app: AppStateDep) -> str | None:
    """Whose bytes a request may read: those of its key's owner, or the one thing that its URL is signed for."""
    query = request.url.query
    if "signature" not in request.query_params and "expires" not in request.query_params:
        return (await principal(request, None)).owner_id
    secret = await to_thread.run_sync(app.record.secret, _KEY_NAME)
    # HEAD is GET without the bytes: who may read may ask how many there are.
    verify_path("GET", request.scope["path"], query, secret)
    return None


ReaderDep = Annotated[str | None, Depends(_reader)]
"""The owner whose bytes may be read; None: anybody's, for the path is signed."""


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
        _parameter("expires", "Of a signed URL: until when it is valid, in seconds since 1970.", "1769864400"),
        _parameter("signature", "Of a signed URL, in place of an API key.", "3b1f"),
    ],
}
"""What OpenAPI says about a route that a signed URL opens, too."""
