"""Find the bodies that `params.rigid` selects in an asset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.assets import Asset
from meshdeform.assets.parts import Parts
from meshdeform.deformation.rigid_bodies import Body
from meshdeform.errors import ParameterError
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.requests.choices import Rigidity
from meshdeform.requests.rigid import RigidSelector, find_parts, refuse_selector

__all__ = ["select_bodies"]

_Index = NDArray[np.int64]
_Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class _Surface:
    parts: Parts
    mesh: RestMesh
    face_source: _Index

    @property
    def components(self) -> _Index:
        """Connected component (F,) of each face."""
        return np.asarray(self.mesh.components.numpy()[self.mesh.faces.numpy()[:, 0]])


def select_bodies(selectors: Sequence[RigidSelector], asset: Asset, welded: WeldedMesh) -> list[Body]:
    """Return the bodies of an asset that keep their shape.

    Selections that share vertices become one body, which is rigid if one of them is.

    Parameters
    ----------
    selectors : sequence of RigidSelector
    asset : Asset
    welded : WeldedMesh
        The asset's surface.

    Raises
    ------
    ParameterError
        A selector selects nothing, or nothing is left to deform.
    """
    if not selectors:
        return []
    surface = _Surface(asset.parts(), welded.mesh, welded.face_source)
    found = [
        Body(verts, selector.mode)
        for number, selector in enumerate(selectors)
        for verts in _bodies(selector, _faces(number, selector, surface), surface.mesh)
    ]
    bodies = _united(found, len(surface.mesh.verts))
    if len(bodies) == 1 and len(bodies[0].verts) == len(surface.mesh.verts):
        raise ParameterError(
            "params.rigid: the whole asset is one rigid body, so nothing is left to deform.",
            advice="Select the parts that keep their shape only.",
        )
    return bodies


def _faces(number: int, selector: RigidSelector, surface: _Surface) -> _Flags:
    """Return flags (F,) of the faces that a selector selects."""
    what, wanted = selector.where
    if what == "component":
        flags = surface.components == wanted
        if not flags.any():
            count = len(np.unique(surface.components))
            raise refuse_selector(
                number,
                what,
                f"params.rigid: the asset has no component {wanted}.",
                f"Its components are 0 to {count - 1}; `meshdeform inspect` lists them.",
            )
        return np.asarray(flags)
    parts = surface.parts
    known, flags_of = (parts.nodes, parts.in_node) if what == "node" else (parts.materials, parts.of_material)
    flags = np.any([flags_of(at) for at in find_parts(number, selector, known)], axis=0)[surface.face_source]
    if not flags.any():
        raise refuse_selector(
            number, what, f"params.rigid: the {what} {wanted!r} has no triangle with an area.", "Leave it out."
        )
    return np.asarray(flags)


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
