"""Define the commands that the client's logic yields to its driver.

The logic is written once, as generators that yield commands and receive their results. `drivers` executes the commands
with `httpx.Client` or `httpx.AsyncClient`; nothing else differs between the two clients. A command that fails raises
inside the generator, where it was yielded.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from typing import IO, Any, TypeVar

from meshdeform.errors import UnavailableError

__all__ = [
    "Answer",
    "Call",
    "Callback",
    "Command",
    "Emit",
    "Operation",
    "Part",
    "Pause",
    "Piece",
    "Read",
    "Send",
    "Shield",
    "Stream",
    "Work",
]

T = TypeVar("T")


@dataclass(frozen=True)
class Part:
    """A file in a multipart form.

    Attributes
    ----------
    name, filename : str
    file : binary file
        Positioned at its beginning.
    """

    name: str
    filename: str
    file: IO[bytes]


@dataclass(frozen=True)
class Piece:
    """A range of a file that is the whole body of a request.

    Attributes
    ----------
    file : binary file
    start, size : int
    """

    file: IO[bytes]
    start: int
    size: int


@dataclass(frozen=True)
class Call:
    """One HTTP request.

    Attributes
    ----------
    method, url : str
        The URL is absolute or a path of the service.
    query : mapping
    headers : mapping
    document : JSON value, optional
        The body; with `parts`, the form's part `request`.
    parts : tuple of Part
        The files of a form.
    piece : Piece, optional
        The body.
    content : bytes, optional
        The body.
    signed : bool
        Whether the URL is signed; then the API key is not sent.
    read_timeout_s : float, optional
        Seconds to wait for data of the response.
    """

    method: str
    url: str
    query: Mapping[str, str | int] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    document: Any = None
    parts: tuple[Part, ...] = ()
    piece: Piece | None = None
    content: bytes | None = None
    signed: bool = False
    read_timeout_s: float | None = None


@dataclass(frozen=True)
class Answer:
    """An HTTP response. Header names are in lower case; `Read` returns the body of a stream."""

    status: int
    url: str
    headers: Mapping[str, str]
    content: bytes = b""

    @property
    def ok(self) -> bool:
        """Whether the request succeeded."""
        return 200 <= self.status < 300 or self.status == 304

    def json(self) -> Any:
        """Return the JSON document.

        Raises
        ------
        UnavailableError
            The body is not JSON, so that the response is not from the service.
        """
        try:
            return json.loads(self.content)
        except ValueError:
            raise UnavailableError(
                f"{self.url} answered {self.status} without a JSON document.", advice="Check the service's address."
            ) from None


@dataclass(frozen=True)
class Send:
    """Send a request; the result is an `Answer` with its body."""

    call: Call


@dataclass(frozen=True)
class Stream:
    """Send a request, leaving its body for `Read`, and close any previous stream; the result is an `Answer`."""

    call: Call


@dataclass(frozen=True)
class Read:
    """Read the next bytes of the stream, empty at its end."""


@dataclass(frozen=True)
class Pause:
    """Wait for a number of seconds."""

    seconds: float


@dataclass(frozen=True)
class Work:
    """Call a function that may block on the disk; the result is its return value."""

    function: Callable[[], Any]


@dataclass(frozen=True)
class Callback:
    """Call the user's function, and await it if it is asynchronous."""

    function: Callable[[Any], Any]
    value: Any


@dataclass(frozen=True)
class Shield:
    """Complete an operation even if the caller is being canceled, within a number of seconds."""

    operation: Generator[Any, Any, Any]
    seconds: float


@dataclass(frozen=True)
class Emit:
    """Yield the next item of an iteration."""

    item: Any


Command = Send | Stream | Read | Pause | Work | Callback | Shield | Emit
Operation = Generator[Command, Any, T]
