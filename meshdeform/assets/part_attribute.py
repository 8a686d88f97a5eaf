"""Write the parts of an asset as the vertex attribute `_PART`, and read them from it.

`_PART` is an unsigned byte for each vertex: 0, or the number of a part, from 1, in the list of names `extras.parts` of
its mesh and of the file's `asset`. A vertex of two parts is split: its copies come last, with all that the vertex has.

Source: glTF 2.0 specification, section 3.7.2.1 (Meshes, Overview): names of an application's own attributes begin with
an underscore, and they must not be unsigned integers of 32 bits; each element lies on a multiple of four bytes. Of
integers with one component, Blender reads bytes alone.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_accessor, read_triangles
from meshdeform.assets.codes import UNSIGNED_BYTE
from meshdeform.assets.container import Json, clone
from meshdeform.assets.document import Document
from meshdeform.assets.part_labels import Showing
from meshdeform.assets.subdivide import drop_lists_of_edges
from meshdeform.assets.surface import block_primitives
from meshdeform.errors import AssetError

if TYPE_CHECKING:
    from meshdeform.assets.asset import Asset

PART = "_PART"
_NAMES = "parts"
_Index = NDArray[np.int64]


def write_part_attribute(document: Document, showings: Sequence[Showing], names: Sequence[str]) -> None:
    """Give the triangles of showings the attribute, in place; what needs no split keeps its accessors."""
    named = write_names(document.root["asset"], names)
    for showing in showings:
        mesh = document.root["meshes"][showing.mesh]
        named = write_names(mesh, names) or named
        groups: dict[str, list[int]] = {}
        for p in showing.labels:
            primitive = mesh["primitives"][p]
            primitive["attributes"].pop(PART, None)
            key = json.dumps([primitive["attributes"], primitive.get("targets", [])], sort_keys=True)
            groups.setdefault(key, []).append(p)
        for numbers in groups.values():
            parts = [showing.labels[p] for p in numbers]
            _write_group(document, [mesh["primitives"][p] for p in numbers], parts, f"meshes[{showing.mesh}]")
    if not named:
        raise AssetError(
            "The names of the parts have no place: the file's `extras` are no objects.",
            advice="Ask for parts as materials or as nodes.",
        )


def write_names(holder: Json, names: Sequence[str]) -> bool:
    """Write the names into the extras of an object; return whether these have a place for them."""
    extras = holder.setdefault("extras", {})
    if isinstance(extras, dict):
        extras[_NAMES] = list(names)
    return isinstance(extras, dict)


@dataclass(frozen=True)
class _Split:
    """Vertices of which each has one part."""

    corners: _Index  # (T, 3) int64
    sources: _Index  # (E,) int64: the vertices whose copies come after all others
    parts: NDArray[np.uint8]  # (V + E,) uint8


def _split(triangles: _Index, labels: _Index, count: int) -> _Split:
    """Split `count` vertices so that all triangles (T, 3) of a vertex have the same label (T,)."""
    most = int(labels.max(initial=0)) + 1
    pairs, corner = np.unique(triangles * most + labels[:, None], return_inverse=True)
    vertex, label = pairs // most, pairs % most
    copied = np.diff(vertex, prepend=-1) == 0
    number = np.where(copied, count + np.cumsum(copied) - 1, vertex)
    parts = np.zeros(count + int(copied.sum()), np.uint8)
    parts[number] = label
    return _Split(number[corner].reshape(-1, 3), vertex[copied], parts)


def _write_group(document: Document, primitives: list[Json], labels: list[_Index], where: str) -> None:
    """Give primitives with the same vertices the parts of their triangles."""
    count = document.root["accessors"][primitives[0]["attributes"]["POSITION"]]["count"]
    faces = [read_triangles(document, each, count, where) for each in primitives]
    split = _split(np.concatenate(faces), np.concatenate(labels), count)
    part = document.append_stored(split.parts[:, None], {"componentType": UNSIGNED_BYTE, "type": "SCALAR"})
    grown: dict[int, int] = {}
    ends = np.cumsum([len(own) for own in faces])[:-1]
    for primitive, before, after in zip(primitives, faces, np.split(split.corners, ends), strict=True):
        for slots in (primitive["attributes"], *primitive.get("targets", [])) if len(split.sources) else ():
            for name, accessor in slots.items():
                if accessor not in grown:
                    grown[accessor] = _grown(document, accessor, split.sources, count, f"{where}: {name}")
                slots[name] = grown[accessor]
        if (before != after).any() or ("indices" not in primitive and len(split.sources)):
            position = primitive["attributes"]["POSITION"]
            like = document.root["accessors"][primitive["indices"]] if "indices" in primitive else {}
            primitive["indices"] = document.append_triangles(after, document.root["accessors"][position]["count"], like)
            primitive.pop("mode", None)
            drop_lists_of_edges(document.root, primitive)
        primitive["attributes"][PART] = part


def _grown(document: Document, accessor: int, sources: _Index, count: int, where: str) -> int:
    """Append an accessor with copies of some elements at its end, all as they are stored; return its index."""
    item = document.root["accessors"][accessor]
    if item["count"] != count:
        raise AssetError(f"{where} has {item['count']} elements, but POSITION has {count}.")
    if "bufferView" not in item and "sparse" not in item:  # zeros
        return document.add("accessors", {**clone(item), "count": count + len(sources)})
    values = read_accessor(document, accessor)
    return document.append_stored(np.concatenate([values, values[sources]]), item)


def read_part_attribute(asset: Asset) -> dict[str, NDArray[np.bool_]]:
    """Return the flags (T,) of the triangles of each part; `parted.parts_of` documents the rest."""
    root, triangles = asset._document.root, asset.surface.triangles
    parts: dict[str, NDArray[np.bool_]] = {}
    for block, _, primitive, rows in block_primitives(root, asset._blocks):
        names = _read_names(root["meshes"][block.mesh]) or _read_names(root["asset"])
        accessor = primitive["attributes"].get(PART)
        numbers = _numbers(asset._document, accessor, len(block.positions)) if names else None
        if numbers is None:
            continue
        own = _of_triangles(numbers[triangles[rows] - block.rows.start])
        for number, name in enumerate(names, 1):
            if (own == number).any():
                parts.setdefault(name, np.zeros(len(triangles), bool))[rows] |= own == number
    return parts


def _read_names(holder: Json) -> list[str]:
    extras = holder.get("extras")
    names = extras.get(_NAMES) if isinstance(extras, dict) else None
    good = isinstance(names, list) and all(isinstance(name, str) and name for name in names)
    return names if good and names is not None else []


def _numbers(document: Document, accessor: Any, count: int) -> _Index | None:
    """Return the part of each of `count` vertices; None if the attribute is missing or of another kind."""
    if not isinstance(accessor, int):
        return None
    try:
        values = read_accessor(document, accessor)
    except (AssetError, IndexError):  # the deformation does not need this attribute
        return None
    if values.shape != (count, 1):
        return None
    rounded: NDArray[np.float64] = np.rint(np.nan_to_num(values[:, 0].astype(np.float64)))
    return np.asarray(np.clip(rounded, 0, 2**31), np.int64)


def _of_triangles(corners: _Index) -> _Index:
    """Return the part (T,) of triangles by those of their corners (T, 3): of two, or the first if all differ."""
    first, second, third = corners.T
    return np.asarray(np.where(second == third, second, first))
