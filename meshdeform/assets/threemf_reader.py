"""Read 3MF: objects and their components where the build places them, with colours, names and the unit.

The XML is read as a stream, without document types, so that no entity can grow it; what components repeat is counted
before anything is copied. The file is a ZIP under the rules of `archive`.

Source: 3MF Consortium, 3D Manufacturing Format Core Specification 1.3; Materials and Properties Extension 1.2.1;
Production Extension 1.1.2 (`p:path`).
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.archive import Archive
from meshdeform.assets.build import Primitive, linear_color
from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetError, AssetNotFiniteError, AssetTooLargeError, AssetTruncatedError

__all__ = ["UNITS", "read_3mf"]

UNITS = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
"""Metres of each unit."""
_PLURALS = {"inch": "inches", "foot": "feet"}
_MATERIALS = {"basematerials": "base", "colorgroup": "color"}
_UNREAD = ("texture2dgroup", "compositematerials", "multiproperties", "beamlattice", "slicestack", "displacementmesh")
_WHITE = (255, 255, 255, 255)
_Floats = NDArray[np.float64]
_Key = tuple[str, str]
"""The file and the id of an object."""


@dataclass
class _Object:
    name: str = ""
    verts: list[float] = field(default_factory=list)
    faces: list[int] = field(default_factory=list)
    looks: list[tuple[str, str, str, str]] = field(default_factory=list)  # group and entry of each corner, by triangle
    components: list[tuple[_Key, _Floats]] = field(default_factory=list)


@dataclass
class _Model:
    """What the models of a 3MF hold."""

    unit: str = "millimeter"
    objects: dict[_Key, _Object] = field(default_factory=dict)
    colors: dict[_Key, list[tuple[str, tuple[int, ...]]]] = field(default_factory=dict)  # name and sRGB of entries
    build: list[tuple[_Key, _Floats]] = field(default_factory=list)
    unread: dict[str, None] = field(default_factory=dict)


def read_3mf(archive: Archive, limits: Limits) -> tuple[list[Primitive], tuple[str, ...], float]:
    """Read what a 3MF builds: a primitive for each mesh of each item, sentences about it, and metres of its unit."""
    model, paths = _Model(), [archive.main]
    for path in paths:  # grows while it is read
        data = archive.files.get(path)
        if data is None:
            raise AssetTruncatedError(f"The 3MF has no file {path[:100]!r}, which it names.")
        _Reader(model, path, limits).read(data)
        named = [key for each in model.objects.values() for key, _ in each.components] + [key for key, _ in model.build]
        paths += [other for other in dict.fromkeys(other for other, _ in named) if other not in paths]
    _check_counts(model, limits)
    primitives = [
        _primitive(model, key, matrix)
        for item, placed in model.build
        for key, matrix in _placed(model, item, placed)
        if model.objects[key].faces
    ]
    unit = model.unit if model.unit in UNITS else "millimeter"
    lengths = _PLURALS.get(unit, f"{unit}s")
    notices = [f"Lengths of the 3MF are in {lengths}, with +Z up. The result has the same numbers and axes."]
    if model.unread:
        notices.append(f"Of the 3MF, these were left out: {', '.join(model.unread)}.")
    return primitives, tuple(notices), UNITS[unit]


class _Reader:
    """Reads one model of a 3MF as a stream."""

    def __init__(self, model: _Model, path: str, limits: Limits) -> None:
        self._model, self._path, self._limits = model, path, limits
        self._object, self._default = _Object(), ("", "")
        self._group: list[tuple[str, tuple[int, ...]]] = []
        self._read: dict[str, Callable[[dict[str, str]], None]] = {
            "model": self._on_model,
            "object": self._on_object,
            "vertex": self._on_vertex,
            "triangle": self._on_triangle,
            "component": lambda given: self._object.components.append(self._component(given)),
            "item": lambda given: self._model.build.append(self._component(given)),
            "base": lambda given: self._group.append((given.get("name", ""), _color(given.get("displaycolor", "")))),
            "color": lambda given: self._group.append(("", _color(given.get("color", "")))),
            **dict.fromkeys(_MATERIALS, self._on_group),
        }

    def read(self, data: bytes) -> None:
        """Read a model. Raises AssetError: it is not valid XML, or has a number that cannot be read."""
        parser = expat.ParserCreate()
        parser.StartElementHandler = self._start
        parser.StartDoctypeDeclHandler = self._refuse
        try:
            parser.Parse(data, True)
        except expat.ExpatError as error:
            raise AssetTruncatedError(f"The model of the 3MF is no XML: {error}.") from error
        except (KeyError, ValueError, IndexError) as error:
            line = parser.CurrentLineNumber
            raise AssetError(f"Line {line} of {self._path[:100]} cannot be read: {str(error)[:80]}.") from error

    def _start(self, name: str, given: dict[str, str]) -> None:
        name = name.rpartition(":")[2]
        if name in self._read:
            self._read[name](given)
        elif name in _UNREAD:
            self._model.unread[name] = None

    def _refuse(self, *_: Any) -> None:
        raise AssetError("The model of the 3MF has a document type, which may grow without end.")

    def _on_model(self, given: dict[str, str]) -> None:
        if not self._model.objects:
            self._model.unit = given.get("unit", "millimeter")

    def _on_group(self, given: dict[str, str]) -> None:
        self._group = self._model.colors.setdefault((self._path, given["id"]), [])

    def _on_object(self, given: dict[str, str]) -> None:
        self._object = self._model.objects[self._path, given["id"]] = _Object(given.get("name", ""))
        self._default = given.get("pid", ""), given.get("pindex", "0")

    def _on_vertex(self, given: dict[str, str]) -> None:
        self._object.verts += float(given["x"]), float(given["y"]), float(given["z"])
        if len(self._object.verts) > 3 * self._limits.max_vertices:
            raise AssetTooLargeError(f"The file has more than {self._limits.max_vertices} vertices.")

    def _on_triangle(self, given: dict[str, str]) -> None:
        self._object.faces += int(given["v1"]), int(given["v2"]), int(given["v3"])
        group, entry = self._default
        if "pid" in given or "p1" in given:
            group, entry = given.get("pid", group), given.get("p1", entry)
        self._object.looks.append((group, entry, given.get("p2", entry), given.get("p3", entry)))
        if len(self._object.faces) > 3 * self._limits.max_triangles:
            raise _too_many(self._limits)

    def _component(self, given: dict[str, str]) -> tuple[_Key, _Floats]:
        path = next((value for key, value in given.items() if key.rpartition(":")[2] == "path"), "")
        path = posixpath.normpath(path.lstrip("/")) if path else self._path
        numbers = np.array([float(word) for word in given.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0").split()])
        if not np.isfinite(numbers).all():
            raise ValueError("a transform is not finite")
        return (path, given["objectid"]), numbers.reshape(4, 3)


def _too_many(limits: Limits) -> AssetTooLargeError:
    return AssetTooLargeError(
        f"The file has more than {limits.max_triangles} triangles; that is the limit (MESHDEFORM_MAX_TRIANGLES)."
    )


def _check_counts(model: _Model, limits: Limits) -> None:
    """Refuse more triangles or instances than a scene may have, objects that are not there, and those in themselves."""
    counts: dict[_Key, tuple[int, int] | None] = {}

    def count(key: _Key, depth: int = 0) -> tuple[int, int]:
        if key not in model.objects:
            raise AssetError(f"The 3MF has no object {key[1][:40]!r}, which it names.")
        if key in counts:
            known = counts[key]
            if known is None or depth > limits.max_json_depth:
                raise AssetError(f"Object {key[1][:40]!r} of the 3MF is a component of itself.")
            return known
        counts[key] = None
        each = model.objects[key]
        below = [count(component, depth + 1) for component, _ in each.components]
        triangles = len(each.faces) // 3 + sum(triangles for triangles, _ in below)
        counts[key] = triangles, 1 + sum(objects for _, objects in below)
        return triangles, 1 + sum(objects for _, objects in below)

    try:
        totals = [count(key) for key, _ in model.build]
    except RecursionError as error:
        raise AssetError("The components of the 3MF nest too deeply.") from error
    if sum(total[0] for total in totals) > limits.max_triangles:
        raise _too_many(limits)
    if sum(total[1] for total in totals) > limits.max_primitives:
        raise AssetTooLargeError(f"The 3MF places more than {limits.max_primitives} objects.")


def _placed(model: _Model, key: _Key, matrix: _Floats) -> Iterator[tuple[_Key, _Floats]]:
    """Yield an object and its components with the matrices (4, 3) of row vectors that place them."""
    stack = [(key, matrix)]
    while stack:
        at, above = stack.pop()
        yield at, above
        for component, own in reversed(model.objects[at].components):
            stack.append((component, np.concatenate([own[:3] @ above[:3], own[3:] @ above[:3] + above[3:]])))


def _primitive(model: _Model, key: _Key, matrix: _Floats) -> Primitive:
    each = model.objects[key]
    verts = np.array(each.verts, np.float64).reshape(-1, 3)
    with np.errstate(all="ignore"):
        verts = verts @ matrix[:3] + matrix[3]
    if not (np.abs(verts) <= np.finfo(np.float32).max).all():  # NaN compares false
        raise AssetNotFiniteError("The file has vertices that are not finite 32-bit floats.")
    faces = np.array(each.faces, np.int64).reshape(-1, 3)
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(verts):
        raise AssetError(f"A triangle of object {key[1][:40]!r} of the 3MF has a vertex that it has not.")
    if np.linalg.det(matrix[:3]) < 0:
        faces = faces[:, ::-1]
    name = each.name[:100] or f"object_{key[1][:20]}"
    entries, corners = _entries(model, key[0], each)
    if len(entries) == 1:
        material, color = entries[0]
        if color == _WHITE and not material:
            return Primitive(verts, faces, name=name)
        linear = (*linear_color([band / 255 for band in color[:3]]), color[3] / 255)
        return Primitive(verts, faces, name=name, material=material or "color", base_color=linear)
    if np.linalg.det(matrix[:3]) < 0:
        corners = corners[:, ::-1]
    pairs, index = np.unique(np.stack([faces, corners], 2).reshape(-1, 2), axis=0, return_inverse=True)
    colors = np.array([color for _, color in entries], np.uint8)[pairs[:, 1]]
    return Primitive(verts[pairs[:, 0]], index.reshape(-1, 3), colors=colors, name=name)


def _entries(model: _Model, path: str, each: _Object) -> tuple[list[tuple[str, tuple[int, ...]]], NDArray[np.int64]]:
    """Return the names and colours that the triangles of an object use, and which of them each corner (T, 3) has."""
    numbers: dict[tuple[str, tuple[int, ...]], int] = {}
    known: dict[tuple[str, str], int] = {}
    corners = []
    for group, *entries in each.looks:
        for entry in entries:
            if (group, entry) not in known:
                colors = model.colors.get((path, group), [])
                at = int(entry) if entry.isdigit() and len(entry) < 9 else -1
                look = colors[at] if 0 <= at < len(colors) else ("", _WHITE)
                known[group, entry] = numbers.setdefault(look, len(numbers))
            corners.append(known[group, entry])
    return list(numbers), np.array(corners, np.int64).reshape(-1, 3)


def _color(text: str) -> tuple[int, ...]:
    """Return the sRGB colour and opacity of `#RRGGBB` or `#RRGGBBAA`; white for anything else."""
    digits = text.strip().removeprefix("#")
    try:
        bands = tuple(bytes.fromhex(digits))
    except ValueError:
        return _WHITE
    return (*bands, 255)[:4] if len(bands) in (3, 4) else _WHITE
