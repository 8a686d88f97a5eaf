"""Read drawings and make the shapes that they show."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from meshdeform.client.commands import Call, Operation, Work
from meshdeform.client.documents import _Open, read
from meshdeform.client.retries import Policy, answered

__all__ = ["Drawing", "SketchGuess", "SketchGuesses", "SketchParameter", "guessed", "shaped"]

Drawing = bytes | str | os.PathLike[str]
"""The bytes of a picture, or its path."""


class SketchParameter(_Open):
    """A parameter of a family of shapes: a number from `minimum` to `maximum`, or one of `options`."""

    name: str
    value: float | str
    default: float | str
    minimum: float | None = None
    maximum: float | None = None
    options: list[str] | None = None


class SketchGuess(_Open):
    """One reading of a drawing; `mesh` is its shape as a GLB in base64."""

    family: str
    probability: float
    parameters: list[SketchParameter]
    mesh: str

    @property
    def values(self) -> dict[str, float | str]:
        """The parameters by name."""
        return {each.name: each.value for each in self.parameters}

    @property
    def glb(self) -> bytes:
        """The shape."""
        return base64.b64decode(self.mesh)


class SketchGuesses(_Open):
    """What a drawing may show, the likeliest first."""

    guesses: list[SketchGuess]
    unsure: bool = False


def guessed(drawing: Drawing, family: str | None, policy: Policy) -> Operation[SketchGuesses]:
    """Guess what a drawing shows; see `Client.guess_sketch`."""
    data = drawing if isinstance(drawing, bytes) else (yield Work(partial(Path(drawing).read_bytes)))
    query = {} if family is None else {"family": family}
    headers = {"Content-Type": "application/octet-stream"}
    call = Call("POST", "/v1/sketches:guess", query=query, headers=headers, content=data)
    answer = yield from answered(call, policy)
    return read(SketchGuesses, answer.json(), answer.url)


def shaped(family: str, values: Mapping[str, float | str] | None, policy: Policy) -> Operation[bytes]:
    """Return the GLB of a shape of a family."""
    call = Call("POST", "/v1/sketches:mesh", document={"family": family, "values": dict(values or {})})
    answer = yield from answered(call, policy)
    return answer.content
