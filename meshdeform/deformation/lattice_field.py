"""Optimise the Jacobians of a lattice's cells in place of those of the faces: ``verts = W solve(J)``.

One smooth map of space carries all components, so what belongs together stays together. The penalties are those of the
cells:

* jacobian   1/C  sum_c ||J_c - I||^2
* dirichlet  1/C  sum_c b log(1 + (||F_c||^2 + ||F_c^-1||^2 - 6) / b)   with F_c the map of a cell, from the mean of its
  four edges along each axis: zero where no length changes; b as of `regularizers.py`.

Source: Smith and Schaefer 2015, Bijective Parameterization with Free Boundaries, eq. 2, for tetrahedra.

Let details follow the large faces that they lie on.

A face stays flat while the map of space bends, so the chord of a face that is longer than a cell leaves the map: a beam
would sink into its wall, a window come off its door. With W(p) x where the map has p for the nodes x, a vertex p near
a larger face of a component that its own one touches follows that face::

    x(p) = W(p) x + s(d) (sum_i b_i x(v_i) - W(q) x)

with q the nearest point on the face, b its barycentric coordinates, v_i the corners, and s(d) falling from 1 to 0 over
the distances d = |p - q| from half a cell to a whole one. Only the weights with which vertices follow the nodes change,
so it costs no step anything. A vertex follows only faces larger than all of its own; the corners of the face may follow
a larger one themselves, or lie on an edge of another face, which they then follow (`geometry/junctions.py`).

Enclose a mesh in a voxel lattice, and solve for its nodes from one Jacobian per cell.

The lattice has every cell that the surface touches or encloses and one ring of cells around them; separate islands are
joined. With d_e the vector of an axis edge e of length h along axis a, and C_e the cells around it::

    min_x  sum_e |C_e| / 4  || d_e(x) - h / |C_e| sum_{c in C_e} J_c e_a ||^2

The normal matrix is the seven-point Laplacian of the lattice, which is factored once. Any point follows the nodes by
quadratic B-splines, which reproduce affine maps exactly, so the lattice carries all components of an asset with one
smooth map of space. It costs the same whatever the number of triangles.

Sources: Huang et al. 2006, Subspace Gradient Domain Mesh Deformation (solving on a coarse volumetric control mesh);
Spillmann et al. 2006, Robust Tetrahedral Meshing of Triangle Soups, and Dionne and de Lasa 2013, Geodesic Voxel Binding
(cells that a surface touches or encloses, of any soup).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree
from torch import Tensor

from meshdeform.deformation.constraints import UNCONSTRAINED, Constraints, RigidBody
from meshdeform.deformation.degrees_of_freedom import DegreesOfFreedom, Hierarchy, OwnJacobians
from meshdeform.deformation.differentiable import placed_by
from meshdeform.deformation.handles import Handles
from meshdeform.deformation.poisson import factorise
from meshdeform.deformation.regularizers import STRAINED, penalty
from meshdeform.deformation.rigid_bodies import RigidBodies
from meshdeform.deformation.structure import Structure
from meshdeform.deformation.variables import Elements, IntegratedJacobians
from meshdeform.errors import NumericalError, ParameterError
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.large_faces import LargeFaces, nearest_larger_faces
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.surface_samples import count_samples, sample_blocks
from meshdeform.geometry.tensors import sparse_product, verts_of

CELLS = 24
"""Cells along the longest side of the asset's bounding box."""

MAX_CELLS = 8000
"""Solid blocks would have many more, and the factor of their matrix a hundred times the entries."""

MAX_SAMPLES = 20_000_000
"""Points by which the cells that faces touch are found. Only thousands of large faces in one place have more."""

_LEAST_CELLS = 4
_PADDING = 4
_NEIGHBOURS = np.ones((3, 3, 3), bool)
_CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))
_Flags = NDArray[np.bool_]
_LEAST_VOLUME = 1e-6
"""Lower bound of a cell's relative volume in its energy."""
_SIDES = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))  # of a cell on which each corner lies, by axis
_CORRECTIONS = 3
_CHUNK = 50_000
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_MOST_FOLLOWED = 64
"""Faces and edges that are followed one after the other; with each, what is left becomes less."""
_CONTACT, _FULLY = 0.1, 0.5
"""Distances, in cells, up to which a component touches a face, and up to which its vertices follow that fully."""


@dataclass(frozen=True)
class Lattice:
    """Cells, nodes and axis edges around a mesh."""

    origin: _Floats  # (3,) float64: position of node (0, 0, 0) of the grid
    spacing: float  # length h of a cell's edges, in object units
    shape: tuple[int, int, int]  # number of nodes of the whole grid along each axis
    cells: _Index  # (C, 3) int64: grid coordinates of each cell's lowest corner
    keys: _Index  # (N,) int64: flat grid indices of the nodes, ascending
    cell_nodes: _Index  # (C, 8) int64: corners of each cell, in the order of `itertools.product((0, 1), repeat=3)`
    edges: _Index  # (E, 2) int64: end points of each axis edge, in the direction of its axis
    cell_edges: _Index  # (C, 3, 4) int64: edges of each cell along each axis, ordered by the two other coordinates
    coarse: bool = False
    """Whether its cells are larger because the samples of the faces would be more than `MAX_SAMPLES`."""

    @classmethod
    def around(cls, mesh: RestMesh, resolution: int = CELLS, planes: Sequence[int] = ()) -> Lattice:
        """Build the lattice of a mesh.

        Parameters
        ----------
        mesh : RestMesh
            Any soup of triangles.
        resolution : int
            Cells along the longest side of the bounding box; fewer if there would be more than `MAX_CELLS` in all, or
            more than `MAX_SAMPLES` points to find them by.
        planes : sequence of int
            The axes across which the cells are to be mirror images of each other.
        """
        coarse = resolution > (resolution := _affordable(mesh, resolution))
        lattice = cls._of_resolution(mesh, resolution, planes)
        while len(lattice.cells) > MAX_CELLS:
            resolution = min(resolution - 1, int(resolution * (MAX_CELLS / len(lattice.cells)) ** (1 / 3)))
            lattice = cls._of_resolution(mesh, resolution, planes)
        return replace(lattice, coarse=coarse)

    @classmethod
    def _of_resolution(cls, mesh: RestMesh, resolution: int, planes: Sequence[int]) -> Lattice:
        from scipy import ndimage  # a part of scipy that meshes of one component do not need

        verts, faces = mesh.verts, mesh.faces
        used = verts[np.unique(faces)]
        low, high = used.min(0), used.max(0)
        spacing = float((high - low).max()) / resolution
        counts = np.ceil((high - low) / spacing).astype(int) + 2 * _PADDING
        # Centred, so that the lattice of a symmetric mesh is symmetric.
        origin = (low + high) / 2 - counts * spacing / 2
        occupied = np.zeros(counts, bool)
        for points, _ in sample_blocks(verts, faces, spacing / 2):
            occupied[tuple(np.floor((points - origin) / spacing).astype(int).T)] = True
        occupied = _in_one_piece(ndimage.binary_fill_holes(occupied))
        for axis in planes:
            occupied = occupied | np.flip(occupied, axis)
        occupied = ndimage.binary_dilation(occupied, _NEIGHBOURS)
        shape = (int(counts[0]) + 1, int(counts[1]) + 1, int(counts[2]) + 1)
        cells = np.argwhere(occupied)
        keys, cell_nodes = np.unique(
            np.ravel_multi_index((cells[:, None] + _CORNERS).reshape(-1, 3).T, shape), return_inverse=True
        )
        cell_nodes = cell_nodes.reshape(-1, 8)
        edges, cell_edges = _axis_edges(cell_nodes)
        return cls(origin, spacing, shape, cells, keys, cell_nodes, edges, cell_edges)

    @property
    def warnings(self) -> list[str]:
        """A sentence for the user if the cells are larger than they should be."""
        if not self.coarse:
            return []
        return [
            f"So many large faces lie on or in each other that the lattice is coarser, with {len(self.cells):,} cells. "
            "Remove copies that are in one place."
        ]

    @property
    def nodes(self) -> _Floats:
        """Rest positions of the nodes, (N, 3)."""
        return self.origin + self.spacing * np.stack(np.unravel_index(self.keys, self.shape), 1)

    def embedding(self, points: _Floats) -> sparse.csr_matrix:
        """Return the weights (P, N) with which points (P, 3) inside of the lattice follow the nodes.

        Quadratic B-splines centred at the nodes: 27 weights per point, which sum to 1 and reproduce the points.
        """
        scaled = (points - self.origin) / self.spacing
        nearest = np.rint(scaled).astype(np.int64)
        offset = scaled - nearest
        weights = np.stack([0.5 * (0.5 - offset) ** 2, 0.75 - offset**2, 0.5 * (0.5 + offset) ** 2], 2)
        columns = np.empty((len(points), 27), np.int64)
        values = np.empty((len(points), 27))
        for number, (i, j, k) in enumerate(itertools.product(range(3), repeat=3)):
            key = np.ravel_multi_index((nearest + np.array([i, j, k]) - 1).T, self.shape, mode="clip")
            columns[:, number] = np.minimum(np.searchsorted(self.keys, key), len(self.keys) - 1)
            values[:, number] = weights[:, 0, i] * weights[:, 1, j] * weights[:, 2, k]
            inside = self.keys[columns[:, number]] == key
            if (values[~inside, number] > 1e-12).any():
                raise ValueError("a point is not inside of the lattice")
            values[~inside, number] = 0.0
        rows = np.arange(len(points) + 1) * 27
        return sparse.csr_matrix((values.ravel(), columns.ravel(), rows), shape=(len(points), len(self.keys)))

    def cells_of_faces(self, verts: _Floats, faces: _Index) -> _Flags:
        """Return flags (C,) of the cells that contain a sample of one of these faces (F, 3)."""
        lookup = np.full(np.array(self.shape) - 1, -1)
        lookup[tuple(self.cells.T)] = np.arange(len(self.cells))
        holding = np.zeros(len(self.cells), bool)
        for points, _ in sample_blocks(verts, faces, self.spacing / 2):
            holding[lookup[tuple(np.floor((points - self.origin) / self.spacing).astype(int).T)]] = True
        return holding


def _affordable(mesh: RestMesh, resolution: int) -> int:
    """Return a resolution with at most `MAX_SAMPLES` samples, if there is one."""
    verts, faces = mesh.verts, mesh.faces
    size = float(np.ptp(verts[np.unique(faces)], axis=0).max())
    while resolution > _LEAST_CELLS and count_samples(verts, faces, size / resolution / 2) > MAX_SAMPLES:
        resolution -= 1
    return resolution


class LatticeSystem:
    """Factored system that gives the nodes for the Jacobians of the cells.

    `weights`, (N,) float64: weights, summing to 1, of the mean of the nodes that a solve keeps where it is at rest.
    `pinned`, (N,) bool: nodes that stay exactly where they are at rest; if there are any, they determine the position
    instead of the mean. Raises NumericalError: the matrix could not be factored.
    """

    def __init__(self, lattice: Lattice, weights: _Floats, pinned: _Flags | None = None) -> None:
        count, n_edges = len(lattice.cells), len(lattice.edges)
        around = np.bincount(lattice.cell_edges.ravel(), minlength=n_edges)
        ends = lattice.edges.ravel()
        difference = sparse.csr_matrix(
            (np.tile([-1.0, 1.0], n_edges), (np.repeat(np.arange(n_edges), 2), ends)),
            shape=(n_edges, len(lattice.keys)),
        )
        # Row 3 c + a of the field is column a of the Jacobian of cell c.
        column = np.broadcast_to(3 * np.arange(count)[:, None, None] + np.arange(3)[:, None], (count, 3, 4)).ravel()
        row = lattice.cell_edges.ravel()
        target = sparse.csr_matrix((lattice.spacing / around[row], (row, column)), shape=(n_edges, 3 * count))
        weighted = difference.T @ sparse.diags(around / 4.0)
        matrix = (weighted @ difference).tocsr()
        held = pinned is not None and bool(pinned.any())
        self._pinned = pinned if pinned is not None else np.zeros(len(lattice.keys), bool)
        factor = factorise(matrix, np.flatnonzero(~self._pinned)[0 if held else 1 :])
        if factor is None:
            raise NumericalError("The lattice's Laplacian could not be factored.")
        self._factor = factor
        self._divergence = (weighted @ target).tocsr()
        self._divergence_t = self._divergence.T.tocsr()
        self._rest = lattice.nodes
        self._pull = matrix[:, self._pinned] @ self._rest[self._pinned] if held else None
        self._weights = np.zeros_like(weights) if held else weights
        self._rest_mean = self._weights @ self._rest

    def solve(self, jacobians: _Floats) -> _Floats:
        """Return the nodes (N, 3) float64 that best fit Jacobians (C, 3, 3) float64."""
        field = np.ascontiguousarray(jacobians.transpose(0, 2, 1)).reshape(-1, 3)
        right = self._divergence @ field
        nodes: _Floats = self._factor.solve(right if self._pull is None else right - self._pull)
        if not np.isfinite(nodes).all():
            raise NumericalError("The Jacobians are not finite, or too large to solve for.")
        nodes += self._rest_mean - self._weights @ nodes
        nodes[self._pinned] = self._rest[self._pinned]
        return nodes

    def solve_transposed(self, gradient: _Floats) -> _Floats:
        """Return the gradient (C, 3, 3) of the Jacobians for a gradient (N, 3) of the nodes."""
        field = self._divergence_t @ self._factor.solve(self._balanced(gradient))
        return np.ascontiguousarray(field.reshape(-1, 3, 3).transpose(0, 2, 1))

    def smooth(self, forces: _Floats) -> _Floats:
        """Return the displacements (N, 3) of the nodes under forces (N, 3), as `PoissonSystem.smooth` does."""
        return self._response(self._response(forces))

    def _response(self, forces: _Floats) -> _Floats:
        moved: _Floats = self._factor.solve(self._balanced(forces))
        moved -= self._weights @ moved
        return moved

    def _balanced(self, forces: _Floats) -> _Floats:
        balanced: _Floats = forces - self._weights[:, None] * forces.sum(0)
        return balanced


def _axis_edges(cell_nodes: _Index) -> tuple[_Index, _Index]:
    """Return the edges (E, 2) along the axes, and those of each cell (C, 3, 4)."""
    number = {tuple(corner): i for i, corner in enumerate(_CORNERS.tolist())}
    tails, heads = [], []
    for axis in range(3):
        for corner in _CORNERS[_CORNERS[:, axis] == 0].tolist():
            tails.append(number[tuple(corner)])
            heads.append(number[tuple(np.asarray(corner) + np.eye(3, dtype=int)[axis])])
    pairs = np.stack([cell_nodes[:, tails], cell_nodes[:, heads]], 2).reshape(-1, 2)
    edges, inverse = np.unique(pairs, axis=0, return_inverse=True)
    return edges, inverse.reshape(len(cell_nodes), 3, 4)


def _in_one_piece(occupied: _Flags) -> _Flags:
    """Join separate islands of cells to the largest one by the shortest lines of cells."""
    from scipy import ndimage

    labels, count = ndimage.label(occupied, _NEIGHBOURS)
    if count < 2:
        return occupied
    occupied = occupied.copy()
    islands = [np.argwhere(labels == number) for number in range(1, count + 1)]
    reached = islands.pop(max(range(count), key=lambda number: len(islands[number])))
    while islands:
        tree = cKDTree(reached)
        matches = [tree.query(island) for island in islands]
        nearest = min(range(len(islands)), key=lambda number: float(matches[number][0].min()))
        distances, ends = matches[nearest]
        island = islands.pop(nearest)
        begin = island[distances.argmin()]
        end = reached[ends[distances.argmin()]]
        steps = int(np.abs(end - begin).max()) + 1
        line = np.rint(begin + (end - begin) * np.linspace(0, 1, steps)[:, None]).astype(int)
        occupied[tuple(line.T)] = True
        reached = np.concatenate([reached, island, line])
    return occupied


class LatticeField(IntegratedJacobians):
    """One Jacobian per cell of a lattice around the mesh. Implements `deformation.variables.Variables`.

    `mesh`: at rest; `whole`: another mesh that the lattice encloses as well, to be moved with it. `bodies`: vertices
    that keep their shape; they follow the nodes by the motion that fits best. `constraints`: of `mesh`: all nodes that
    a kept vertex follows are pinned in the solve, and handles are part of it. `structure`: what few degrees of
    freedom keep. None: every cell has a Jacobian of its own. Raises ParameterError: all nodes that move anything are
    pinned.
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        whole: TriangleMesh | None = None,
        bodies: Sequence[RigidBody] = (),
        constraints: Constraints = UNCONSTRAINED,
        structure: Structure | None = None,
    ) -> None:
        planes = () if structure is None else structure.planes
        self.rest = rest = RestMesh.of(mesh)
        self._bodies = RigidBodies(rest, bodies) if bodies else None
        enclosed = rest if whole is None or whole is mesh else _joined(rest, whole)
        self.lattice = lattice = Lattice.around(enclosed, planes=planes)
        self._embedding = lattice.embedding(rest.verts) + pull_of_large_faces(lattice, rest)
        areas = rest.vertex_areas
        shares = areas / areas.sum() if areas.sum() > 0 else np.full(len(areas), 1 / len(areas))
        weights = _balanced(lattice, self._embedding.T @ shares, planes)
        system = LatticeSystem(lattice, weights, self._pinned(constraints))
        self._placement = constraints.placement(rest)
        self._follow = None if self._bodies is None else _followers(rest, self._bodies, constraints)
        requested = constraints.handles
        handles = Handles(requested, rest, self._placement, self._embedding, system.smooth) if requested else None
        count = len(lattice.cells)
        rigid = None if self._bodies is None else np.asarray(self._bodies.members[rest.faces].any(1))
        self.elements = Elements(lattice.cell_nodes, np.zeros(count, np.int64), self._cells_around, rigid)
        self.resolution = lattice.spacing
        freedom: DegreesOfFreedom = OwnJacobians("cell_jacobians", count)
        if structure is not None:
            centres = lattice.origin + (lattice.cells + 0.5) * lattice.spacing
            freedom = Hierarchy("cell", centres, None, rest.box, structure)
        super().__init__(system, freedom, handles)

    def _cells_around(self, flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return flags (C,) of the cells of these faces (F,) and of their neighbours, on which folds depend as well."""
        flags = flags | (self.rest.edge_adjacency @ flags.astype(np.float64) > 0)
        return self.lattice.cells_of_faces(self.rest.verts, self.rest.faces[flags])

    def _pinned(self, constraints: Constraints) -> NDArray[np.bool_] | None:
        """Return flags (N,) of the nodes that kept vertices follow; None if nothing is kept."""
        kept = constraints.kept
        if kept is None:
            return None
        pinned = np.zeros(len(self.lattice.keys), bool)
        followed = self._embedding[np.flatnonzero(kept)]
        pinned[followed.indices[followed.data > 0]] = True
        if not self._embedding[np.flatnonzero(~kept)][:, np.flatnonzero(~pinned)].sum() > 0:
            raise ParameterError(
                "params.control.regions: what is kept is near all of the rest, so the lattice cannot move anything.",
                advice="Keep less, or set params.carrier to surface.",
            )
        return pinned

    def verts(self, control_points: Tensor) -> Tensor:
        """Return the vertices that follow the nodes, placed where the constraints allow."""
        points = sparse_product(self._embedding, control_points)
        if self._placement is not None:
            points = placed_by(self._placement, points)
        if self._bodies is None:
            return points
        points = self._bodies.place(points)
        if self._follow is None:
            return points
        # What lies on an edge of a body follows it, once the body is in shape.
        rest = verts_of(self.rest)
        return rest + sparse_product(self._follow, points - rest)

    def moved(self, whole: RestMesh) -> Tensor:
        """Return the vertices (V, 3) float64 of another mesh inside of the lattice, moved with its current nodes."""
        with torch.no_grad():
            nodes, points = self.solve().numpy(), whole.verts
        # In chunks, since each point has 27 weights.
        chunks = [self.lattice.embedding(points[at : at + _CHUNK]) @ nodes for at in range(0, len(points), _CHUNK)]
        return torch.from_numpy(np.concatenate(chunks) + pull_of_large_faces(self.lattice, whole) @ nodes)

    def jacobian_penalty(self) -> Tensor:
        """Return the mean of ||J - I||^2 over the cells."""
        rigid = torch.eye(3, dtype=torch.float64)
        mean: Tensor = (self.jacobians() - rigid).square().sum((1, 2)).mean()
        return mean

    def dirichlet_penalty(self, control_points: Tensor) -> Tensor:
        """Return the mean logarithm of the cells' symmetric Dirichlet energy."""
        cells, spacing = self.lattice.cell_nodes, self.lattice.spacing
        return penalty(lambda nodes, gradient: cells_dirichlet_penalty(nodes, cells, spacing, gradient), control_points)

    def adopt(self, control_points: Tensor) -> None:
        """Correct the Jacobians until they give these nodes, but for differences that alternate from node to node.

        A cell takes the mean gradient of what is missing over its edges, so cells around which nothing is missing
        hardly change.
        """
        with torch.no_grad():
            for _ in range(_CORRECTIONS):
                missing = (control_points - self.solve())[self.lattice.cell_nodes]
                gradient = torch.einsum("cni,na->cia", missing, torch.from_numpy(_SIDES)) / (4 * self.lattice.spacing)
                self._freedom.correct(gradient)


def _followers(rest: RestMesh, bodies: RigidBodies, constraints: Constraints) -> sparse.csr_matrix | None:
    """Return what takes vertices (V, V) to edges of bodies and others; None if there are none on an edge."""
    held = bodies.members if constraints.kept is None else bodies.members | constraints.kept
    junctions = rest.junctions.without(held)
    return junctions.follow if len(junctions) else None


@kernel
def cells_dirichlet_penalty(nodes: _Floats, cells: _Index, spacing: float, gradient: _Floats | None) -> float:
    """Return the mean logarithm of the cells' symmetric Dirichlet energy; add its gradient (N, 3).

    `nodes` is (N, 3) float64; `cells`, (C, 8) int64: corners of each cell, as of `Lattice.cell_nodes`.
    """
    total, unit = 0.0, 1 / (4 * spacing)
    f, cross, by = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for c in range(len(cells)):
        f[:] = 0.0
        for n in range(8):
            for a in range(3):
                for i in range(3):
                    f[a, i] += _SIDES[n, a] * unit * nodes[cells[c, n], i]
        for a in range(3):
            b, d = (a + 1) % 3, (a + 2) % 3
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                cross[a, i] = f[b, j] * f[d, k] - f[b, k] * f[d, j]
        squares, cofactors, exact = (f**2).sum(), (cross**2).sum(), (f[0] * cross[0]).sum()
        volume = max(exact, _LEAST_VOLUME)
        energy = squares + cofactors / volume**2 - 6
        total += STRAINED * math.log1p(energy / STRAINED)
        if gradient is None:
            continue
        weight = 2 * unit / (len(cells) * (1 + energy / STRAINED))
        by_volume = -cofactors / volume**3 if exact >= _LEAST_VOLUME else 0.0
        for a in range(3):
            for i in range(3):
                turned = squares * f[a, i]  # half the derivative of the cofactors: |F|^2 F - F F^T F
                for b in range(3):
                    turned -= (f[a, 0] * f[b, 0] + f[a, 1] * f[b, 1] + f[a, 2] * f[b, 2]) * f[b, i]
                by[a, i] = weight * (f[a, i] + turned / volume**2 + by_volume * cross[a, i])
        for n in range(8):
            for a in range(3):
                for i in range(3):
                    gradient[cells[c, n], i] += _SIDES[n, a] * by[a, i]
    return total / len(cells)


def _balanced(lattice: Lattice, weights: _Floats, planes: Sequence[int]) -> _Floats:
    """Return the mean of weights (N,) with their mirror images, so that the planes of a symmetric asset stay."""
    for plane in planes:
        indices = np.stack(np.unravel_index(lattice.keys, lattice.shape), 1)
        indices[:, plane] = lattice.shape[plane] - 1 - indices[:, plane]
        partner = np.searchsorted(lattice.keys, np.ravel_multi_index(indices.T, lattice.shape))
        weights = (weights + weights[partner]) / 2
    return weights


def _joined(mesh: TriangleMesh, other: TriangleMesh) -> RestMesh:
    """Return the surface of both meshes."""
    faces = np.concatenate([mesh.faces, other.faces + len(mesh.verts)])
    return RestMesh(np.concatenate([mesh.verts, other.verts]), faces)


def pull_of_large_faces(lattice: Lattice, mesh: RestMesh) -> sparse.csr_matrix:
    """Return the corrections (V, N) of the weights with which the vertices of a mesh follow the nodes of a lattice."""
    verts, faces = mesh.verts, mesh.faces
    nothing = sparse.csr_matrix((len(verts), len(lattice.keys)))
    corners = verts[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    large = np.flatnonzero(longest > lattice.spacing)
    own = np.zeros(len(verts))
    np.maximum.at(own, faces.ravel(), np.repeat(mesh.areas, 3))
    component = mesh.components
    large_faces = LargeFaces(corners[large], mesh.areas[large], component[faces[large, 0]])
    reaches = (_CONTACT * lattice.spacing, lattice.spacing)
    nearest, shares, distances = nearest_larger_faces(verts, own, component, large_faces, *reaches)
    nearest[mesh.junctions.verts] = -1  # these follow edges, whatever else is near
    followers = np.flatnonzero(nearest >= 0)
    if not len(followers):
        return nothing
    face, shares = large[nearest[followers]], shares[followers]
    near = 1 - np.clip((distances[followers] / lattice.spacing - _FULLY) / (1 - _FULLY), 0, 1)
    strength = (near**2 * (3 - 2 * near))[:, None]
    followed, column = np.unique(faces[face], return_inverse=True)
    pull = _rows(len(verts), len(followed), followers, column.reshape(-1, 3), strength * shares)
    followed_points = np.einsum("pi,pij->pj", shares, corners[face])
    left = _rows(len(verts), len(followers), followers, np.arange(len(followers))[:, None], strength)
    step = pull @ lattice.embedding(verts[followed]) - left @ lattice.embedding(followed_points)
    rows = mesh.junctions.verts
    if len(rows):
        pull = sparse.csr_matrix((pull.data, followed[pull.indices], pull.indptr), shape=(len(verts), len(verts)))
        on_edge = _rows(len(verts), len(verts), rows, rows[:, None], np.ones((len(rows), 1)))
        follow = (on_edge @ mesh.junctions.follow).tocsr()
        used = np.union1d(rows, follow.indices)
        pull, step = pull + follow, step + (follow - on_edge)[:, used] @ lattice.embedding(verts[used])
        followed = np.arange(len(verts))
    added = nothing
    # The corners of a face may follow a larger one, or lie on an edge, which is how often this goes on.
    for _ in range(_MOST_FOLLOWED):
        if not step.nnz:
            break
        added, step = added + step, pull @ step[followed]
        step.eliminate_zeros()
    return added.tocsr()


def _rows(count: int, columns: int, rows: _Index, entries: _Index, values: _Floats) -> sparse.csr_matrix:
    """Return a sparse matrix with a few entries (R, K) in some of its rows (R,)."""
    repeated = np.repeat(rows, entries.shape[1])
    return sparse.csr_matrix((values.ravel(), (repeated, entries.ravel())), shape=(count, columns))
