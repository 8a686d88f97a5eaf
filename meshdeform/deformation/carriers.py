"""Choose what carries the vertices: the surface itself, or a lattice around all components."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from torch import Tensor

from meshdeform.deformation.constraints import UNCONSTRAINED, Constraints
from meshdeform.deformation.lattice_field import LatticeField
from meshdeform.deformation.rigid_bodies import Body
from meshdeform.deformation.variables import JacobianField, Variables
from meshdeform.errors import CheckpointError
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


def carry(
    carrier: Carrier,
    mesh: TriangleMesh,
    *,
    whole: TriangleMesh | None = None,
    initial: Mapping[str, Tensor] | None = None,
    bodies: Sequence[Body] = (),
    constraints: Constraints = UNCONSTRAINED,
) -> Variables:
    """Return the variables of a mesh.

    Parameters
    ----------
    carrier : Carrier
    mesh : TriangleMesh
    whole : TriangleMesh, optional
        The mesh for which `mesh` stands in, which a lattice encloses as well; its components decide.
    initial : mapping of name to Tensor, optional
        The tensors with whose shape the run starts. It keeps their carrier, which alone can represent that shape.
    bodies : sequence of Body, optional
        Parts that keep their shape; they need the lattice.
    constraints : Constraints
        Of `mesh`.

    Raises
    ------
    CheckpointError
        The shape is of an edition that moved parts by translations, or of the surface while there are bodies.
    """
    rest = RestMesh.of(mesh)
    of_whole = rest if whole is None else RestMesh.of(whole)
    chosen = chosen_carrier(carrier, of_whole, rigid=bool(bodies))
    if initial is not None:
        if "translations" in initial and bool(initial["translations"].any()) and len(initial["translations"]) > 1:
            raise CheckpointError(
                "The shape to start from was made by an earlier edition, which moved the parts of an asset separately."
            )
        chosen = Carrier.LATTICE if "cell_jacobians" in initial else Carrier.SURFACE
    if chosen is Carrier.LATTICE:
        return LatticeField(rest, of_whole, bodies, constraints)
    if bodies and initial is not None:
        raise CheckpointError("The shape to start from has no lattice, which the parts in `rigid` need.")
    if bodies:
        raise ValueError("rigid bodies need the lattice")
    return JacobianField(rest, constraints)
