"""Split the long edges of a document's triangles, for surfaces too coarse to bend.

All edges at the same location are split together, whichever primitives, meshes and instances they belong to, so that no
vertex comes to lie on the edge of a neighbour. Every pass splits the longest edges in the middle, down to half of the
longest, until all are short enough or the triangles too many.

A new vertex has the attributes in the middle of its edge, of any type that glTF allows (glTF 2.0 specification,
sections 3.7.2, Meshes, and 3.7.3.3, Skinned mesh attributes).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_accessor, read_floats, read_triangles
from meshdeform.assets.codes import TRIANGLES
from meshdeform.assets.compressed import drop_extension
from meshdeform.assets.container import Json, clone
from meshdeform.assets.document import Document
from meshdeform.assets.placement import Matrix, is_invertible, placement_matrix, world_matrices
from meshdeform.assets.references import MANIFOLD, drop_manifold, follow_copies
from meshdeform.assets.scene_checks import instances_of
from meshdeform.errors import AssetError
from meshdeform.geometry.coincidence import WELD_TOLERANCE, coincident
from meshdeform.geometry.edge_splits import longest_together, split_triangles, unique_edges

LONGEST_EDGE = 0.1
"""Length, as a share of the longest side of the bounding box, above which edges are split."""

MAX_TRIANGLES = 100_000
"""Number of triangles, over all instances, that subdivision does not exceed."""

_SHARES = (0.5, 0.7, 0.9)
"""Least length of an edge that a pass splits, as a share of the longest; the first that is within the limit is used."""
_BY_EDGE = ("CESIUM_primitive_outline", "EXT_mesh_primitive_edge_visibility")
"""Extensions of primitives that list edges or indices of triangles, and mean others afterwards."""
_FLOATS = ("POSITION", "NORMAL", "TANGENT")
_Index = NDArray[np.int64]
_Rows = NDArray[Any]


@dataclass(frozen=True)
class Subdivision:
    """Summary of a subdivision."""

    # Over all instances
    triangles_before: int
    triangles_after: int
    longest_edge: float  # length of the longest edge afterwards, as a share of the longest side of the bounding box
    limited: bool  # whether the limit on triangles ended it
    dropped: tuple[str, ...] = ()  # extensions of primitives that were removed, since they list edges

    @property
    def split(self) -> bool:
        """Whether anything was split."""
        return self.triangles_after > self.triangles_before


@dataclass(frozen=True)
class _Group:
    """The primitives of one mesh that have the same vertices."""

    mesh: int
    primitives: list[int]
    slots: dict[str, int]  # accessor of each attribute, and of those of morph targets as `TARGET/NAME`
    columns: dict[str, NDArray[Any]]  # dict of str to (N, K) array: their elements
    triangles: _Index  # (T, 3) int64
    owner: _Index  # (T,) int64: index of each triangle's primitive in `primitives`
    placements: list[Matrix]  # list of (4, 4) float64


@dataclass(frozen=True)
class _Edges:
    """The edges of a group: (E, 2), the edge of each side (T, 3), and the longest of each edge's copies (E,)."""

    pairs: _Index
    sides: _Index
    lengths: NDArray[np.float64]


def subdivide(document: Document, max_triangles: int, excluded: frozenset[int] = frozenset()) -> Subdivision:
    """Split the long edges of the default scene, in place; give what is split new accessors.

    Meshes of excluded nodes stay as they are. Positions, normals, tangents and morph targets become floats, other
    attributes keep their types; all triangles become indexed lists.
    """
    groups = list(_groups(document, excluded))
    size = _size(groups)
    before = count = sum(len(group.placements) * len(group.triangles) for group in groups)
    changed, limited = set[int](), False
    while True:
        edges = _measured(groups)
        longest = max((float(group_edges.lengths.max(initial=0.0)) for group_edges in edges), default=0.0)
        if longest <= LONGEST_EDGE * size:
            break
        least = _least_length(groups, edges, longest, LONGEST_EDGE * size, max_triangles)
        if least is None:
            limited = True
            break
        for at, group_edges in enumerate(edges):
            if (group_edges.lengths > least).any():
                groups[at] = _split(groups[at], group_edges, group_edges.lengths > least)
                changed.add(at)
        count = sum(len(group.placements) * len(group.triangles) for group in groups)
    dropped = {name for at in sorted(changed) for name in _write(document, groups[at])}
    return Subdivision(before, count, longest / size if size else 0.0, limited, tuple(sorted(dropped)))


def _own_meshes(document: Document, excluded: frozenset[int]) -> None:
    """Give the other nodes a copy of each mesh that they share with excluded ones."""
    nodes, meshes, copies = document.root["nodes"], document.root["meshes"], dict[int, int]()
    kept, owners = {nodes[at]["mesh"] for at in excluded if "mesh" in nodes[at]}, dict[tuple[int, int], int]()
    for at, node in enumerate(nodes):
        if at not in excluded and node.get("mesh") in kept:
            if node["mesh"] not in copies:
                copies[node["mesh"]] = len(meshes)
                meshes.append(clone(meshes[node["mesh"]]))
            owners[at, node["mesh"]] = node["mesh"] = copies[node["mesh"]]
    follow_copies(document.root, owners)


def _groups(document: Document, excluded: frozenset[int]) -> Iterator[_Group]:
    _own_meshes(document, excluded)
    worlds = world_matrices(document.root.get("nodes", []))
    placements: dict[int, list[Matrix]] = {}
    for instance in instances_of(document.root):
        if instance.node in excluded:
            continue
        matrix = placement_matrix(document, instance, worlds)
        if is_invertible(matrix):
            placements.setdefault(instance.mesh, []).append(matrix)
    for mesh, matrices in placements.items():
        primitives = document.root["meshes"][mesh].get("primitives", [])
        groups: dict[str, list[int]] = {}
        for p, primitive in enumerate(primitives):
            if primitive.get("mode", TRIANGLES) >= TRIANGLES and "POSITION" in primitive.get("attributes", {}):
                key = json.dumps([primitive["attributes"], primitive.get("targets", [])], sort_keys=True)
                groups.setdefault(key, []).append(p)
        for numbers in groups.values():
            yield _read(document, mesh, numbers, matrices)


def _read(document: Document, mesh: int, numbers: list[int], matrices: list[Matrix]) -> _Group:
    primitives = [document.root["meshes"][mesh]["primitives"][p] for p in numbers]
    slots = dict(primitives[0]["attributes"])
    for t, target in enumerate(primitives[0].get("targets", [])):
        slots |= {f"{t}/{name}": at for name, at in target.items()}
    columns = {
        key: (read_floats if key.rpartition("/")[2] in _FLOATS else read_accessor)(document, at)
        for key, at in slots.items()
    }
    count = len(columns["POSITION"])
    for key, values in columns.items():
        if len(values) != count:
            raise AssetError(
                f"meshes[{mesh}].primitives[{numbers[0]}]: {key} has {len(values)} elements, but POSITION has {count}."
            )
    where = f"meshes[{mesh}].primitives"
    faces = [read_triangles(document, p, count, f"{where}[{n}]") for p, n in zip(primitives, numbers, strict=True)]
    owner = np.repeat(np.arange(len(faces)), [len(each) for each in faces])
    return _Group(mesh, numbers, slots, columns, np.concatenate(faces), owner, matrices)


def _placed(group: _Group, placement: Matrix) -> NDArray[np.float64]:
    return np.asarray(group.columns["POSITION"] @ placement[:3, :3].T + placement[:3, 3])


def _size(groups: list[_Group]) -> float:
    """Return the longest side of the bounding box of all triangles."""
    used = [
        _placed(group, placement)[np.unique(group.triangles)]
        for group in groups
        if len(group.triangles)
        for placement in group.placements
    ]
    return float(np.ptp(np.concatenate(used), axis=0).max()) if used else 0.0


def _measured(groups: list[_Group]) -> list[_Edges]:
    """Return the edges of each group with the length of the longest edge that must be split together with each."""
    edges = [unique_edges(group.triangles) for group in groups]
    starts = np.cumsum([0, *(len(pairs) for pairs, _ in edges)])
    points = [_placed(group, placement) for group in groups for placement in group.placements]
    if not points or not starts[-1]:
        return [_Edges(*group_edges, np.empty(len(group_edges[0]))) for group_edges in edges]
    everything = np.concatenate(points)
    label = coincident(everything, WELD_TOLERANCE * float(np.linalg.norm(np.ptp(everything, axis=0))))
    ends, owners, offset = [], [], 0
    for (pairs, _), start, group in zip(edges, starts, groups, strict=False):
        for _ in group.placements:
            ends.append(pairs + offset)
            owners.append(start + np.arange(len(pairs)))
            offset += len(group.columns["POSITION"])
    ends_, owner = np.concatenate(ends), np.concatenate(owners)
    lengths = np.linalg.norm(everything[ends_[:, 0]] - everything[ends_[:, 1]], axis=1)
    corners = np.sort(label[ends_], axis=1)
    _, location = np.unique(corners[:, 0] * len(everything) + corners[:, 1], return_inverse=True)
    proper = corners[:, 0] != corners[:, 1]  # others are shorter than the tolerance
    longest = longest_together(owner[proper], location[proper], lengths[proper], int(starts[-1]))
    lengths_of = np.split(longest, starts[1:-1])
    return [_Edges(*group_edges, each) for group_edges, each in zip(edges, lengths_of, strict=True)]


def _least_length(
    groups: list[_Group], edges: list[_Edges], longest: float, requested: float, max_triangles: int
) -> float | None:
    """Return the length above which the next pass splits edges, or None if any would make too many triangles."""
    for share in _SHARES:
        least = max(requested, share * longest)
        after = sum(
            len(group.placements) * (len(group.triangles) + int((group_edges.lengths > least)[group_edges.sides].sum()))
            for group, group_edges in zip(groups, edges, strict=True)
        )
        if after <= max_triangles:
            return least
    return None


def _split(group: _Group, edges: _Edges, chosen: NDArray[np.bool_]) -> _Group:
    """Return the group with these edges (E,) split in the middle."""
    a, b = edges.pairs[chosen].T
    count = len(group.columns["POSITION"])
    new = np.full(len(edges.pairs), -1)
    new[chosen] = count + np.arange(len(a))
    added = middles(group.columns, a, b)
    columns = {key: np.concatenate([values, added[key]]) for key, values in group.columns.items()}
    grown = replace(group, columns=columns)
    triangles, parents = split_triangles(group.triangles, new[edges.sides], _placed(grown, group.placements[0]))
    return replace(grown, triangles=triangles, owner=group.owner[parents])


def _write(document: Document, group: _Group) -> set[str]:
    """Give the primitives of a group new accessors; return the extensions that were removed from them."""
    accessors, dropped = document.root["accessors"], set[str]()
    written = {key: _append(document, group.columns[key], accessors[at], key) for key, at in group.slots.items()}
    for number, p in enumerate(group.primitives):
        primitive = document.root["meshes"][group.mesh]["primitives"][p]
        old = accessors[primitive["indices"]] if "indices" in primitive else {}
        own = group.triangles[group.owner == number]
        primitive["indices"] = document.append_triangles(own, accessors[written["POSITION"]]["count"], old)
        primitive.pop("mode", None)
        if isinstance(primitive.get("extras"), dict):
            primitive["extras"].pop("polygons", None)
        primitive["attributes"] = {name: written[name] for name in primitive["attributes"]}
        for t, target in enumerate(primitive.get("targets", [])):
            primitive["targets"][t] = {name: written[f"{t}/{name}"] for name in target}
        dropped |= drop_lists_of_edges(document.root, primitive)
    return dropped | ({MANIFOLD} if drop_manifold(document.root, document.root["meshes"][group.mesh]) else set())


def drop_lists_of_edges(root: Json, primitive: Json) -> set[str]:
    """Remove the extensions of a primitive that list edges, since its corners are others now; return their names."""
    dropped = set(_BY_EDGE) & set(primitive.get("extensions", {}))
    for name in dropped:
        del primitive["extensions"][name]
        if not any(name in p.get("extensions", {}) for m in root["meshes"] for p in m["primitives"]):
            drop_extension(root, name)
    if primitive.get("extensions") == {}:
        del primitive["extensions"]
    return dropped


def _append(document: Document, values: NDArray[Any], like: Json, key: str) -> int:
    """Append an accessor of vertex attributes, each vertex on a multiple of four bytes, and return its index."""
    target, name = "/" in key, key.rpartition("/")[2]
    if target and not values.any() and values.dtype.kind == "f" and values.shape[1] == 3:
        return document.append_zeros(len(values))
    if values.dtype.kind == "f" and values.shape[1] <= 4:
        return document.append_accessor(values, like=like, bounds=name == "POSITION")
    return document.append_stored(values, {key: value for key, value in like.items() if key not in ("min", "max")})


def middles(columns: Mapping[str, _Rows], a: _Index, b: _Index) -> dict[str, _Rows]:
    """Return the attributes of new vertices between vertices `a` (M,) and `b` (M,).

    `columns`, mapping of str to (N, K) array: stored elements by attribute name; those of a morph target as
    `target/NAME`, with any prefix before the slash. Returns an array (M, K) of the same type for each. Normals and
    tangents have unit length. Skin weights are the mean of both ends, limited to the number of joints that a vertex has
    in the file, and sum to 1. Integers of the application's own attributes and feature ids, which may be numbers of
    something, are those of `a`; other integers are rounded.
    """
    middle = {name: _middle(name, values, a, b) for name, values in columns.items()}
    sets = [name[8:] for name in columns if name.startswith("WEIGHTS_") and f"JOINTS_{name[8:]}" in columns]
    if sets:
        joints = np.concatenate([columns[f"JOINTS_{n}"] for n in sets], axis=1)
        weights = np.concatenate([columns[f"WEIGHTS_{n}"] for n in sets], axis=1)
        mixed = _mixed_weights(joints, weights, a, b)
        for k, n in enumerate(sets):
            middle[f"JOINTS_{n}"], middle[f"WEIGHTS_{n}"] = (rows[:, 4 * k : 4 * k + 4] for rows in mixed)
    return middle


def _middle(name: str, values: _Rows, a: _Index, b: _Index) -> _Rows:
    first, second = values[a].astype(np.float64), values[b].astype(np.float64)
    own = name.startswith("_") and (values.dtype.kind != "f" or name.startswith("_FEATURE_ID"))
    if own or name.startswith(("JOINTS_", "WEIGHTS_")):
        return values[a]
    mean = (first + second) / 2
    if name in ("NORMAL", "TANGENT"):
        mean = np.column_stack([_unit(mean[:, :3], first[:, :3]), first[:, 3:]])
    return (mean if values.dtype.kind == "f" else np.rint(mean)).astype(values.dtype)


def _unit(vectors: NDArray[np.float64], otherwise: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.where(length > 1e-6, vectors / np.maximum(length, 1e-6), otherwise))


def _mixed_weights(joints: _Rows, weights: _Rows, a: _Index, b: _Index) -> tuple[_Rows, _Rows]:
    """Return joints and weights (M, K) of the middles: the K largest of the mean, in falling order."""
    count, width = len(a), joints.shape[1]
    both = np.concatenate([joints[a], joints[b]], axis=1).astype(np.int64)
    shares = np.concatenate([_shares(weights[a]), _shares(weights[b])], axis=1)
    base = int(joints.max(initial=0)) + 1
    keys, inverse = np.unique((np.arange(count)[:, None] * base + both).reshape(-1), return_inverse=True)
    total = np.bincount(inverse.reshape(-1), shares.reshape(-1), len(keys))
    keys, total = keys[total > 0], total[total > 0]
    row, joint = keys // base, keys % base
    order = np.lexsort((joint, -total, row))
    row, joint, total = row[order], joint[order], total[order]
    rank = np.arange(len(row)) - np.searchsorted(row, row)
    kept = rank < width
    mixed, share = np.zeros((count, width), joints.dtype), np.zeros((count, width))
    mixed[row[kept], rank[kept]], share[row[kept], rank[kept]] = joint[kept], total[kept]
    return mixed, _stored(_shares(share), weights.dtype)


def _shares(weights: _Rows) -> NDArray[np.float64]:
    """Return weights (M, K) that sum to 1; rows without weights stay zero."""
    values = np.nan_to_num(weights.astype(np.float64), posinf=0.0)
    total = values.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(values, total, out=np.zeros_like(values), where=total > 0))


def _stored(shares: NDArray[np.float64], dtype: np.dtype[Any]) -> _Rows:
    """Return shares as floats, or as normalized integers whose sum is exactly that of 1."""
    if dtype.kind == "f":
        return shares.astype(dtype)
    exact = shares * np.iinfo(dtype).max
    floor = np.floor(exact)
    missing = np.rint(exact.sum(axis=1) - floor.sum(axis=1))[:, None]
    rank = np.argsort(np.argsort(floor - exact, axis=1, kind="stable"), axis=1)
    return np.asarray(floor + (rank < missing), dtype)
