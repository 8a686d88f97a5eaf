"""Receive request bodies, with limits on their number, speed and size."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TypeVar

import anyio
from anyio import CapacityLimiter
from fastapi import Request
from pydantic import BaseModel, ValidationError
from starlette.requests import ClientDisconnect

from meshdeform.api.limits import IDLE_S, MAX_DOCUMENT_BYTES
from meshdeform.errors import PromptError, RequestError, RequestTimeoutError, UnavailableError
from meshdeform.requests.document import MAX_PROMPT_LENGTH
from service.http.errors import parameter_error

__all__ = ["body_of", "body_slot", "parse_document", "receive_document"]

_SLOT_WAIT_S = 20.0
# Bytes that must arrive within `IDLE_S`, so that a stalled sender does not keep its slot.
_LEAST_BYTES = 64 * 1024

_Document = TypeVar("_Document", bound=BaseModel)


@asynccontextmanager
async def body_slot(limiter: CapacityLimiter) -> AsyncIterator[None]:
    """Hold one of the slots for receiving a body. While waiting for one, nothing is read from the connection.

    Raises
    ------
    UnavailableError
        No slot became free in time.
    """
    borrower = object()
    with anyio.move_on_after(_SLOT_WAIT_S) as waiting:
        await limiter.acquire_on_behalf_of(borrower)
    if waiting.cancelled_caught:
        raise UnavailableError(
            f"The server is already receiving {int(limiter.total_tokens)} files.", advice="Try again in a moment."
        )
    try:
        yield
    finally:
        limiter.release_on_behalf_of(borrower)


async def body_of(request: Request) -> AsyncIterator[bytes]:
    """Yield the chunks of the body as they arrive.

    Raises
    ------
    RequestTimeoutError
        Too few bytes arrived within `IDLE_S` seconds.
    RequestError
        The sender disconnected.
    """
    stream = aiter(request.stream())
    came, deadline = 0, anyio.current_time() + IDLE_S
    while True:
        try:
            with anyio.fail_after(deadline - anyio.current_time()):
                chunk = await anext(stream)
        except StopAsyncIteration:
            return
        except TimeoutError as error:
            raise RequestTimeoutError(f"Only {came} bytes of the body arrived in {IDLE_S:g} s.") from error
        except ClientDisconnect as error:
            raise RequestError(
                "The body is shorter than its declared length.", advice="Send the whole body."
            ) from error
        came += len(chunk)
        if came >= _LEAST_BYTES:
            came, deadline = 0, anyio.current_time() + IDLE_S
        yield chunk


async def receive_document(request: Request) -> bytes:
    """Receive a JSON document and return it unparsed.

    Raises
    ------
    RequestError
        Its media type is not JSON, or it is too long.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise RequestError(
            "The body's Content-Type is not application/json.",
            advice="Send a JSON document with Content-Type: application/json.",
        )
    received = bytearray()
    async for chunk in body_of(request):
        received += chunk
        if len(received) > MAX_DOCUMENT_BYTES:
            raise RequestError(f"The document is longer than {MAX_DOCUMENT_BYTES} bytes.")
    return bytes(received)


def parse_document(model: type[_Document], document: bytes, name: str = "The body") -> _Document:
    """Parse and validate a JSON document.

    Parameters
    ----------
    model : type
    document : bytes
    name : str
        Name of the document in error messages.

    Raises
    ------
    RequestError
        The document is not valid JSON; a subclass lists invalid members.
    """
    try:
        return model.model_validate_json(document)
    except ValidationError as error:
        findings = error.errors(include_url=False, include_input=False, include_context=False)
        if findings[0]["type"] == "json_invalid":
            reason = findings[0]["msg"].removeprefix("Invalid JSON: ")
            raise RequestError(f"{name} is not valid JSON: {reason}.") from error
        if any(finding["loc"] == ("prompt",) and finding["type"] == "string_too_long" for finding in findings):
            raise PromptError(f"The prompt is longer than {MAX_PROMPT_LENGTH} characters.") from error
        raise parameter_error(findings) from error
