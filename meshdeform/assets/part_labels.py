"""Say which part each triangle of an asset belongs to, and give each way to show a mesh with its parts its own mesh."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.container import clone
from meshdeform.assets.document import Document
from meshdeform.assets.surface import Block, block_primitives
from meshdeform.assets.unchecked import follow_pointers
from meshdeform.errors import AssetError, ShapeError

MOST_PARTS = 255
"""So many parts have numbers of one byte."""
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
    for block, number, _, rows in block_primitives(document.root, blocks):
        of_node[block.node][number] = labels.of_triangle[rows]
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
