"""Choose what carries the vertices: the surface itself, or a lattice around all components."""

from __future__ import annotations

import numpy as np

from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.variables import JacobianField, Variables
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.requests.choices import Carrier

__all__ = ["carry", "chosen_carrier"]


def chosen_carrier(carrier: Carrier, mesh: RestMesh) -> Carrier:
    """Return `surface` or `lattice`; `auto` chooses the lattice for a mesh of several connected components."""
    if carrier is not Carrier.AUTO:
        return carrier
    several = len(np.unique(mesh.components.numpy()[mesh.faces.numpy()[:, 0]])) > 1
    return Carrier.LATTICE if several else Carrier.SURFACE


def carry(carrier: Carrier, mesh: TriangleMesh, whole: TriangleMesh | None = None) -> Variables:
    """Return the variables of a mesh, or of the stand-in of a `whole` mesh, which a lattice encloses as well."""
    rest = RestMesh.of(mesh)
    of_whole = rest if whole is None else RestMesh.of(whole)
    if chosen_carrier(carrier, of_whole) is Carrier.SURFACE:
        return JacobianField(rest)
    return LatticeField(rest, of_whole)
