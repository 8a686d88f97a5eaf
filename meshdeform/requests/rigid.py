"""Select the parts of an asset that keep their shape, by node, material or connected component. Torch-free."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Self

from pydantic import Field, StrictInt, StringConstraints, model_validator

from meshdeform.errors import ParameterError
from meshdeform.requests.choices import Rigidity
from meshdeform.requests.strict import StrictModel

__all__ = ["MAX_SELECTORS", "RigidSelector", "check_selectors", "find_parts", "refuse_selector"]

MAX_SELECTORS = 64
_MAX_NAME = 200
_LISTED = 12

_Name = Annotated[str, StringConstraints(strict=True, min_length=1, max_length=_MAX_NAME)]
_Number = Annotated[StrictInt, Field(ge=0)]
_WHERE = ("node", "material", "component")


class RigidSelector(StrictModel):
    """A selection of what keeps its shape; exactly one of `node`, `material` and `component` is set."""

    node: _Name | _Number | None = Field(
        None,
        description="The node with all nodes below it: its name (a node without a name has that of its mesh), or its "
        "index in the file.",
        examples=["wheel-front-left"],
    )
    material: _Name | _Number | None = Field(
        None, description="Everything with this material: its name, or its index in the file.", examples=["wheels"]
    )
    component: _Number | None = Field(
        None, description="The connected component with this number, as `meshdeform inspect` lists it.", examples=[3]
    )
    mode: Rigidity = Field(
        Rigidity.RIGID,
        description="`rigid`: it moves and turns; `similarity`: it is scaled as well.",
        examples=["similarity"],
    )
    together: bool = Field(
        False,
        description="Hold everything that is selected as one body, for example a tyre and its rim. Otherwise each of "
        "its connected parts is a body of its own.",
        examples=[False],
    )

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        if sum(getattr(self, name) is not None for name in _WHERE) != 1:
            raise ValueError("exactly one of node, material and component is required")
        return self

    @property
    def where(self) -> tuple[str, str | int]:
        """Which of `node`, `material` and `component` is set, and its value."""
        return next((name, value) for name in _WHERE if (value := getattr(self, name)) is not None)


def find_parts(number: int, selector: RigidSelector, parts: Sequence[Mapping[str, Any]]) -> list[int]:
    """Return the indices of the nodes or materials that a selector names.

    Parameters
    ----------
    number : int
        Place of the selector in `params.rigid`.
    selector : RigidSelector
        By node or material.
    parts : sequence of mappings
        All nodes or materials, each with `index` and `name`.

    Raises
    ------
    ParameterError
        There is none; the advice has the nearest name.
    """
    what, wanted = selector.where
    member = "index" if isinstance(wanted, int) else "name"
    found = [part["index"] for part in parts if part[member] == wanted]
    if found:
        return found
    raise refuse_selector(number, what, _missing(what, wanted), _nearest(what, wanted, parts))


def check_selectors(
    selectors: Sequence[RigidSelector], nodes: Sequence[Mapping[str, Any]], materials: Sequence[Mapping[str, Any]]
) -> None:
    """Refuse selectors by node or material that select nothing; components are counted when the run starts.

    Raises
    ------
    ParameterError
        The error names the selector and the nearest name.
    """
    for number, selector in enumerate(selectors):
        if selector.component is None:
            find_parts(number, selector, nodes if selector.node is not None else materials)


def refuse_selector(number: int, what: str, detail: str, advice: str) -> ParameterError:
    """Return the error about one member of one selector."""
    place = {"loc": ["params", "rigid", number, what], "msg": detail, "type": "value_error"}
    return ParameterError(detail, advice=advice, errors=[place])


def _missing(what: str, wanted: str | int) -> str:
    if isinstance(wanted, int):
        return f"params.rigid: the asset deforms no {what} with the index {wanted}."
    return f"params.rigid: the asset deforms no {what} named {wanted!r}."


def _nearest(what: str, wanted: str | int, parts: Sequence[Mapping[str, Any]]) -> str:
    names = list(dict.fromkeys(part["name"] for part in parts if part["name"]))
    close = difflib.get_close_matches(str(wanted), names, n=1, cutoff=0.5)
    folded = [name for name in names if name.casefold() == str(wanted).casefold()]
    if folded or close:
        return f"Did you mean {(folded or close)[0]!r}?"
    if not parts:
        return f"It has no {what} with triangles; select a component."
    shown = ", ".join(f"{part['index']} {part['name']!r}" if part["name"] else f"{part['index']}" for part in parts)
    if len(parts) > _LISTED:
        shown = ", ".join(shown.split(", ")[:_LISTED]) + f" and {len(parts) - _LISTED} more"
    return f"It has these, by index and name: {shown}."
