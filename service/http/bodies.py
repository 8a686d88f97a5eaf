"""Request bodies as they come: so many at once, none that trickles, none that is longer than its route takes."""

from __future__ import annotations

import json
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
from service.http.wording import in_plain_words

__all__ = ["body_of", "body_slot", "parse_document", "receive_document"]

_SLOT_WAIT_S = 20.0
# Within `IDLE_S` so many bytes must come: a sender that stands still, or nearly so, does not keep its place.
_LEAST_BYTES = 64 * 1024

_Document = TypeVar("_Document", bound=BaseModel)


@asynccontextmanager
async def body_slot(limiter: CapacityLimiter) -> AsyncIterator[None]:
    """Wait for one of the places; the sender's bytes wait in the connection meanwhile.

    Raises
    ------
    UnavailableError
        None became free in time.
    """
    borrower = object()
    with anyio.move_on_after(_SLOT_WAIT_S) as waiting:
        await limiter.acquire_on_behalf_of(borrower)
    if waiting.cancelled_caught:
        raise UnavailableError(
            f"{int(limiter.total_tokens)} files are being received at the same time.", advice="Try again in a moment."
        )
    try:
        yield
    finally:
        limiter.release_on_behalf_of(borrower)


async def body_of(request: Request) -> AsyncIterator[bytes]:
    """The body's parts as they come.

    Raises
    ------
    RequestTimeoutError
        Nothing came for a minute, or next to nothing.
    RequestError
        The sender went away.
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
            raise RequestTimeoutError(f"In {IDLE_S:g} s there came {came} bytes of the body.") from error
        except ClientDisconnect as error:
            raise RequestError("The body ends before its length says so.", advice="Send the whole body.") from error
        came += len(chunk)
        if came >= _LEAST_BYTES:
            came, deadline = 0, anyio.current_time() + IDLE_S
        yield chunk


async def receive_document(request: Request) -> bytes:
    """Return a body that is a JSON document, unread.

    Raises
    ------
    RequestError
        It says that it is something else, or is too long.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise RequestError(
            "The body is not application/json.", advice="Send a JSON document with Content-Type: application/json."
        )
    received = bytearray()
    async for chunk in body_of(request):
        received += chunk
        if len(received) > MAX_DOCUMENT_BYTES:
            raise RequestError(f"The document is longer than {MAX_DOCUMENT_BYTES} bytes.")
    return bytes(received)


def parse_document(model: type[_Document], document: bytes, name: str = "The body") -> _Document:
    """Read a JSON document.

    Parameters
    ----------
    model : type
    document : bytes
    name : str
        What it is, for the message.

    Raises
    ------
    RequestError
        It is no JSON, or one of its subclasses says which members are wrong.
    """
    try:
        return model.model_validate_json(document)
    except ValidationError as error:
        findings = error.errors(include_url=False, include_input=False, include_context=False)
        if findings[0]["type"] == "json_invalid":
            reason = findings[0]["msg"].removeprefix("Invalid JSON: ")
            raise RequestError(f"{name} is no JSON document: {reason}.") from error
        if any(finding["loc"] == ("prompt",) and finding["type"] == "string_too_long" for finding in findings):
            raise PromptError(f"The prompt is longer than {MAX_PROMPT_LENGTH} characters.") from error
        raise parameter_error(in_plain_words(findings, model, json.loads(document))) from error
