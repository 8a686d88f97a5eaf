"""Enclose a mesh in a voxel lattice, and solve for its nodes from one Jacobian per cell.

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
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from meshdeform.deformation.factor import factorise
from meshdeform.errors import NumericalError
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.surface_samples import count_samples, sample_blocks

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
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


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
