"""Blend the maps of pieces over a surface: each vertex goes to sum_i w_i A_i x.

With w0 (V, G) the share of the area around each vertex that is of each piece, and the graph's Laplacian K,

    (I + K) w = w0,    K_ij = -(l / |x_i - x_j|)^2 on edges,    l = 0.03 of the diagonal,

so that maps blend over about l on either side of a border; the rows of w are at least 0 and sum to 1. Vertices without
a part take the piece nearest to them, for little. Components that nearly touch are joined where they do, at vertices
and where a vertex of one lies on a face of another, with the median of the weights of edges. Weights of a large mesh
are means of those of a coarser one, whose vertices are the middles of what lies in a cell.

Source: Baran and Popovic 2007, Automatic rigging and animation of 3D characters (weights by diffusion).
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from meshdeform.exemplar.affine_maps import AffineMaps
from meshdeform.geometry.mesh import edges_of, face_areas
from meshdeform.nouns.deformed import Part
from meshdeform.nouns.labels import Flags, Floats, Index, solids_of
from meshdeform.reading.samples import spread

__all__ = ["blend_weights", "blended"]

_LENGTH = 0.03
_NEAR = 0.008
_CELL = 0.006
"""Of the vertices of a component in one cell of a grid of this size, one is joined to other components."""
_LEAST_EDGE = 1e-4
_UNKNOWN = 0.02
"""What the nearest piece weighs for a vertex without a part."""
_ON_FACES, _CANDIDATES = 6000, 4
_TOLERANCE, _MOST_STEPS = 1e-5, 400
_NONE = 1e-4
"""Weights below this are none."""
_MOST, _COARSE, _MEAN_OF = 12_000, 0.008, 6
"""Vertices from which on the weights are those of a coarser mesh, the size of its cells, and of how many a mean is."""


def blended(verts: Floats, maps: AffineMaps, weights: Floats) -> Floats:
    """Return the vertices (V, 3) where blended maps take them; `weights` (V, G)."""
    goal = np.zeros_like(verts)
    for piece in range(weights.shape[1]):
        rows = np.flatnonzero(weights[:, piece])
        goal[rows] += weights[rows, piece, None] * maps.map_points(verts[rows], piece)
    return goal


def blend_weights(verts: Floats, faces: Index, of_face: Index, loose: Flags) -> Floats:
    """Return the weight (V, G) of each piece for each vertex.

    `of_face` (F,): the piece of each face, or -1; `loose` (G,): pieces that are not joined to what they touch, such as
    wheels. Vertices without faces have no weights.
    """
    count = len(loose)
    share = _shares(verts, faces, of_face, count)
    used = np.unique(faces)
    number = np.full(len(verts), -1)
    number[used] = np.arange(len(used))
    own_verts, own_faces = verts[used], number[faces]
    start = share[used]
    mass = start.sum(1)
    unknown = mass == 0
    if unknown.any():
        known = np.flatnonzero(of_face >= 0)
        nearest = cKDTree(verts[faces[known]].mean(1)).query(own_verts[unknown])[1]
        start[unknown, of_face[known[nearest]]] = 1
        mass[unknown] = _UNKNOWN
    start /= start.sum(1, keepdims=True)
    if len(own_verts) > _MOST:
        solved = _by_fewer(own_verts, own_faces, start, mass, loose)
    else:
        solved = _solved(_graph(own_verts, own_faces, start @ loose > 0.5), mass, start)
    weights = np.zeros((len(verts), count))
    solved[solved < _NONE] = 0
    weights[used] = solved / solved.sum(1, keepdims=True)
    return weights


def _by_fewer(verts: Floats, faces: Index, start: Floats, mass: Floats, loose: Flags) -> Floats:
    """Return the weights (V, G) of a large mesh by those of a coarser one, of which each vertex takes a mean."""
    components = solids_of(Part(verts, faces))
    cells = np.floor((verts - verts.min(0)) / _COARSE).astype(np.int64)
    keys = np.column_stack([components, cells])
    of_vert = np.asarray(np.unique(keys, axis=0, return_inverse=True)[1], np.int64).ravel()
    count = int(of_vert.max()) + 1
    each = np.bincount(of_vert, mass, count)

    def mean(values: Floats) -> Floats:
        sums = [np.bincount(of_vert, mass * column, count) for column in values.T]
        return np.asarray(np.stack(sums, 1) / each[:, None])

    positions, fewer = mean(verts), of_vert[faces]
    kept = (fewer[:, 0] != fewer[:, 1]) & (fewer[:, 1] != fewer[:, 2]) & (fewer[:, 2] != fewer[:, 0])
    shares = mean(start)
    solved = _solved(_graph(positions, fewer[kept], shares @ loose > 0.5), np.minimum(each, 1.0), shares)
    home = np.zeros(count, np.int64)
    home[of_vert] = components
    # Components lie so far from each other that the nearest nodes are of the same one.
    apart = 4.0 * np.arange(int(components.max()) + 1)
    tree = cKDTree(np.column_stack([positions, apart[home]]))
    away, near = tree.query(np.column_stack([verts, apart[components]]), k=_MEAN_OF)
    share = np.square(np.maximum(1 - away / np.maximum(away[:, -1:], 1e-12), 0)) + 1e-9
    share[away > 1] = 0
    return np.asarray(np.einsum("vk,vkg->vg", share / share.sum(1, keepdims=True), solved[near]))


def _shares(verts: Floats, faces: Index, of_face: Index, count: int) -> Floats:
    """Return the share of the area around each vertex that is of each piece; rows without any are 0."""
    areas = face_areas(verts, faces) + 1e-12
    known = of_face >= 0
    key = (faces[known] * count + of_face[known, None]).ravel()
    sums = np.bincount(key, np.repeat(areas[known], 3), len(verts) * count).reshape(-1, count)
    total = sums.sum(1, keepdims=True)
    return np.asarray(np.divide(sums, total, out=np.zeros_like(sums), where=total > 0))


def _graph(verts: Floats, faces: Index, loose: Flags) -> sparse.csr_matrix:
    """Return the symmetric weights (V, V) between neighbours."""
    edges = edges_of(faces).edges
    edges = edges[edges[:, 0] != edges[:, 1]]
    length = np.maximum(np.linalg.norm(verts[edges[:, 0]] - verts[edges[:, 1]], axis=1), _LEAST_EDGE)
    weight = np.square(_LENGTH / length)
    joints = _joints(verts, faces, loose)
    usual = float(np.median(weight)) if len(weight) else 1.0
    one = np.concatenate([edges[:, 0], joints[:, 0]])
    other = np.concatenate([edges[:, 1], joints[:, 1]])
    graph = sparse.coo_matrix(
        (np.concatenate([weight, np.full(len(joints), usual)]), (one, other)), shape=(len(verts),) * 2
    ).tocsr()
    return graph + graph.T


def _joints(verts: Floats, faces: Index, loose: Flags) -> Index:
    """Return pairs (P, 2) of vertices of different components that touch."""
    component = solids_of(Part(verts, faces))
    if component.max() == 0:
        return np.zeros((0, 2), np.int64)
    cells = np.floor(verts / _CELL).astype(np.int64)
    few = np.unique(np.column_stack([component, cells]), axis=0, return_index=True)[1]
    few = few[~loose[few]]
    near = few[cKDTree(verts[few]).query_pairs(_NEAR, output_type="ndarray").astype(np.int64)]
    near = near[component[near[:, 0]] != component[near[:, 1]]]
    return np.concatenate([near, _on_faces(verts, faces, component, few)])


def _on_faces(verts: Floats, faces: Index, component: Index, few: Index) -> Index:
    """Return pairs of vertices and the nearest corner of the face of another component on which they lie."""
    edges = np.linalg.norm(verts[faces] - verts[np.roll(faces, 1, 1)], axis=2).max(1)
    broad = faces[edges > 2 * _NEAR]
    if not len(broad):
        return np.zeros((0, 2), np.int64)
    samples = spread(verts, broad, _ON_FACES, 9)
    spacing = 2 * float(np.sqrt(face_areas(verts, broad).sum() / _ON_FACES))
    away, nearest = cKDTree(samples.positions).query(verts[few], k=_CANDIDATES, distance_upper_bound=spacing)
    row, column = np.nonzero(np.isfinite(away))
    vert, on = few[row], samples.faces[nearest[row, column]]
    other = component[vert] != component[broad[on, 0]]
    vert, on = np.unique(np.column_stack([vert[other], on[other]]), axis=0).reshape(-1, 2).T
    corners = verts[broad[on]]
    close = _to_triangle(verts[vert], corners) < _NEAR
    vert, on, corners = vert[close], on[close], corners[close]
    corner = np.linalg.norm(corners - verts[vert][:, None], axis=2).argmin(1)
    return np.stack([vert, broad[on, corner]], 1)


def _to_triangle(points: Floats, corners: Floats) -> Floats:
    """Return the distance (N,) of points (N, 3) to triangles (N, 3, 3)."""
    a, b, c = corners.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    height = ((points - a) * normal).sum(1)
    best = np.full(len(points), np.inf)
    inside = np.ones(len(points), bool)
    for p, q in ((a, b), (b, c), (c, a)):
        edge = q - p
        inside &= (np.cross(edge, points - p) * normal).sum(1) >= 0
        t = ((points - p) * edge).sum(1) / np.maximum(np.square(edge).sum(1), 1e-30)
        best = np.minimum(best, np.linalg.norm(p + np.clip(t, 0, 1)[:, None] * edge - points, axis=1))
    return np.where(inside, np.abs(height), best)


def _solved(graph: sparse.csr_matrix, mass: Floats, start: Floats) -> Floats:
    """Solve (M + K) w = M w0 for all columns at once, by conjugate gradients with the diagonal."""
    diagonal = (mass + np.asarray(graph.sum(1)).ravel())[:, None]
    right = mass[:, None] * start
    x = start.copy()
    residual = right - (diagonal * x - graph @ x)
    scaled = residual / diagonal
    way = scaled.copy()
    square = (residual * scaled).sum(0)
    least = _TOLERANCE**2 * np.maximum((right * right / diagonal).sum(0), 1e-300)
    for _ in range(_MOST_STEPS):
        if (square <= least).all():
            break
        image = diagonal * way - graph @ way
        step = square / np.maximum((way * image).sum(0), 1e-300)
        x += step * way
        residual -= step * image
        scaled = residual / diagonal
        former, square = square, (residual * scaled).sum(0)
        way = scaled + square / np.maximum(former, 1e-300) * way
    return np.maximum(x, 0.0)
