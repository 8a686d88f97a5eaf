"""Say which part each triangle of an asset belongs to, and give each way to show a mesh with its parts its own mesh."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.container import Json, clone
from meshdeform.assets.document import Document
from meshdeform.assets.surface import Block
from meshdeform.errors import AssetError, ShapeError

MOST_PARTS = 255
"""So many parts have numbers of one byte."""
_POINTER = re.compile(r"/(\w+)/(\d{1,9})/(.+)", re.ASCII)
_Index = NDArray[np.int64]
_Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class PartLabels:
    """The part of each triangle of a surface."""

    names: tuple[str, ...]
    of_triangle: _Index  # (T,) int64: number of the part, from 1 in the order of `names`; 0 where there is none

    @classmethod
    def of_flags(cls, parts: Mapping[str, _Flags], count: int) -> Self:
        """Return the labels of `count` triangles; one that several parts (T,) have belongs to the first.

        Raises ShapeError: a part has another number of flags.
        """
        labels = np.zeros(count, np.int64)
        for number, (name, flags) in enumerate(parts.items(), 1):
            if np.shape(flags) != (count,):
                raise ShapeError(f"The part {name!r} must have shape ({count},), not {np.shape(flags)}.")
            labels[flags & (labels == 0)] = number
        return cls(tuple(parts), labels)

    def checked(self, count: int) -> Self:
        """Return these labels after checking that they number the parts of `count` triangles."""
        if len(self.names) > MOST_PARTS:
            raise AssetError(
                f"{len(self.names)} parts are too many: the limit is {MOST_PARTS}.", advice="Join parts that are alike."
            )
        if self.of_triangle.shape != (count,):
            raise ShapeError(f"Labels must have shape ({count},), not {self.of_triangle.shape}.")
        if count and not 0 <= self.of_triangle.min() <= self.of_triangle.max() <= len(self.names):
            raise ShapeError(f"Labels must be 0 to {len(self.names)}, the number of names.")
        return self


@dataclass(frozen=True)
class Showing:
    """A mesh that only some nodes show, all of them with the same parts."""

    mesh: int
    nodes: tuple[int, ...]
    labels: Mapping[int, _Index]  # by primitive of the surface: the part of each of its triangles


def own_showings(document: Document, blocks: Sequence[Block], labels: PartLabels) -> list[Showing]:
    """Return the showings of a surface that have parts, after giving each of them a mesh of its own, in place.

    The first keeps the mesh, unless a node without parts shows it too.
    """
    of_node: dict[int, dict[int, _Index]] = defaultdict(dict)
    mesh_of = {block.node: block.mesh for block in blocks}
    start = 0
    for block in blocks:
        for number, count in zip(block.primitives, block.triangles, strict=True):
            of_node[block.node][number] = labels.of_triangle[start : start + count]
            start += count
    alike: dict[Any, list[int]] = defaultdict(list)
    for node, of_primitive in of_node.items():
        if any(part.any() for part in of_primitive.values()):
            alike[mesh_of[node], *((p, part.tobytes()) for p, part in sorted(of_primitive.items()))].append(node)
    parted = {node for nodes in alike.values() for node in nodes}
    nodes, meshes = document.root["nodes"], document.root["meshes"]
    claimed = {node["mesh"] for at, node in enumerate(nodes) if "mesh" in node and at not in parted}
    showings, copies = [], defaultdict[int, list[int]](list)
    for (mesh, *_), shown_by in alike.items():
        own = mesh
        if mesh in claimed:
            own = len(meshes)
            meshes.append(clone(meshes[mesh]))
            copies[mesh].append(own)
            for node in shown_by:
                nodes[node]["mesh"] = own
        claimed.add(mesh)
        showings.append(Showing(own, tuple(shown_by), of_node[shown_by[0]]))
    follow_pointers(document.root, "meshes", copies)
    return showings


def follow_pointers(
    root: Json, kind: str, copies: Mapping[int, Sequence[int]], *, only: str = "", instead: bool = False
) -> None:
    """Let what KHR_animation_pointer animates of an object act on its copies too, or on them instead of it.

    `kind`: name of a top-level array; `only`: the one property of the objects that the copies have.
    """
    for channel, channels in list(channels_of(root)):
        pointer = _pointer(channel)
        match = _POINTER.fullmatch(str(pointer.get("pointer")))
        if match is None or match[1] != kind or (only and match[3] != only):
            continue
        numbers = list(copies.get(int(match[2]), ()))
        if numbers and instead:
            pointer["pointer"] = f"/{kind}/{numbers.pop(0)}/{match[3]}"
        for number in numbers:
            channels.append(clone(channel))
            _pointer(channels[-1])["pointer"] = f"/{kind}/{number}/{match[3]}"


def channels_of(root: Json) -> Iterator[tuple[Json, list[Any]]]:
    """Yield each channel of the animations, and the list that it is in."""
    for animation in root.get("animations", []):
        channels = animation.get("channels") if isinstance(animation, dict) else None
        for channel in channels if isinstance(channels, list) else []:
            if isinstance(channel, dict) and channels is not None:
                yield channel, channels


def _pointer(channel: Any) -> Json:
    """Return the object of KHR_animation_pointer in a channel; an empty one if it has none."""
    for key in ("target", "extensions", "KHR_animation_pointer"):
        channel = channel.get(key) if isinstance(channel, dict) else None
    return channel if isinstance(channel, dict) else {}
