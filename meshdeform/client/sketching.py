"""Provide the methods of the clients that read drawings and make the shapes that they show."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from meshdeform.client.commands import Call, Operation, Work
from meshdeform.client.connections import AsyncConnection, Connection
from meshdeform.client.documents import _Open, read
from meshdeform.client.retries import Policy, answered

__all__ = ["AsyncSketchMethods", "SketchGuess", "SketchGuesses", "SketchMethods", "SketchParameter"]

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
        """The parameters by name, as `params.sketch` takes them."""
        return {each.name: each.value for each in self.parameters}

    @property
    def glb(self) -> bytes:
        """The shape."""
        return base64.b64decode(self.mesh)


class SketchGuesses(_Open):
    """What a drawing may show, the likeliest first."""

    guesses: list[SketchGuess]
    unsure: bool = False


class SketchMethods(Connection):
    """The methods of `Client` about drawings."""

    def guess_sketch(self, drawing: Drawing, *, family: str | None = None) -> SketchGuesses:
        """Guess what a drawing shows: three families with their parameters and a mesh each.

        Parameters
        ----------
        drawing : bytes or path
            A PNG, JPEG or WebP.
        family : str, optional
            What it shows; no other family is considered.

        Raises
        ------
        DrawingError
            The picture is no line drawing.
        ParameterError
            There is no such family.
        DependencyError, UnavailableError
            The service cannot read drawings, or cannot read them now.
        """
        return self._driver.run(_guessed(drawing, family, self._policy))

    def make_sketch_mesh(self, family: str, values: Mapping[str, float | str] | None = None) -> bytes:
        """Return the GLB of a shape of a family; parameters left out have their default.

        Raises
        ------
        ParameterError
            There is no such family, a name is unknown, or a value is out of range.
        """
        return self._driver.run(_shaped(family, values, self._policy))


class AsyncSketchMethods(AsyncConnection):
    """The methods of `AsyncClient` about drawings."""

    async def guess_sketch(self, drawing: Drawing, *, family: str | None = None) -> SketchGuesses:
        """Guess what a drawing shows: three families with their parameters and a mesh each.

        Parameters
        ----------
        drawing : bytes or path
            A PNG, JPEG or WebP.
        family : str, optional
            What it shows; no other family is considered.

        Raises
        ------
        DrawingError
            The picture is no line drawing.
        ParameterError
            There is no such family.
        DependencyError, UnavailableError
            The service cannot read drawings, or cannot read them now.
        """
        return await self._driver.run(_guessed(drawing, family, self._policy))

    async def make_sketch_mesh(self, family: str, values: Mapping[str, float | str] | None = None) -> bytes:
        """Return the GLB of a shape of a family; parameters left out have their default.

        Raises
        ------
        ParameterError
            There is no such family, a name is unknown, or a value is out of range.
        """
        return await self._driver.run(_shaped(family, values, self._policy))


def _guessed(drawing: Drawing, family: str | None, policy: Policy) -> Operation[SketchGuesses]:
    data = drawing if isinstance(drawing, bytes) else (yield Work(partial(Path(drawing).read_bytes)))
    query = {} if family is None else {"family": family}
    headers = {"Content-Type": "application/octet-stream"}
    call = Call("POST", "/v1/sketches:guess", query=query, headers=headers, content=data)
    answer = yield from answered(call, policy)
    return read(SketchGuesses, answer.json(), answer.url)


def _shaped(family: str, values: Mapping[str, float | str] | None, policy: Policy) -> Operation[bytes]:
    call = Call("POST", "/v1/sketches:mesh", document={"family": family, "values": dict(values or {})})
    answer = yield from answered(call, policy)
    return answer.content
