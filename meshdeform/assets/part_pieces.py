"""Cut the primitives of an asset into its parts: each with a material of its own name, or on a node of its own.

The pieces share the vertices that their primitive had; only indices are new. A piece is drawn as its primitive was:
with a copy of its material, by the same skin, with the same morph targets, and animations that act on the material, the
mesh or the weights of the node act on all of their copies.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_triangles
from meshdeform.assets.codes import GPU_INSTANCING
from meshdeform.assets.container import Json, clone
from meshdeform.assets.document import Document
from meshdeform.assets.part_labels import Showing
from meshdeform.assets.subdivide import drop_lists_of_edges
from meshdeform.assets.unchecked import channels_of, follow_pointers

_Index = NDArray[np.int64]


def split_materials(document: Document, showings: Sequence[Showing], names: Sequence[str]) -> None:
    """Give the triangles of each part copies of their materials that are named after it, in place."""
    copies: dict[tuple[int | None, int], int] = {}
    for showing in showings:
        mesh = document.root["meshes"][showing.mesh]
        pieces = []
        for p, primitive in enumerate(mesh["primitives"]):
            for label, piece in _pieces(document, primitive, showing.labels.get(p)):
                if label:
                    key = piece.get("material"), label
                    if key not in copies:
                        copies[key] = _copied_material(document, key[0], names[label - 1])
                    piece["material"] = copies[key]
                pieces.append(piece)
        mesh["primitives"] = pieces
    of_material = defaultdict[int, list[int]](list)
    for (material, _), copy in copies.items():
        if material is not None:
            of_material[material].append(copy)
    follow_pointers(document.root, "materials", of_material)


def _copied_material(document: Document, material: int | None, part: str) -> int:
    source = {} if material is None else clone(document.root["materials"][material])
    return document.add("materials", {**source, "name": _title(part, source.get("name"))})


def _title(part: str, name: Any) -> str:
    return f"{part} ({name})" if name and isinstance(name, str) else part


def split_nodes(document: Document, showings: Sequence[Showing], names: Sequence[str]) -> None:
    """Put the triangles of each part on a child of their node that is named after it, in place.

    What has no part stays on the node.
    """
    meshes = document.root["meshes"]
    for showing in showings:
        mesh = meshes[showing.mesh]
        pieces: dict[int, list[Json]] = {0: []}
        for p, primitive in enumerate(mesh["primitives"]):
            for label, piece in _pieces(document, primitive, showing.labels.get(p)):
                pieces.setdefault(label, []).append(piece)
        rest, like = pieces.pop(0), {key: value for key, value in mesh.items() if key != "primitives"}
        made: dict[str, int] = {}
        for label, primitives in sorted(pieces.items()):
            name = names[label - 1]
            part = {**clone(like), "name": _title(name, like.get("name")), "primitives": primitives}
            made[name] = len(meshes) if rest or made else showing.mesh
            if made[name] == showing.mesh:  # nothing else would show it
                meshes[showing.mesh] = part
            else:
                meshes.append(part)
        if rest:
            mesh["primitives"] = rest
        copies = [each for each in made.values() if each != showing.mesh]
        follow_pointers(document.root, "meshes", {showing.mesh: copies}, only="weights")
        for node in showing.nodes:
            _hang(document.root, node, made, keeps_mesh=bool(rest))


def _hang(root: Json, at: int, made: dict[str, int], *, keeps_mesh: bool) -> None:
    """Give a node children with these meshes, drawn as its own mesh was; a node that does not keep that loses it."""
    node, extensions = root["nodes"][at], root["nodes"][at].get("extensions", {})
    shown = {key: clone(node[key]) for key in ("skin", "weights") if key in node}
    if GPU_INSTANCING in extensions:
        shown["extensions"] = {GPU_INSTANCING: clone(extensions[GPU_INSTANCING])}
    children = list(range(len(root["nodes"]), len(root["nodes"]) + len(made)))
    root["nodes"] += [{"name": name, "mesh": mesh, **clone(shown)} for name, mesh in made.items()]
    node["children"] = [*node.get("children", []), *children]
    if not keeps_mesh:
        for key in ("mesh", "skin", "weights"):
            node.pop(key, None)
        extensions.pop(GPU_INSTANCING, None)
        if "extensions" in node and not extensions:
            del node["extensions"]
    _follow_weights(root, at, children, instead=not keeps_mesh)


def _follow_weights(root: Json, node: int, children: list[int], *, instead: bool) -> None:
    """Let what animates the weights of a node act on its children too, or on them instead of it."""
    follow_pointers(root, "nodes", {node: children}, only="weights", instead=instead)
    for channel, channels, _ in list(channels_of(root)):
        target = channel.get("target")
        if not isinstance(target, dict) or (target.get("path"), target.get("node")) != ("weights", node):
            continue
        if instead:
            target["node"] = children[0]
        for child in children[instead:]:
            channels.append({**clone(channel), "target": {**clone(target), "node": child}})


def _pieces(document: Document, primitive: Json, labels: _Index | None) -> list[tuple[int, Json]]:
    """Return the pieces of a primitive with their labels, ascending; itself if all its triangles have the same.

    `labels`, (T,) int64: of its triangles; None for points, lines and what is not drawn.
    """
    present = [0] if labels is None else np.unique(labels).tolist()
    if labels is None or len(present) < 2:
        return [(present[0] if present else 0, primitive)]
    position = primitive["attributes"]["POSITION"]
    triangles = read_triangles(document, primitive, document.root["accessors"][position]["count"], "a primitive")
    like = document.root["accessors"][primitive["indices"]] if "indices" in primitive else {}
    drop_lists_of_edges(document.root, primitive)
    pieces = []
    for label in present:
        piece = clone(primitive)
        piece["indices"] = document.append_triangles(
            triangles[labels == label], document.root["accessors"][position]["count"], like
        )
        piece.pop("mode", None)
        extras = piece.get("extras")
        if isinstance(extras, dict) and isinstance(extras.get("polygons"), list):
            extras["polygons"] = _polygons_within(extras["polygons"], labels == label)
        pieces.append((label, piece))
    return pieces


def _polygons_within(runs: list[list[int]], chosen: NDArray[np.bool_]) -> list[list[int]]:
    """Return the runs of polygons, [corners, count] each, of chosen triangles (T,); one that was cut is triangles."""
    corners = np.repeat([run[0] for run in runs], [run[1] for run in runs])
    polygon = np.repeat(np.arange(len(corners)), corners - 2)[: len(chosen)]
    if len(polygon) < len(chosen):  # they are not those of this primitive
        return [[3, int(chosen.sum())]]
    whole = np.bincount(polygon[chosen], minlength=len(corners)) == corners - 2
    first = np.diff(polygon, prepend=-1) != 0
    kept = np.where(whole[polygon], np.where(first, corners[polygon], 0), 3)[chosen]
    kept = kept[kept > 0]
    starts = np.flatnonzero(np.diff(kept, prepend=-1))
    return [[int(kept[a]), int(b - a)] for a, b in zip(starts, [*starts[1:], len(kept)], strict=True)]
