"""Receive request bodies, with limits on their number, speed and size."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import TypeVar

import anyio
from fastapi import Request
from pydantic import BaseModel, ValidationError
from starlette.requests import ClientDisconnect

from meshdeform.api.limits import IDLE_S, MAX_DOCUMENT_BYTES, MIN_BODY_RATE
from meshdeform.errors import MeshdeformError, PromptError, RequestError, RequestTimeoutError, readable_size
from meshdeform.requests.document import MAX_PROMPT_LENGTH
from meshdeform.requests.groups import in_plain_words
from service.http.errors import parameter_error

# This many bytes must arrive within `IDLE_S`, or the body is abandoned.
_LEAST_BYTES = 64 * 1024

_Document = TypeVar("_Document", bound=BaseModel)


async def body_of(request: Request) -> AsyncIterator[bytes]:
    """Yield the chunks of the body as they arrive."""
    stream = aiter(request.stream())
    recent, deadline = 0, anyio.current_time() + IDLE_S
    total, waited_s = 0, 0.0  # only time that is spent waiting for the sender counts
    while True:
        began = anyio.current_time()
        left_s = IDLE_S + total / MIN_BODY_RATE - waited_s
        try:
            with anyio.fail_after(min(left_s, deadline - began)):
                chunk = await anext(stream)
        except StopAsyncIteration:
            return
        except TimeoutError as error:
            if began + left_s < deadline:
                reason = f"On average, less than {MIN_BODY_RATE} bytes per second of the body arrived."
            else:
                reason = f"In {IDLE_S:g} s, {recent} bytes of the body arrived."
            raise RequestTimeoutError(reason) from error
        except ClientDisconnect as error:
            raise RequestError(
                "The body is shorter than its declared length.", advice="Send the whole body."
            ) from error
        waited_s += anyio.current_time() - began
        recent, total = recent + len(chunk), total + len(chunk)
        if recent >= _LEAST_BYTES:
            recent, deadline = 0, anyio.current_time() + IDLE_S
        yield chunk


async def receive_file(request: Request, path: Path, max_bytes: int, too_large: MeshdeformError) -> None:
    """Write the body to a file, or raise `too_large` if it has more bytes than it may."""
    received = 0
    with path.open("wb") as file:
        async for chunk in body_of(request):
            received += len(chunk)
            if received > max_bytes:
                raise too_large
            file.write(chunk)


async def receive_document(request: Request, max_bytes: int = MAX_DOCUMENT_BYTES) -> bytes:
    """Receive a JSON document and return it unparsed; `RequestError`: its media type is not JSON, or it is too long."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise RequestError(
            "The body's Content-Type is not application/json.",
            advice="Send a JSON document with Content-Type: application/json.",
        )
    received = bytearray()
    async for chunk in body_of(request):
        received += chunk
        if len(received) > max_bytes:
            raise RequestError(f"The document is longer than {readable_size(max_bytes)}.")
    return bytes(received)


def parse_document(model: type[_Document], document: bytes, name: str = "The body") -> _Document:
    """Parse and validate a JSON document, which `name` names in error messages.

    `RequestError`: it is not valid JSON; a subclass lists invalid members.
    """
    try:
        return model.model_validate_json(document)
    except ValidationError as error:
        findings = error.errors(include_url=False)
        if findings[0]["type"] == "json_invalid":
            reason = findings[0]["msg"].removeprefix("Invalid JSON: ")
            raise RequestError(f"{name} is not valid JSON: {reason}.") from error
        if any(finding["loc"] == ("prompt",) and finding["type"] == "string_too_long" for finding in findings):
            raise PromptError(f"The prompt is longer than {MAX_PROMPT_LENGTH} characters.") from error
        raise parameter_error(in_plain_words(findings, model)) from error
