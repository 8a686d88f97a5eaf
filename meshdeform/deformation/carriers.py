"""Choose what carries the vertices: the surface itself, or a lattice around all components."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.rigid_bodies import Body
from meshdeform.deformation.variables import JacobianField, Variables
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.requests.choices import Carrier

__all__ = ["carry", "chosen_carrier"]


def chosen_carrier(carrier: Carrier, mesh: RestMesh, *, rigid: bool = False) -> Carrier:
    """Return `surface` or `lattice`; `auto` chooses the lattice for several connected components or rigid bodies."""
    if carrier is not Carrier.AUTO:
        return carrier
    several = len(np.unique(mesh.components.numpy()[mesh.faces.numpy()[:, 0]])) > 1
    return Carrier.LATTICE if several or rigid else Carrier.SURFACE


def carry(carrier: Carrier, mesh: TriangleMesh, bodies: Sequence[Body] = ()) -> Variables:
    """Return the variables of a mesh; bodies that keep their shape need the lattice."""
    rest = RestMesh.of(mesh)
    if chosen_carrier(carrier, rest, rigid=bool(bodies)) is Carrier.LATTICE:
        return LatticeField(rest, bodies)
    if bodies:
        raise ValueError("rigid bodies need the lattice")
    return JacobianField(rest)
