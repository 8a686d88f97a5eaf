"""Rebuild the normals and tangents of a file that have no direction: not finite, or of length zero.

Everything that reads the document afterwards finds usable ones; other vertices keep their numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats, read_triangles
from meshdeform.assets.codes import TRIANGLES
from meshdeform.assets.container import Json
from meshdeform.assets.document import Document
from meshdeform.assets.scene_checks import instances_of

_Rows = NDArray[np.float64]
_Triangles = NDArray[np.int64]


@dataclass(frozen=True)
class Repairs:
    """How many normals and tangents of the file were rebuilt."""

    normals: int = 0
    tangents: int = 0

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences for the user, if anything was rebuilt."""
        counts = ((self.normals, "normals"), (self.tangents, "tangents"))
        fixed = [f"{count} {name}" for count, name in counts if count]
        if not fixed:
            return ()
        return (
            f"{' and '.join(fixed)} of the file have no direction (not finite, or of length zero). They were rebuilt.",
        )


def rebuild_directions(document: Document) -> Repairs:
    """Give the default scene's triangles new accessors where normals or tangents have no direction, in place.

    Normals become the area-weighted mean of the faces' normals; tangents follow the texture coordinates, or are any
    vector perpendicular to the normal. A vertex that no face uses gets the normal of an axis.
    """
    with np.errstate(all="ignore"):  # what overflows is replaced
        return _rebuild_all(document)


def _rebuild_all(document: Document) -> Repairs:
    meshes = document.root.get("meshes", [])
    done: dict[tuple[int | None, ...], tuple[dict[str, int], Repairs]] = {}
    for mesh in sorted({instance.mesh for instance in instances_of(document.root)}):
        groups: dict[tuple[int | None, ...], list[int]] = {}
        for p, primitive in enumerate(meshes[mesh].get("primitives", [])):
            attributes = primitive.get("attributes", {})
            if primitive.get("mode", TRIANGLES) >= TRIANGLES and "POSITION" in attributes:
                key = tuple(attributes.get(name) for name in ("POSITION", "NORMAL", "TANGENT"))
                groups.setdefault(key, []).append(p)
        for key, primitives in groups.items():
            if key not in done:
                done[key] = _rebuild(document, mesh, primitives)
            for p in primitives:
                meshes[mesh]["primitives"][p]["attributes"].update(done[key][0])
    repairs = [repair for _, repair in done.values()]
    return Repairs(sum(r.normals for r in repairs), sum(r.tangents for r in repairs))


def _rebuild(document: Document, mesh: int, numbers: list[int]) -> tuple[dict[str, int], Repairs]:
    """Rebuild the directions of primitives that share their vertices; return their new accessors."""
    primitives = [document.root["meshes"][mesh]["primitives"][p] for p in numbers]
    attributes: Json = primitives[0]["attributes"]
    rebuilt: dict[str, _Rows] = {
        name: read_floats(document, attributes[name]).astype(np.float64)
        for name in ("NORMAL", "TANGENT")
        if name in attributes
    }
    bad = {name: _undirected(values) for name, values in rebuilt.items()}
    if not any(rows.any() for rows in bad.values()):
        return {}, Repairs()
    positions = read_floats(document, attributes["POSITION"]).astype(np.float64)
    if not np.isfinite(positions).all():
        return {}, Repairs()  # refused later, with the reason
    count = len(positions)
    where = f"meshes[{mesh}].primitives"
    triangles = np.concatenate(
        [read_triangles(document, p, count, f"{where}[{n}]") for p, n in zip(primitives, numbers, strict=True)]
    )
    new: dict[str, _Rows] = {}
    normals = rebuilt["NORMAL"] if "NORMAL" in rebuilt else _normals(positions, triangles)
    if "NORMAL" in bad and bad["NORMAL"].any():
        new["NORMAL"] = normals = np.where(bad["NORMAL"][:, None], _normals(positions, triangles), normals)
    if "TANGENT" in bad and bad["TANGENT"].any():
        uvs = read_floats(document, attributes["TEXCOORD_0"]) if "TEXCOORD_0" in attributes else None
        built = _tangents(positions, triangles, normals, uvs, rebuilt["TANGENT"][:, 3])
        new["TANGENT"] = np.where(bad["TANGENT"][:, None], built, rebuilt["TANGENT"])
    accessors = document.root["accessors"]
    written = {
        name: document.append_accessor(values.astype(np.float32), like=accessors[attributes[name]])
        for name, values in new.items()
    }
    counts = [int(bad[name].sum()) if name in bad else 0 for name in ("NORMAL", "TANGENT")]
    return written, Repairs(*counts)


def _undirected(values: _Rows) -> NDArray[np.bool_]:
    finite = np.isfinite(values).all(axis=1)
    return np.asarray(~finite | ~(values[:, :3] != 0.0).any(axis=1))


def _unit(vectors: _Rows, otherwise: _Rows) -> _Rows:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    usable = np.isfinite(length) & (length > 1e-30)
    return np.where(usable, vectors / np.where(usable, length, 1.0), otherwise)


def _scattered(triangles: _Triangles, of_faces: _Rows, count: int) -> _Rows:
    """Return the sum (count, K) of the faces' rows at each vertex."""
    corners, rows = triangles.reshape(-1), np.repeat(of_faces, 3, axis=0)
    return np.stack([np.bincount(corners, rows[:, k], count) for k in range(rows.shape[1])], axis=1)


def _normals(positions: _Rows, triangles: _Triangles) -> _Rows:
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    size = float(np.abs(positions).max(initial=0.0)) or 1.0
    total = _scattered(triangles, np.cross((b - a) / size, (c - a) / size), len(positions))
    return _unit(total, np.tile([0.0, 1.0, 0.0], (len(positions), 1)))


def _tangents(
    positions: _Rows, triangles: _Triangles, normals: _Rows, uvs: NDArray[np.float32] | None, handedness: _Rows
) -> _Rows:
    """Return tangents (N, 4) along increasing u; `handedness` is kept where it is finite and not zero."""
    count = len(positions)
    along, around = np.zeros((count, 3)), np.zeros(count)
    if uvs is not None and uvs.shape == (count, 2) and np.isfinite(uvs).all():
        a, b, c = triangles.T
        e, f = positions[b] - positions[a], positions[c] - positions[a]
        (u, v), (s, t) = (uvs[b] - uvs[a]).astype(float).T, (uvs[c] - uvs[a]).astype(float).T
        turn = np.sign(u * t - v * s)[:, None]
        along = _scattered(triangles, turn * (t[:, None] * e - v[:, None] * f), count)
        # v grows downwards: a texture that is not mirrored turns clockwise in u and v.
        around = _scattered(triangles, -turn, count)[:, 0]
    flat = along - (along * normals).sum(axis=1, keepdims=True) * normals
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    direction = _unit(flat, _unit(np.cross(normals, axis), axis))
    kept = np.isfinite(handedness) & (handedness != 0.0)
    sign = np.where(kept, np.sign(np.where(kept, handedness, 1.0)), np.where(around < 0.0, -1.0, 1.0))
    return np.column_stack([direction, sign])
