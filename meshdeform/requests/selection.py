"""Select parts of an asset's surface, for all that a request says of parts: rigid ones, regions, handles, landmarks.

Torch-free.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, StrictInt, StringConstraints, WithJsonSchema, model_validator

from meshdeform.errors import ParameterError
from meshdeform.requests.choices import RegionAction, Rigidity
from meshdeform.requests.declaration import StrictModel

MAX_HANDLES = 64
MAX_LANDMARKS = 256
MAX_SELECTORS = 64
MAX_PART_NAME = 40
_MAX_NAME = 200
_MAX_FACE_RANGES = 20_000
_LISTED = 12

Name = Annotated[str, StringConstraints(strict=True, min_length=1, max_length=_MAX_NAME)]
Number = Annotated[StrictInt, Field(ge=0)]
Part = Name | Number
"""A name, or an index in the file."""

_Share = Annotated[float, Field(ge=0.0, le=1.0)]
_MOST = 1e30
_Coordinate = Annotated[float, Field(ge=-_MOST, le=_MOST)]
"""A number of which float64 can hold the square, and the square's sums."""
_Length = Annotated[float, Field(gt=0.0)]
_SELECTORS = ("node", "mesh", "material", "component", "joint", "color", "box", "sphere", "capsule", "faces")
_NAMED = {"node": "nodes", "mesh": "mesh_names", "material": "materials", "joint": "joints"}
"""The members that name something, and where an asset's summary lists it."""
List = Literal["rigid", "regions"] | tuple[str | int, ...]
"""A parameter that is a list of selections, or the path to one within a parameter."""


def _row(count: int, kind: str = "number", **bounds: float) -> WithJsonSchema:
    """Describe equal numbers as an array of items, since many generators of clients cannot read tuples."""
    return WithJsonSchema({"type": "array", "items": {"type": kind, **bounds}, "minItems": count, "maxItems": count})


Point = Annotated[tuple[_Coordinate, _Coordinate, _Coordinate], _row(3, minimum=-_MOST, maximum=_MOST)]
"""Coordinates in the file's world."""

_Range = Annotated[tuple[Number, Number], _row(2, "integer", minimum=0)]
_Color = Annotated[tuple[_Share, _Share, _Share], _row(3, minimum=0.0, maximum=1.0)]


class JointParams(StrictModel):
    """The faces that follow joints of a skin; several joints of one name count together."""

    name: Name | Number = Field(description="The joint's name, or its index among the nodes.", examples=["Head"])
    above: float = Field(
        0.5, ge=0.0, lt=1.0, description="A face is selected if all its corners have more weight.", examples=[0.5]
    )


class ColorParams(StrictModel):
    """The faces of a vertex colour."""

    rgb: _Color = Field(description="Linear red, green and blue, 0 to 1, as in the file.", examples=[[1.0, 0.0, 0.0]])
    within: float = Field(
        0.1, ge=0.0, le=2.0, description="Greatest distance from it, at all corners of a face.", examples=[0.1]
    )


class BoxParams(StrictModel):
    """The faces within a box."""

    min: Point = Field(description="Its least coordinates.", examples=[[-1.0, 0.0, -1.0]])
    max: Point = Field(description="Its greatest coordinates.", examples=[[1.0, 2.0, 1.0]])

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if any(low > high for low, high in zip(self.min, self.max, strict=True)):
            raise ValueError("min must not be greater than max along any axis")
        return self


class SphereParams(StrictModel):
    """The faces within a sphere."""

    center: Point = Field(description="Its centre.", examples=[[0.0, 1.5, 0.0]])
    radius: _Length = Field(description="Its radius.", examples=[0.4])


class CapsuleParams(StrictModel):
    """The faces within a distance of a line."""

    start: Point = Field(description="One end of the line.", examples=[[0.0, 0.0, 0.0]])
    end: Point = Field(description="The other end.", examples=[[0.0, 1.0, 0.0]])
    radius: _Length = Field(description="The distance.", examples=[0.2])


class SelectionParams(StrictModel):
    """A part of the surface; exactly one of the members that say where is set.

    Coordinates are those of the file in world space, with +Y up, as `meshdeform inspect` lists them.
    """

    node: Name | Number | None = Field(
        None,
        description="The node with all nodes below it: its name (a node without a name has that of its mesh), or its "
        "index in the file.",
        examples=["wheel-front-left"],
    )
    mesh: Name | Number | None = Field(
        None, description="Every instance of this mesh: its name, or its index in the file.", examples=["Door"]
    )
    material: Name | Number | None = Field(
        None, description="Everything with this material: its name, or its index in the file.", examples=["wheels"]
    )
    component: Number | None = Field(
        None, description="The connected component with this number, as `meshdeform inspect` lists it.", examples=[3]
    )
    joint: JointParams | None = Field(
        None, description="Vertices of a joint, such as a vertex group.", examples=[{"name": "Head", "above": 0.5}]
    )
    color: ColorParams | None = Field(
        None, description="Vertices of a colour.", examples=[{"rgb": [1.0, 0.0, 0.0], "within": 0.1}]
    )
    box: BoxParams | None = Field(
        None,
        description="Vertices within a box.",
        examples=[{"min": [-1.0, 0.0, -1.0], "max": [1.0, 2.0, 1.0]}],
    )
    sphere: SphereParams | None = Field(
        None, description="Vertices within a sphere.", examples=[{"center": [0.0, 1.5, 0.0], "radius": 0.4}]
    )
    capsule: CapsuleParams | None = Field(
        None,
        description="Vertices near a line.",
        examples=[{"start": [0.0, 0.0, 0.0], "end": [0.0, 1.0, 0.0], "radius": 0.2}],
    )
    faces: tuple[Number | _Range, ...] | None = Field(
        None,
        min_length=1,
        max_length=_MAX_FACE_RANGES,
        description="Triangles by their number: that in the file if it has one mesh, otherwise counted through all "
        "mesh instances in the order of the scene. A pair is a range with both ends.",
        examples=[[0, 7, [100, 199]]],
    )

    @model_validator(mode="after")
    def _one_selector(self) -> Self:
        if sum(getattr(self, name) is not None for name in _SELECTORS) != 1:
            raise ValueError(f"exactly one of {', '.join(_SELECTORS)} is required")
        return self

    @property
    def where(self) -> tuple[str, Any]:
        """The member that says where, and its value."""
        return next((name, value) for name in _SELECTORS if (value := getattr(self, name)) is not None)

    @property
    def named(self) -> tuple[str, str | int] | None:
        """The kind of what the selection names, and the name or index; None if it names nothing."""
        what, value = self.where
        if what not in _NAMED:
            return None
        return what, value.name if isinstance(value, JointParams) else value


class RigidParams(SelectionParams):
    """A selection of what keeps its shape; exactly one of the members that say where is set."""

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


class RegionParams(SelectionParams):
    """A part of the surface and what happens to it; exactly one of the members that say where is set."""

    action: RegionAction = Field(
        RegionAction.KEEP,
        description="`keep`: its vertices do not move at all; `only`: nothing else moves. With several regions, what "
        "moves is in one with `only`, if there are any, and in none with `keep`.",
        examples=["keep"],
    )


def _is_part_name(name: str) -> str:
    if not name[0].isalnum() or not all(letter.isalnum() or letter in " -_" for letter in name):
        raise ValueError("the name of a part has letters, digits, spaces, - and _, and begins with a letter or a digit")
    return name.lower()


PartName = Annotated[
    str,
    StringConstraints(strict=True, strip_whitespace=True, min_length=1, max_length=MAX_PART_NAME),
    AfterValidator(_is_part_name),
]
"""The name of a part, as sentences have it, in lower case."""


class PartParams(SelectionParams):
    """What is a part of the asset; exactly one of `parts` and of the members that say where is set."""

    name: PartName = Field(
        description="Its name, as sentences have it: letters, digits, spaces, - and _. An entry by its place adds to "
        "others of the same name.",
        examples=["ears"],
    )
    parts: tuple[PartName, ...] | None = Field(
        None,
        min_length=1,
        max_length=MAX_SELECTORS,
        description="The names under which it was found: one, which is renamed, or several, which are joined.",
        examples=[["horns", "crest"]],
    )

    @model_validator(mode="after")
    def _one_selector(self) -> Self:
        selectors = (*_SELECTORS, "parts")
        if sum(getattr(self, name) is not None for name in selectors) != 1:
            raise ValueError(f"exactly one of {', '.join(selectors)} is required")
        return self

    @property
    def named(self) -> tuple[str, str | int] | None:
        """As of any selection; None of one that renames."""
        return super().named if self.parts is None else None


class HandleParams(StrictModel):
    """A point of the surface that goes to a place; exactly one of `vertex` and `position` is set."""

    vertex: Number | None = Field(
        None,
        description="A vertex by its number: that in the file if it has one mesh, otherwise counted through all mesh "
        "instances.",
        examples=[12],
    )
    position: Point | None = Field(
        None, description="The point of the surface that is nearest to this place.", examples=[[0.0, 1.0, 0.0]]
    )
    to: Point = Field(description="Where the point goes.", examples=[[0.0, 1.5, 0.0]])
    weight: float = Field(
        1.0,
        gt=0.0,
        le=1.0,
        description="1: the point is exactly there. Less: a soft handle, which goes this share of the way from where "
        "the surface would be without it.",
        examples=[1.0],
    )

    @model_validator(mode="after")
    def _one_point(self) -> Self:
        if (self.vertex is None) == (self.position is None):
            raise ValueError("exactly one of vertex and position is required")
        return self


Place = Annotated[StrictInt, Field(ge=0)] | Point


class LandmarkParams(StrictModel):
    """A point of the asset, and the place on the target to which it goes."""

    source: Place = Field(
        description="A point of the asset: the index of a vertex, counted through the file as `meshdeform inspect` "
        "counts vertices, or a position [x, y, z] in the file's world, for which the nearest point of the surface is "
        "taken.",
        examples=[[0.0, 1.2, 0.4]],
    )
    target: Place = Field(
        description="Its place on the target: the index of a vertex, or a position in the target file's own world.",
        examples=[[0.1, 0.9, 0.5]],
    )


def find_parts(path: List, number: int, selection: SelectionParams, parts: Sequence[Mapping[str, Any]]) -> list[int]:
    """Return the indices of what a selection names.

    `path`: name of the list in `params`, or the path to it there; `number`: its number in the list;
    `selection`: one that names something; `parts`: everything of that kind in the asset, each with `index` and `name`.
    """
    what, reference = selection.named or selection.where
    matching = _matching(reference, parts)
    if matching:
        return matching
    raise refuse_selection(path, number, what, _missing(what, reference), _nearest(what, reference, parts))


def find_excluded(exclude: Sequence[str | int], nodes: Sequence[Mapping[str, Any]]) -> list[int]:
    """Return the indices of the nodes that `params.control.exclude` names.

    `nodes`: all nodes, each with `index` and `name`.
    """
    numbers: list[int] = []
    for number, reference in enumerate(exclude):
        matching = _matching(reference, nodes)
        if not matching:
            detail = f"params.control.exclude: {_missing('node', reference)}"
            raise ParameterError.at(
                ["params", "control", "exclude", number], detail, _nearest("node", reference, nodes)
            )
        numbers += matching
    return numbers


def _matching(reference: str | int, parts: Sequence[Mapping[str, Any]]) -> list[int]:
    member = "index" if isinstance(reference, int) else "name"
    return [part["index"] for part in parts if part[member] == reference]


def check_selections(
    path: List,
    selections: Sequence[SelectionParams],
    named: Mapping[str, Sequence[Mapping[str, Any]]],
    triangles: int | None = None,
) -> None:
    """Refuse selections of what the asset does not have; the geometry is looked at when the run starts.

    `path`: name of the list in `params`, or the path to it there. `named`: lists of what can be named: `nodes`,
    `mesh_names`, `materials` and `joints`. A missing list is not checked. `triangles`: the asset's triangles, if known.
    """
    for number, selection in enumerate(selections):
        if selection.named is not None and (parts := named.get(_NAMED[selection.named[0]])) is not None:
            find_parts(path, number, selection, parts)
        if triangles is not None and selection.faces is not None:
            check_faces(path, number, selection.faces, triangles)


def check_faces(path: List, number: int, faces: Sequence[int | tuple[int, int]], count: int) -> None:
    """Refuse numbers of triangles that an asset of `count` triangles does not have."""
    for item in faces:
        first, last = item if isinstance(item, tuple) else (item, item)
        if last >= count or first > last:
            detail = f"the asset has no triangles {first} to {last}." if first != last else f"no triangle {first}."
            raise refuse_selection(path, number, "faces", detail, f"Its triangles are 0 to {count - 1}.")


def refuse_selection(path: List, number: int, what: str, detail: str, advice: str) -> ParameterError:
    """Return the error about one member of one selection."""
    steps = [path] if isinstance(path, str) else list(path)
    message = f"params.{'.'.join(map(str, steps))}: {detail}"
    return ParameterError.at(["params", *steps, number, what], message, advice)


def _missing(what: str, reference: str | int) -> str:
    if isinstance(reference, int):
        return f"the asset deforms no {what} with the index {reference}."
    return f"the asset deforms no {what} named {reference!r}."


def _nearest(what: str, reference: str | int, parts: Sequence[Mapping[str, Any]]) -> str:
    names = list(dict.fromkeys(part["name"] for part in parts if part["name"]))
    close = difflib.get_close_matches(str(reference), names, n=1, cutoff=0.5)
    folded = [name for name in names if name.casefold() == str(reference).casefold()]
    if folded or close:
        return f"Did you mean {(folded or close)[0]!r}?"
    if not parts:
        return f"It has no {what} with triangles; select by another property, such as component or box."
    shown = ", ".join(f"{part['index']} {part['name']!r}" if part["name"] else f"{part['index']}" for part in parts)
    if len(parts) > _LISTED:
        shown = ", ".join(shown.split(", ")[:_LISTED]) + f" and {len(parts) - _LISTED} more"
    return f"It has these, by index and name: {shown}."
