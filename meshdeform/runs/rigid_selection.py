"""Find the bodies that `params.rigid` selects in an asset."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.deformation.rigid_bodies import Body
from meshdeform.errors import ParameterError
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.requests.choices import Rigidity
from meshdeform.requests.rigid import RigidSelector
from meshdeform.runs.selection import SelectableSurface

__all__ = ["select_bodies"]

_Index = NDArray[np.int64]
_Flags = NDArray[np.bool_]


def select_bodies(selectors: Sequence[RigidSelector], surface: SelectableSurface) -> list[Body]:
    """Return the bodies of an asset that keep their shape.

    Selections that share vertices become one body, which is rigid if one of them is.

    Parameters
    ----------
    selectors : sequence of RigidSelector
    surface : SelectableSurface

    Raises
    ------
    ParameterError
        A selector selects nothing, or nothing is left to deform.
    """
    if not selectors:
        return []
    found = [
        Body(verts, selector.mode)
        for number, selector in enumerate(selectors)
        for verts in _bodies(selector, surface.faces("rigid", number, selector), surface.mesh)
    ]
    bodies = _united(found, len(surface.mesh.verts))
    if len(bodies) == 1 and len(bodies[0].verts) == len(surface.mesh.verts):
        raise ParameterError(
            "params.rigid: the whole asset is one rigid body, so nothing is left to deform.",
            advice="Select the parts that keep their shape only.",
        )
    return bodies


def _bodies(selector: RigidSelector, flags: _Flags, mesh: RestMesh) -> list[_Index]:
    """Return the vertices of each body: all together, or each connected part of the selected faces."""
    faces = mesh.faces.numpy()[flags]
    verts, local = np.unique(faces, return_inverse=True)
    if selector.together:
        return [verts]
    corners = local.reshape(-1, 3)
    rows, columns = np.concatenate([corners[:, :2], corners[:, 1:]]).T
    graph = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(len(verts), len(verts)))
    count, label = csgraph.connected_components(graph, directed=False)
    return _groups(verts, label, count)


def _united(bodies: Sequence[Body], count: int) -> list[Body]:
    """Unite bodies that share vertices, of `count` in all."""
    owner = np.repeat(np.arange(len(bodies)), [len(body.verts) for body in bodies])
    members = np.concatenate([body.verts for body in bodies])
    shape = (len(bodies), count)
    held = sparse.csr_matrix((np.ones(len(members)), (owner, members)), shape=shape)
    total, label = csgraph.connected_components(held @ held.T, directed=False)
    stiff = np.array([body.mode is Rigidity.RIGID for body in bodies])
    rigid = np.bincount(label, weights=stiff, minlength=total) > 0
    groups = _groups(members, label[owner], total)
    modes = [Rigidity.RIGID if flag else Rigidity.SIMILARITY for flag in rigid]
    return [Body(np.unique(verts), mode) for verts, mode in zip(groups, modes, strict=True)]


def _groups(values: _Index, label: NDArray[np.int32], count: int) -> list[_Index]:
    """Return the values with each of `count` labels."""
    order = np.argsort(label, kind="stable")
    return np.split(values[order], np.cumsum(np.bincount(label, minlength=count))[:-1])
