"""Optimise the Jacobians of a lattice's cells in place of those of the faces: ``verts = W solve(J)``.

One smooth map of space carries all components, so what belongs together stays together. The penalties are those of the
cells:

* jacobian   1/C  sum_c ||J_c - I||^2
* dirichlet  1/C  sum_c b log(1 + (||F_c||^2 + ||F_c^-1||^2 - 6) / b)   with F_c the map of a cell, from the mean of its
  four edges along each axis: zero where no length changes; b as of `regularizers.py`.

Source: Smith and Schaefer 2015, Bijective Parameterization with Free Boundaries, eq. 2, for tetrahedra.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor

from meshdeform.deformation.constraints import UNCONSTRAINED, Constraints, RigidBody
from meshdeform.deformation.degrees_of_freedom import DegreesOfFreedom, Hierarchy, OwnJacobians
from meshdeform.deformation.details_on_faces import pull_of_large_faces
from meshdeform.deformation.differentiable import placed_by
from meshdeform.deformation.handles import Handles
from meshdeform.deformation.lattice import Lattice, LatticeSystem
from meshdeform.deformation.regularizers import STRAINED, penalty
from meshdeform.deformation.rigid_bodies import RigidBodies
from meshdeform.deformation.structure import Structure
from meshdeform.deformation.variables import Elements, IntegratedJacobians
from meshdeform.errors import ParameterError
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.tensors import sparse_product, verts_of

_Flags = NDArray[np.bool_]
_LEAST_VOLUME = 1e-6
"""Lower bound of a cell's relative volume in its energy."""
_SIDES = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))  # of a cell on which each corner lies, by axis
_CORRECTIONS = 3
_CHUNK = 50_000
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


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
