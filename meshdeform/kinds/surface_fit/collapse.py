"""Collapse the edges of a manifold mesh, least error first, so that parts, handles and borders stay what they are.

An edge is collapsed only if it keeps the link condition: its ends have no common neighbour but the tips of its faces,
and if both lie on borders, it is a border itself. Each face is a quadric about its middle with a normal that is
uncertain by a few degrees, so that vertices of flat parts spread evenly; each border edge adds a plane across its face.

Where a surface touches itself, an edge may occur twice, between different pairs of faces. Such an edge is split at its
middle first, which leaves the surface as it is.

Source: Garland and Heckbert 1997; Dey et al. 1999, Topology Preserving Edge Contraction; Trettner and Kobbelt 2020,
Fast and Robust QEM Minimization using Probabilistic Quadrics.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import AssetError
from meshdeform.geometry.edge_splits import split_triangles, unique_edges
from meshdeform.geometry.folds import area_vectors
from meshdeform.geometry.kernels import kernel
from meshdeform.kinds.surface_fit.cleaning import CleanMesh
from meshdeform.kinds.surface_fit.gluing import glue

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_UNCERTAIN = 0.005
"""Standard deviation of a normal: more makes faces even, less lets them follow the curvature."""
_BORDER = 4.0
"""Weight of a border's plane, per squared length; that of a face is its area."""
_TURN = 0.2
"""Least cosine of the angle by which a collapse turns a face."""
_MOST = 4
"""Times the faces of a base that were asked for, at most."""


def base_of(surface: CleanMesh, count: int) -> tuple[_Floats, _Index]:
    """Return the vertices (V, 3) float64 and faces (F, 3) int64 of a base of at most `count` faces.

    It has more, up to four times as many, if fewer would fold over. A surface that has no more is its own base.

    Raises
    ------
    AssetError
        So few faces cannot have the handles, holes and parts of the surface.
    """
    known = surface.topology
    if known.fewest_faces <= count:
        verts, faces = collapsed(surface, count)
        if len(faces) <= _MOST * count:
            return verts, faces
    raise AssetError(
        f"The surface has {known.components} parts, {known.genus} handles and {known.borders} borders, which need a "
        f"base of {known.fewest_faces} faces or more; params.base_faces is {count}.",
        advice="Set it higher, or fill tiny holes and remove tiny handles and loose parts. A grid with noise, and "
        "points whose normals face anywhere, have hundreds of them.",
    )


def collapsed(mesh: CleanMesh, count: int) -> tuple[_Floats, _Index]:
    """Return vertices (V, 3) and faces (F, 3) with unique edges, at most `count` or the fewest that do not fold."""
    verts, faces = _with_unique_edges(mesh)
    if len(faces) <= count:
        return verts, faces
    centre, size = verts.mean(0), max(float(np.ptp(verts, axis=0).max()), 1e-300)
    places, corners = (verts - centre) / size, faces.ravel().copy()
    twin = glue(verts, faces).ravel()
    _collapse(places, corners, twin, _quadrics(places, faces, twin), len(faces) - count)
    used, numbers = np.unique(corners[corners >= 0], return_inverse=True)
    return centre + size * places[used], numbers.reshape(-1, 3).astype(np.int64)


def _with_unique_edges(mesh: CleanMesh) -> tuple[_Floats, _Index]:
    """Return the vertices and faces, with the edges split that occur twice."""
    verts, faces, twin = mesh.verts, mesh.faces, mesh.twin.ravel()
    _, sides = unique_edges(faces)
    many = np.flatnonzero((np.bincount(sides.ravel()) > 2)[sides.ravel()])
    if not len(many):
        return verts, faces
    kept, new = np.unique(np.maximum(many, twin[many]), return_inverse=True)
    middles = np.full(3 * len(faces), -1)
    middles[many] = len(verts) + new
    ends = verts[np.stack([faces.ravel()[kept], np.roll(faces, -1, 1).ravel()[kept]])]
    verts = np.concatenate([verts, ends.mean(0)])
    return verts, split_triangles(faces, middles.reshape(-1, 3), verts)[0]


def _quadrics(verts: _Floats, faces: _Index, twin: _Index) -> _Floats:
    """Return the sums (V, 4, 4) of x A x + 2 b x + c around each vertex, as [[A, b], [b, c]]."""
    cross = area_vectors(verts, faces)
    twice = np.linalg.norm(cross, axis=1)
    normals = cross / np.maximum(twice, 1e-300)[:, None]
    edges = np.flatnonzero(twin < 0)
    start, end = faces.ravel()[edges], np.roll(faces, -1, 1).ravel()[edges]
    along = verts[end] - verts[start]
    squared = (along**2).sum(1)
    across = np.cross(along, normals[edges // 3]) / np.sqrt(np.maximum(squared, 1e-300))[:, None]
    out = np.zeros((len(verts), 4, 4))
    of_faces = _planes(verts[faces].mean(1), normals, twice / 2)
    of_edges = _planes((verts[start] + verts[end]) / 2, across, _BORDER * squared)
    for index, planes in [*((faces[:, k], of_faces) for k in range(3)), (start, of_edges), (end, of_edges)]:
        for i in range(16):
            out[:, i // 4, i % 4] += np.bincount(index, planes[:, i // 4, i % 4], len(verts))
    return out


def _planes(middles: _Floats, normals: _Floats, weights: _Floats) -> _Floats:
    """Return the quadrics (P, 4, 4) of planes with uncertain normals."""
    out = np.empty((len(weights), 4, 4))
    out[:, :3, :3] = weights[:, None, None] * (normals[:, :, None] * normals[:, None] + _UNCERTAIN**2 * np.eye(3))
    out[:, :3, 3] = out[:, 3, :3] = -np.einsum("pij,pj->pi", out[:, :3, :3], middles)
    out[:, 3, 3] = -np.einsum("pi,pi->p", out[:, :3, 3], middles)
    return out


@kernel
def _collapse(verts: _Floats, faces: _Index, twin: _Index, quadrics: _Floats, excess: int) -> None:
    """Remove as many faces as are too many; the corners of those that are gone become -1."""
    count, clock, before = len(faces), 0, excess + 1
    around, at = np.empty(count, np.int64), np.ones(4)
    state = np.zeros((len(verts), 4), np.int64)  # a half-edge from each vertex; of a border; last change; a mark
    for e in range(count):
        state[faces[e], 0] = e
        if twin[e] < 0:
            state[faces[e], 1] = state[faces[_of_face(e, 1)], 1] = 1
    heap = [(0.0, 0, 0) for _ in range(0)]
    while 0 < excess < before:  # what could not be collapsed may be now
        before = excess
        for e in range(count):
            if faces[e] >= 0 and e > twin[e]:
                heap.append((_place(e, verts, faces, state, quadrics, at), e, clock))
        heapq.heapify(heap)
        while len(heap) > 0 and excess > 0:
            _, h, time = heapq.heappop(heap)
            a, b = faces[h], faces[_of_face(h, 1)]
            if a < 0 or max(state[a, 2], state[b, 2]) > time:
                continue
            clock += 1
            _place(h, verts, faces, state, quadrics, at)
            if not _allowed(h, verts, faces, twin, state, around, at, 2 * clock):
                continue
            for i in range(_fan(state[b, 0], twin, around)):
                faces[around[i]] = a
            for g in (h, twin[h]):
                if g >= 0:
                    excess -= 1
                    following, last = _of_face(g, 1), _of_face(g, 2)
                    x, y, tip = twin[following], twin[last], faces[last]
                    if x >= 0:
                        twin[x], state[tip, 0], state[a, 0] = y, x, _of_face(x, 1)
                    if y >= 0:
                        twin[y], state[a, 0], state[tip, 0] = x, y, _of_face(y, 1)
                    faces[g] = faces[following] = faces[last] = -1
            for i in range(3):
                verts[a, i] = at[i]
            quadrics[a] += quadrics[b]
            state[a, 1] |= state[b, 1]
            state[a, 2] = state[b, 2] = clock
            for i in range(_fan(state[a, 0], twin, around)):
                for e in (around[i], _of_face(around[i], 2)):
                    if e == around[i] or twin[e] < 0:
                        heapq.heappush(heap, (_place(e, verts, faces, state, quadrics, at), e, clock))


@kernel
def _of_face(e: int, k: int) -> int:
    """Return the half-edge that comes k after one in its face."""
    return e - e % 3 + (e + k) % 3


@kernel
def _fan(e: int, twin: _Index, around: _Index) -> int:
    """Set the half-edges from the vertex from which one comes, one of each face; return their number."""
    number, h = 0, e
    while h >= 0:
        around[number] = h
        number += 1
        h = twin[_of_face(h, 2)]
        if h == e:
            return number
    h = twin[e]
    while h >= 0:
        around[number] = _of_face(h, 1)
        number += 1
        h = twin[_of_face(h, 1)]
    return number


@kernel
def _place(h: int, verts: _Floats, faces: _Index, state: _Index, quadrics: _Floats, at: _Floats) -> float:
    """Set the place of least error for the vertex that two become; return the error. Borders stay where they are."""
    a, b = faces[h], faces[_of_face(h, 1)]
    q, kept = quadrics[a] + quadrics[b], a if state[a, 1] > state[b, 1] else b
    for i in range(3):
        at[i] = verts[kept, i]
    if state[a, 1] == state[b, 1]:
        # The matrix is symmetric, and regular unless all faces are without area.
        xx, xy, xz, yy, yz, zz = q[0, 0], q[0, 1], q[0, 2], q[1, 1], q[1, 2], q[2, 2]
        first, second, third = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        det, x, y, z = xx * first + xy * second + xz * third, q[0, 3], q[1, 3], q[2, 3]
        if det > 1e-12 * (xx + yy + zz) ** 3:
            at[0] = -(first * x + second * y + third * z) / det
            at[1] = -(second * x + (xx * zz - xz * xz) * y + (xy * xz - xx * yz) * z) / det
            at[2] = -(third * x + (xy * xz - xx * yz) * y + (xx * yy - xy * xy) * z) / det
    error = 0.0
    for i in range(4):
        for j in range(4):
            error += q[i, j] * at[i] * at[j]
    return error


@kernel
def _allowed(
    h: int, verts: _Floats, faces: _Index, twin: _Index, state: _Index, around: _Index, at: _Floats, tick: int
) -> bool:
    """Return whether an edge keeps the link condition, and no face turns."""
    t, a, b = twin[h], faces[h], faces[_of_face(h, 1)]
    bordering = state[a, 1] + state[b, 1]
    if bordering == 2 if t >= 0 else max(twin[_of_face(h, 1)], twin[_of_face(h, 2)]) < 0:
        return False
    common, most = 0, 0
    for v in (a, b):
        number = _fan(state[v, 0], twin, around)
        most = max(most, number)
        for i in range(number):
            e = around[i]
            p, q = faces[_of_face(e, 1)], faces[_of_face(e, 2)]
            for w in (p, q):
                if v == a:
                    state[w, 3] = tick
                elif state[w, 3] == tick:
                    state[w, 3] = tick + 1
                    common += 1
            if e // 3 != h // 3 and (t < 0 or e // 3 != t // 3):
                before = np.cross(verts[p] - verts[v], verts[q] - verts[v])
                after = np.cross(verts[p] - at[:3], verts[q] - at[:3])
                product = (before**2).sum() * (after**2).sum()
                if product > 0 and (before * after).sum() < _TURN * np.sqrt(product):
                    return False
    # Of a tetrahedron nothing can be taken.
    return common == (1 if t < 0 else 2) and (most > 3 or bordering > 0)
