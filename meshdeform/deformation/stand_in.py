"""Choose the carrier of the vertices, and deform a simplified mesh in place of a large one.

The carrier is the surface itself, or a lattice around all components.

With a stand-in, drawing, the penalties, the barrier and the guard cost the same for every large mesh, and so do
checkpoints. The vertices of the large mesh are placed only when somebody asks for them. On a lattice they follow the
nodes, exactly as if the lattice carried them throughout; on a surface they follow the nearest faces of the stand-in
(`binding.py`).

A stand-in must not lose parts of the asset: it has more faces, or is the mesh itself, unless all of the surface is near
it and it has most of the area.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from meshdeform.deformation.binding import Binding
from meshdeform.deformation.constraints import UNCONSTRAINED, Constraints, RigidBody
from meshdeform.deformation.differentiable import placed_by
from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.settings import Carrier
from meshdeform.deformation.structure import Structure
from meshdeform.deformation.surface_colours import baked_appearance
from meshdeform.deformation.variables import JacobianField, Variables, placed
from meshdeform.errors import CheckpointError
from meshdeform.geometry.appearance import Appearance
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.nearest_points import NearestPoints
from meshdeform.geometry.shapes import simplified

MAX_FACES = 12_000
"""Number of faces above which a mesh gets a stand-in."""
FACES = 8_000
"""Number of faces of a stand-in. A step then takes about 1.2 times as long as one with 5,000 faces."""
_PROBES = 5000
_NEAR = 0.02
"""Distance from the stand-in, as a share of the diagonal, at which the surface is lost."""
_LOST = 0.01
"""Share of the surface that may be lost."""
_LEAST_AREA = 0.5


def chosen_carrier(carrier: Carrier, mesh: RestMesh, *, rigid: bool = False) -> Carrier:
    """Return the carrier that `auto` stands for: several connected components or rigid bodies need the lattice."""
    if carrier is not Carrier.AUTO:
        return carrier
    several = len(np.unique(mesh.components[mesh.faces[:, 0]])) > 1
    return Carrier.LATTICE if several or rigid else Carrier.SURFACE


def carry(
    carrier: Carrier,
    mesh: TriangleMesh,
    *,
    whole: TriangleMesh | None = None,
    initial: Mapping[str, Tensor] | None = None,
    bodies: Sequence[RigidBody] = (),
    constraints: Constraints = UNCONSTRAINED,
    structure: Structure | None = None,
) -> Variables:
    """Return the variables of a mesh.

    Parameters
    ----------
    whole : TriangleMesh, optional
        The mesh for which `mesh` stands in, which a lattice encloses as well; its components decide.
    initial : mapping of name to Tensor, optional
        The tensors with whose shape the run starts. It keeps their carrier, which alone can represent that shape.
    bodies : sequence of RigidBody, optional
        What keeps its shape; needs the lattice.
    constraints : Constraints
        Of `mesh`.
    structure : Structure, optional
        What few degrees of freedom keep. None: every element has a Jacobian of its own.

    Raises
    ------
    CheckpointError
        The shape is of the surface while there are bodies.
    """
    rest = RestMesh.of(mesh)
    of_whole = rest if whole is None else RestMesh.of(whole)
    chosen = chosen_carrier(carrier, of_whole, rigid=bool(bodies))
    if initial is not None:
        chosen = Carrier.LATTICE if any(name.startswith("cell_") for name in initial) else Carrier.SURFACE
    if chosen is Carrier.LATTICE:
        return LatticeField(rest, of_whole, bodies, constraints, structure)
    if bodies and initial is not None:
        raise CheckpointError("The shape to start from has no lattice, which the parts in `rigid` need.")
    if bodies:
        raise ValueError("rigid bodies need the lattice")
    return JacobianField(rest, constraints, structure)


class StandIn:
    """The mesh that a run deforms, and how the whole mesh follows it.

    `simplify`: false: the whole mesh itself is deformed, however large it is. `constraints`: of the whole mesh; handles
    need `simplify` False. `mesh`: the simplified mesh; the whole mesh itself if that has at most `MAX_FACES` faces.
    """

    def __init__(self, whole: TriangleMesh, *, simplify: bool = True, constraints: Constraints = UNCONSTRAINED) -> None:
        self._whole = RestMesh.of(whole)
        self._constraints = constraints
        self.mesh = stand_in_of(self._whole) if simplify else self._whole

    def carry(
        self,
        carrier: Carrier,
        initial: Mapping[str, Tensor] | None = None,
        bodies: Sequence[RigidBody] = (),
        structure: Structure | None = None,
    ) -> Variables:
        """Return the variables that deform the stand-in, as `carry` does."""
        own = self._constraints
        if self.mesh is not self._whole:
            own = own.of_stand_in(self.mesh, self._whole)
        return carry(
            carrier,
            self.mesh,
            whole=self._whole,
            initial=initial,
            bodies=bodies,
            constraints=own,
            structure=structure,
        )

    def wear(self, appearance: Appearance | None) -> Appearance | None:
        """Return the look of the stand-in for that of the whole mesh, of which `rows` are vertices."""
        if appearance is None or self.mesh is self._whole:
            return appearance
        return baked_appearance(appearance, self._whole, self.mesh)

    def follow(self, variables: Variables) -> Tensor:
        """Return the vertices (V, 3) float64 of the whole mesh for the variables of the stand-in."""
        if self.mesh is self._whole:
            return placed(variables)
        with torch.no_grad():
            if isinstance(variables, LatticeField):
                return self._placed(variables.moved(self._whole), self._constraints)
            edge = float(np.sqrt(2 * self.mesh.areas.sum() / len(self.mesh.faces)))
            moved = torch.from_numpy(self._binding.move(placed(variables).numpy()))
            return self._placed(moved, self._constraints.of_followers(edge))

    def _placed(self, verts: Tensor, constraints: Constraints) -> Tensor:
        placement = constraints.placement(self._whole)
        return verts if placement is None else placed_by(placement, verts)

    @cached_property
    def _binding(self) -> Binding:
        return Binding(self.mesh, self._whole)


def stand_in_of(whole: TriangleMesh) -> RestMesh:
    """Return a simplified mesh, or the mesh itself if it is small or cannot be simplified without losing parts."""
    rest = RestMesh.of(whole)
    count = FACES
    while rest.faces.shape[0] > max(MAX_FACES, 1.5 * count):
        simple = RestMesh.of(simplified(rest, count))
        if len(simple.faces) == len(rest.faces):
            return rest
        if _represents(simple, rest):
            return simple
        count *= 2
    return rest


def _represents(simple: RestMesh, whole: RestMesh) -> bool:
    """Return whether a simplified mesh has most of the area of the whole one, and all of the whole one is near it."""
    if float(simple.areas.sum()) <= _LEAST_AREA * float(whole.areas.sum()):
        return False
    chosen = np.linspace(0, whole.faces.shape[0] - 1, _PROBES).astype(int)
    probes = whole.verts[whole.faces[chosen]].mean(1)
    distances = NearestPoints(simple, probes, whole.normals[chosen]).distances(probes)
    diagonal = float(np.linalg.norm(np.ptp(whole.verts, axis=0)))
    return bool((distances > _NEAR * diagonal).mean() <= _LOST)
