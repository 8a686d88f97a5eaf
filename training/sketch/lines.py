"""Find the visible lines of a mesh: silhouettes, boundaries and creases, as polylines on the page."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.kinds.sketch.solids import Floats, Solid
from meshdeform.rendering.cameras import fixed_cameras
from meshdeform.rendering.visibility import nearest_faces
from training.sketch.suggestive import suggestive_contours

_PIXELS = 160
"""Side of the depth picture that says what is hidden."""
_CREASE_COS = 0.6
"""Cosine of the angle between two normals below which their edge is a crease. A tube of eight sides has 0.71."""
_SAMPLES = 3
"""Places of each edge that are looked up in the depth picture."""


@dataclass(frozen=True)
class View:
    """From where a drawing is made: azimuth and elevation of the camera and its field of view, in degrees."""

    azimuth_deg: float
    elevation_deg: float
    fov_deg: float


def joined(solids: dict[str, Solid]) -> Solid:
    """Return all solids as one mesh, in which vertices of a solid at one place are one vertex."""
    verts, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for solid in solids.values():
        places, first, inverse = np.unique(np.round(solid.verts, 7), axis=0, return_index=True, return_inverse=True)
        triangles = inverse.reshape(-1)[solid.faces]
        a, b, c = triangles.T
        verts.append(solid.verts[first])
        faces.append(triangles[(a != b) & (b != c) & (c != a)] + count)
        count += len(places)
    return Solid(np.concatenate(verts), np.concatenate(faces))


def visible_lines(mesh: Solid, view: View, wires: Sequence[Floats] = (), *, contours: bool = False) -> list[Floats]:
    """Return the visible lines of a mesh, and those of wires, which hide nothing.

    Parameters
    ----------
    mesh : Solid
        Of vertices that are shared, as `joined` makes it.
    wires : sequence of (N, 3) floats
        Polylines of at least two points.
    contours : bool
        Draw suggestive contours too.

    Returns
    -------
    list of (N, 2) float64
        Polylines; x to the right and y down. The whole page is 0..1.
    """
    verts = np.concatenate([mesh.verts, *wires])
    centred = verts - (verts.min(0) + verts.max(0)) / 2
    radius = float(np.linalg.norm(centred, axis=1).max())
    cameras = fixed_cameras((view.azimuth_deg,), view.elevation_deg, view.fov_deg, fitting_radius=radius)
    eye = cameras.eye[0].astype(np.float64)
    edges = [_drawn_edges(mesh.faces, centred, eye)]
    first = len(mesh.verts)
    for wire in wires:
        rows = np.arange(first, first + len(wire))
        edges.append(np.stack([rows[:-1], rows[1:]], 1))
        first += len(wire)
    if contours and len(mesh.faces):
        points, segments = suggestive_contours(centred[: len(mesh.verts)], mesh.faces, eye)
        centred = np.concatenate([centred, points])
        edges.append(segments + first)
    clip = np.concatenate([centred, np.ones((len(centred), 1))], 1) @ cameras.view_proj[0].astype(np.float64).T
    depth_picture = nearest_faces(clip[None].astype(np.float32), mesh.faces, _PIXELS, _PIXELS)[1][0]
    places = clip[:, :3] / clip[:, 3:]
    page = np.stack([0.5 + 0.5 * places[:, 0], 0.5 - 0.5 * places[:, 1]], 1)
    every = np.concatenate(edges)
    a, b = every.T
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    at = page[a, None] * (1 - share[:, None]) + page[b, None] * share[:, None]
    depth = places[a, None, 2] * (1 - share) + places[b, None, 2] * share
    visible = _in_sight(depth_picture, at, depth).mean(1) > 0.5
    return [page[path] for path in _chains(every[visible], page)]


def _drawn_edges(faces: NDArray[np.int64], verts: Floats, eye: Floats) -> NDArray[np.int64]:
    """Return the edges (E, 2) that are silhouettes, boundaries or creases from the eye."""
    corners = verts[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(length, 1e-12)[:, None]
    front = np.einsum("fi,fi->f", normals, eye - corners[:, 0]) > 0
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner = np.tile(np.arange(len(faces)), 3)
    key = np.sort(sides, 1) @ np.array([len(verts), 1])
    order = np.argsort(key, kind="stable")
    key, owner, sides = key[order], owner[order], sides[order]
    same = key[1:] == key[:-1]
    first = np.flatnonzero(same)
    p, q = owner[first], owner[first + 1]
    outline = front[p] != front[q]
    crease = (front[p] | front[q]) & (np.einsum("ei,ei->e", normals[p], normals[q]) < _CREASE_COS)
    thick = (length[p] > 1e-9) & (length[q] > 1e-9)
    alone = np.ones(len(key), bool)
    alone[first] = alone[first + 1] = False
    return np.concatenate([sides[first[(outline | crease) & thick]], sides[alone]])


def _in_sight(picture: NDArray[np.float32], at: Floats, depth: Floats) -> NDArray[np.bool_]:
    """Return which places are not hidden: nothing nearer in the whole neighbourhood of 3 x 3 pixels."""
    x, y = (np.clip((at[..., i] * _PIXELS).astype(int), 1, _PIXELS - 2) for i in (0, 1))
    around = np.stack([picture[y + j, x + i] for i in (-1, 0, 1) for j in (-1, 0, 1)])
    return np.asarray(depth <= around.max(0) + 0.004)


def _chains(edges: NDArray[np.int64], page: Floats) -> list[list[int]]:
    """Return paths of vertices in which each edge comes once; a path goes straight on where it can."""
    left: dict[int, set[int]] = defaultdict(set)
    for a, b in edges.tolist():
        left[a].add(b)
        left[b].add(a)
    points = page.tolist()

    def onward(before: int, here: int) -> int | None:
        best, chain = 0.5, None
        dx, dy = points[here][0] - points[before][0], points[here][1] - points[before][1]
        for there in sorted(left[here]):
            ex, ey = points[there][0] - points[here][0], points[there][1] - points[here][1]
            size = ((dx * dx + dy * dy) * (ex * ex + ey * ey)) ** 0.5
            cosine = (dx * ex + dy * ey) / size if size > 0 else 1.0
            if cosine > best:
                best, chain = cosine, there
        return chain

    paths = []
    for a, b in edges.tolist():
        if b not in left[a]:
            continue
        path = [a, b]
        left[a].discard(b)
        left[b].discard(a)
        for _ in range(2):  # on from one end, then from the other
            while (there := onward(path[-2], path[-1])) is not None:
                left[path[-1]].discard(there)
                left[there].discard(path[-1])
                path.append(there)
            path.reverse()
        paths.append(path)
    return paths
