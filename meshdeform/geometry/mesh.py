"""Represent triangle meshes, and compute their edges, areas, normals and connected components.

Any triangle soup is valid input: open borders, non-manifold edges, zero-area faces, several components. Nothing here
returns NaN, or a NaN or huge gradient, for them.

`RestMesh` computes its areas, edges, components and discrete differential operators at most once. The operators are
scipy sparse matrices in float64. The gradient of corner k's hat function on a face with unit normal n, area |f| and
opposite edge e_k is (n x e_k) / (2 |f|). With G these gradients and M the areas, the cotangent Laplacian is L = G^T M
G.

Source: Botsch et al. 2010, Polygon Mesh Processing, section 3.3; Pinkall and Polthier 1993.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.errors import ShapeError
from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.junctions import Junctions
from meshdeform.geometry.kernels import kernel

# Squared lengths below this count as zero: no mesh has such edges, and 1 / sqrt is still finite here.
_TINY_SQUARE = 1e-280
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


@dataclass(frozen=True)
class TriangleMesh:
    """Vertices and triangles.

    Raises
    ------
    ShapeError
        A shape or dtype is wrong, or a face refers to a vertex that does not exist.
    """

    verts: Tensor  # (V, 3) float64, on the CPU
    faces: Tensor  # (F, 3) int64, on the CPU, counter-clockwise from outside

    def __post_init__(self) -> None:
        if self.verts.ndim != 2 or self.verts.shape[1] != 3 or self.verts.dtype != torch.float64:
            raise ShapeError(f"expected verts (V, 3) float64, got {tuple(self.verts.shape)} {self.verts.dtype}")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or self.faces.dtype != torch.int64:
            raise ShapeError(f"expected faces (F, 3) int64, got {tuple(self.faces.shape)} {self.faces.dtype}")
        if self.faces.numel() and not (int(self.faces.min()) >= 0 and int(self.faces.max()) < self.verts.shape[0]):
            raise ShapeError("a face refers to a vertex that does not exist")


@dataclass(frozen=True)
class MeshEdges:
    """Unique edges with the first two faces of each."""

    edges: Tensor  # (E, 2) int64: end points, smaller index first
    faces: Tensor
    """(E, 2) int64: first and second face at the edge; -1 if there is no second one (open borders). Further faces of a
    non-manifold edge are not listed."""
    opposite: Tensor  # (E, 2) int64: third vertex of each of these faces, or -1
    counts: Tensor  # (E,) int64: number of faces at the edge: 1 at borders, more than 2 where the mesh is not manifold
    consistent: Tensor
    """(E,) bool: whether the two faces traverse the edge in opposite directions, as consistently oriented neighbours
    do."""


def face_cross(verts: Tensor, faces: Tensor) -> Tensor:
    """Return the cross product of two edges per face, (F, 3): along the normal, with twice the area as length."""
    # One index_select, not three fancy indexings: its backward pass is several times faster.
    a, b, c = verts.index_select(0, faces.reshape(-1)).view(-1, 3, 3).unbind(1)
    cross: Tensor = torch.linalg.cross(b - a, c - a)
    return cross


def safe_normalize(vectors: Tensor) -> Tensor:
    """Normalise vectors (..., 3); zero vectors stay zero and get a zero gradient."""
    square = (vectors * vectors).sum(-1, keepdim=True)
    usable = square > _TINY_SQUARE
    scale: Tensor = torch.where(usable, torch.rsqrt(torch.where(usable, square, 1.0)), 0.0)
    return vectors * scale


def face_areas(verts: Tensor, faces: Tensor) -> Tensor:
    """Return the areas (F,) in squared object units; the gradient of a zero area is zero."""
    cross = face_cross(verts, faces)
    square = (cross * cross).sum(-1)
    usable = square > _TINY_SQUARE
    doubled: Tensor = torch.where(usable, torch.where(usable, square, 1.0).sqrt(), 0.0)
    return 0.5 * doubled


def face_normals(verts: Tensor, faces: Tensor) -> Tensor:
    """Return unit normals (F, 3); zero, with a zero gradient, where a face has no area."""
    return safe_normalize(face_cross(verts, faces))


def edges_of(faces: Tensor) -> MeshEdges:
    """Find the unique edges of `faces` (F, 3) int64, in ascending order of their end points."""
    if not faces.numel():
        none = torch.zeros(0, 2, dtype=torch.int64, device=faces.device)
        return MeshEdges(none, none, none, none[:, 0], none[:, 0].bool())
    start, stop = faces[:, [1, 2, 0]].reshape(-1), faces[:, [2, 0, 1]].reshape(-1)
    opposite = faces.reshape(-1)
    owner = torch.arange(faces.shape[0], device=faces.device).repeat_interleave(3)
    low, high = torch.minimum(start, stop), torch.maximum(start, stop)
    n = int(faces.max()) + 1
    key, inverse, counts = torch.unique(low * n + high, return_inverse=True, return_counts=True)
    order = torch.argsort(inverse, stable=True)
    first = counts.cumsum(0) - counts
    second = (first + 1).clamp_max(order.numel() - 1)
    pair = torch.stack([order[first], torch.where(counts > 1, order[second], -1)], 1)
    missing, take = pair < 0, pair.clamp_min(0)
    forward = (start < stop)[take]
    return MeshEdges(
        torch.stack([torch.div(key, n, rounding_mode="floor"), key % n], 1),
        torch.where(missing, -1, owner[take]),
        torch.where(missing, -1, opposite[take]),
        counts,
        (counts > 1) & (forward[:, 0] != forward[:, 1]),
    )


def connected_components(faces: Tensor, n_verts: int) -> Tensor:
    """Return the component label (V,) int64 of every vertex; an unused vertex is its own component."""
    f = faces.numpy()
    rows, cols = np.concatenate([f[:, 0], f[:, 1]]), np.concatenate([f[:, 1], f[:, 2]])
    graph = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, cols)), shape=(n_verts, n_verts))
    _, labels = csgraph.connected_components(graph, directed=False)
    return torch.from_numpy(labels.astype(np.int64))


def _edges(mesh: TriangleMesh) -> tuple[_Floats, _Floats]:
    """Return the edges (F, 3, 3) opposite to each corner, counter-clockwise, and the cross products (F, 3)."""
    corners = mesh.verts.numpy()[mesh.faces.numpy()]
    edges = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]
    return edges, np.cross(edges[:, 1], edges[:, 2])


def effective_face_areas(mesh: TriangleMesh, *, collapsed_shape: float = COLLAPSED_SHAPE) -> _Floats:
    """Return areas (F,) in squared object units, exactly zero for collapsed faces: points, lines, thin needles."""
    edges, cross = _edges(mesh)
    areas = 0.5 * np.linalg.norm(cross, axis=1)
    longest_sq = (edges**2).sum(2).max(1, initial=0.0)
    return np.where(areas > collapsed_shape * longest_sq, areas, 0.0)


def gradient_operator(mesh: TriangleMesh, *, collapsed_shape: float = COLLAPSED_SHAPE) -> sparse.csr_matrix:
    """Build the gradient of piecewise-linear functions, (3F, V), 1 / object unit.

    Row 3 f + i maps vertex values to the i-th component of face f's gradient. Of a collapsed face, the gradient is the
    derivative along its longest edge, its only well-defined direction; a face that is one point has zero rows.
    """
    edges, cross = _edges(mesh)
    faces = mesh.faces.numpy()
    n_faces, n_verts = len(faces), mesh.verts.shape[0]
    solid = effective_face_areas(mesh, collapsed_shape=collapsed_shape) > 0
    squared = (cross**2).sum(1)
    # n / (2 |f|) is the cross product over its square.
    normal = cross / np.where(solid, squared, 1.0)[:, None]
    hats = np.where(solid[:, None, None], np.cross(normal[:, None], edges), 0.0)
    lengths_sq = (edges**2).sum(2)
    thin = np.flatnonzero(~solid & (lengths_sq.max(1, initial=0.0) > 0))
    longest = lengths_sq[thin].argmax(1) if len(thin) else thin
    along = edges[thin, longest] / lengths_sq[thin, longest][:, None]
    hats[thin, (longest + 2) % 3] = along
    hats[thin, (longest + 1) % 3] = -along
    rows = np.broadcast_to(np.arange(3 * n_faces).reshape(n_faces, 1, 3), hats.shape)
    columns = np.broadcast_to(faces[:, :, None], hats.shape)
    return sparse.csr_matrix((hats.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * n_faces, n_verts))


def mass_matrix(mesh: TriangleMesh, *, collapsed_shape: float = COLLAPSED_SHAPE) -> sparse.dia_matrix:
    """Build the diagonal matrix of face areas, three rows per face: (3F, 3F)."""
    return sparse.diags(np.repeat(effective_face_areas(mesh, collapsed_shape=collapsed_shape), 3))


def vertex_areas(mesh: TriangleMesh, *, collapsed_shape: float = COLLAPSED_SHAPE) -> _Floats:
    """Return a third of the total area of the faces around each vertex, (V,)."""
    areas = np.repeat(effective_face_areas(mesh, collapsed_shape=collapsed_shape) / 3, 3)
    return np.bincount(mesh.faces.numpy().ravel(), weights=areas, minlength=mesh.verts.shape[0]).astype(np.float64)


def cotangent_laplacian(mesh: TriangleMesh, *, collapsed_shape: float = COLLAPSED_SHAPE) -> sparse.csr_matrix:
    """Build the positive semi-definite cotangent Laplacian L = G^T M G, (V, V), dimensionless."""
    gradient = gradient_operator(mesh, collapsed_shape=collapsed_shape)
    return (gradient.T @ mass_matrix(mesh, collapsed_shape=collapsed_shape) @ gradient).tocsr()


def sparse_product(matrix: sparse.csr_matrix, dense: Tensor) -> Tensor:
    """Multiply a constant (N, M) matrix by a tensor (M, K) float64, differentiable once in the tensor.

    scipy computes the product: it takes a third of the time of torch's at the size of a rest mesh, without warnings.
    """
    result: Tensor = _SparseProduct.apply(matrix, dense)  # type: ignore[no-untyped-call]
    return result


class _SparseProduct(torch.autograd.Function):
    @staticmethod
    def forward(ctx: FunctionCtx, matrix: sparse.csr_matrix, dense: Tensor) -> Tensor:
        ctx.matrix = matrix  # type: ignore[attr-defined]
        return torch.from_numpy(matrix @ dense.detach().numpy())

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[None, Tensor]:
        return None, torch.from_numpy(ctx.matrix.T @ gradient.numpy())  # type: ignore[attr-defined]


@dataclass(frozen=True)
class RestMesh(TriangleMesh):
    """A triangle mesh that does not move, with operators that are computed on first access."""

    collapsed_shape: float = COLLAPSED_SHAPE
    """Faces whose area over their longest edge squared is at most this count as collapsed. The Poisson system raises it
    if the matrix cannot be factored otherwise; use the system's `rest` to agree with it."""

    @classmethod
    def of(cls, mesh: TriangleMesh) -> RestMesh:
        """Return the mesh itself if it is a `RestMesh`, otherwise one with the same vertices and faces."""
        return mesh if isinstance(mesh, cls) else cls(mesh.verts, mesh.faces)

    @cached_property
    def areas(self) -> NDArray[np.float64]:
        """Areas (F,) in squared object units, zero for collapsed faces."""
        return effective_face_areas(self, collapsed_shape=self.collapsed_shape)

    @cached_property
    def solid(self) -> NDArray[np.bool_]:
        """Flags (F,) of the faces that are not collapsed."""
        return self.areas > 0

    @cached_property
    def box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The lowest and the highest corner (3,) of the bounding box of the faces."""
        used = self.verts.numpy()[np.unique(self.faces.numpy())]
        return used.min(0), used.max(0)

    @cached_property
    def normals(self) -> Tensor:
        """Unit normals (F, 3) float64; zero where a face has no area at all."""
        return face_normals(self.verts, self.faces)

    @cached_property
    def vertex_areas(self) -> NDArray[np.float64]:
        """A third of the total area of the faces around each vertex, (V,)."""
        return vertex_areas(self, collapsed_shape=self.collapsed_shape)

    @cached_property
    def gradient(self) -> sparse.csr_matrix:
        """Gradient operator (3F, V), 1 / object unit."""
        return gradient_operator(self, collapsed_shape=self.collapsed_shape)

    @cached_property
    def laplacian(self) -> sparse.csr_matrix:
        """Cotangent Laplacian (V, V), positive semi-definite, dimensionless."""
        return cotangent_laplacian(self, collapsed_shape=self.collapsed_shape)

    @cached_property
    def edges(self) -> MeshEdges:
        """Unique edges with their faces."""
        return edges_of(self.faces)

    @cached_property
    def components(self) -> Tensor:
        """Connected component (V,) int64 of each vertex; an unused vertex is its own component."""
        return connected_components(self.faces, self.verts.shape[0])

    @cached_property
    def num_components(self) -> int:
        """Number of connected components."""
        return int(self.components.max()) + 1 if self.components.numel() else 0

    @cached_property
    def junctions(self) -> Junctions:
        """Vertices on edges of faces that they are no corner of, which follow those edges."""
        return Junctions.of(self.verts.numpy(), self.faces.numpy())

    @cached_property
    def joined(self) -> NDArray[np.int64]:
        """The connected component (V,) of each vertex, from 0, with those as one that a junction joins."""
        return self.junctions.joined(self.components.numpy()) if len(self.junctions) else self.components.numpy()

    @cached_property
    def incidence(self) -> sparse.csr_matrix:
        """Incidence matrix (F, V), one where a face has a vertex."""
        count = self.faces.shape[0]
        rows, columns = np.arange(3 * count) // 3, self.faces.numpy().ravel()
        return sparse.csr_matrix((np.ones(3 * count), (rows, columns)), shape=(count, self.verts.shape[0]))

    @cached_property
    def edge_adjacency(self) -> sparse.csr_matrix:
        """Adjacency matrix (F, F), one where two faces share an edge."""
        pairs = self.edges.faces[self.edges.faces[:, 1] >= 0].numpy()
        rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
        count = self.faces.shape[0]
        return sparse.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))

    def centre_of_mass(self) -> Tensor:
        """Return the centroid (3,) of the surface: the mean of the vertices, weighted by their areas."""
        weights = torch.from_numpy(self.vertex_areas)
        if not float(weights.sum()) > 0:
            return self.verts.mean(0)
        return (weights / weights.sum()) @ self.verts


@kernel
def through_normals(
    verts: _Floats, faces: _Index, normals: _Floats, inverse: _Floats, d_normals: _Floats, gradient: _Floats
) -> None:
    """Add the gradient (V, 3) of the vertices that the gradient (F, 3) of the unit normals means.

    `inverse` (F,) are the inverse lengths of the cross products; zero of a face without an area, which has no gradient.
    """
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        along = 0.0
        for c in range(3):
            along += normals[f, c] * d_normals[f, c]
        gx = (d_normals[f, 0] - along * normals[f, 0]) * inverse[f]
        gy = (d_normals[f, 1] - along * normals[f, 1]) * inverse[f]
        gz = (d_normals[f, 2] - along * normals[f, 2]) * inverse[f]
        bx, by, bz = verts[j, 0] - verts[i, 0], verts[j, 1] - verts[i, 1], verts[j, 2] - verts[i, 2]
        cx, cy, cz = verts[k, 0] - verts[i, 0], verts[k, 1] - verts[i, 1], verts[k, 2] - verts[i, 2]
        jx, jy, jz = cy * gz - cz * gy, cz * gx - cx * gz, cx * gy - cy * gx
        kx, ky, kz = gy * bz - gz * by, gz * bx - gx * bz, gx * by - gy * bx
        gradient[j, 0] += jx
        gradient[j, 1] += jy
        gradient[j, 2] += jz
        gradient[k, 0] += kx
        gradient[k, 1] += ky
        gradient[k, 2] += kz
        gradient[i, 0] -= jx + kx
        gradient[i, 1] -= jy + ky
        gradient[i, 2] -= jz + kz
