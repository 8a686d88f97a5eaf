"""The web page: `/`, and its files below `/web/`. They need no API key, the requests that the page makes do."""

from __future__ import annotations

import functools
import json

from fastapi import APIRouter, Request, Response
from starlette.exceptions import HTTPException

from meshdeform.errors import NotFoundError
from meshdeform.requests.document import DeformParams
from service.http.ranges import matches
from service.page.files import PAGE_HEADERS, PageFile, PageFiles, page_file
from service.state import Parts, PartsDep

__all__ = ["router"]

# Not in the OpenAPI document, which is about the API.
router = APIRouter(include_in_schema=False)
_files = PageFiles()
_INDEX = "index.html"
_PARAMETERS = "parameters.json"


@router.head("/")
@router.get("/")
def get_page(request: Request, parts: PartsDep) -> Response:
    """The page itself."""
    found = _find(parts, _INDEX)
    if found is None:
        raise NotFoundError(
            "This installation has no web page.",
            advice="Install meshdeform from a wheel or a complete checkout; the API is described at /docs.",
        )
    return _answer(request, found)


@router.head("/web/{path:path}")
@router.get("/web/{path:path}")
def get_page_file(request: Request, parts: PartsDep, path: str) -> Response:
    """A script, a style, a picture of the page."""
    found = _find(parts, path)
    if found is None:
        raise NotFoundError(f"The page has no file {request.url.path}.", advice="The page itself is at /.")
    return _answer(request, found)


def _find(parts: Parts, path: str) -> PageFile | None:
    if parts.settings.web == "off":
        raise HTTPException(404)
    return _parameters() if path == _PARAMETERS else _files.find(path)


@functools.cache
def _parameters() -> PageFile:
    """The schema of a job's parameters, from which the page makes its form."""
    return page_file(json.dumps(DeformParams.model_json_schema()).encode(), "application/json")


def _answer(request: Request, found: PageFile) -> Response:
    compressed = found.compressed if _takes_gzip(request.headers.get("accept-encoding", "")) else None
    headers = {
        **PAGE_HEADERS,
        # Each form has a tag of its own: strong tags name bytes.
        "ETag": f'"{found.digest}{"-gzip" if compressed else ""}"',
        # Every release may change every file, and a page of two releases does not work: asked for again each time.
        "Cache-Control": "no-cache",
        "Vary": "Accept-Encoding",
    }
    if matches(request.headers.get("if-none-match"), headers["ETag"]):
        return Response(status_code=304, headers=headers)
    content = found.content if compressed is None else compressed
    if compressed is not None:
        headers["Content-Encoding"] = "gzip"
    headers["Content-Length"] = str(len(content))
    return Response(b"" if request.method == "HEAD" else content, 200, headers, found.content_type)


def _takes_gzip(header: str) -> bool:
    """Whether `Accept-Encoding` names gzip, and not to refuse it (RFC 9110, section 12.5.3)."""
    for entry in header.lower().split(","):
        coding, _, weight = entry.partition(";")
        if coding.strip() in ("gzip", "x-gzip"):
            return weight.replace(" ", "") not in ("q=0", "q=0.0", "q=0.00", "q=0.000")
    return False
