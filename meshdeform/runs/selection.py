"""Find what a selection of the request selects in an asset: faces of its surface, and bodies that keep their shape."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.assets import Asset
from meshdeform.assets.parts import Parts
from meshdeform.deformation.rigid_bodies import Body
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.requests.choices import Rigidity
from meshdeform.requests.selection import (
    Box,
    Capsule,
    ColorRange,
    JointWeight,
    List,
    RigidSelector,
    Selection,
    Sphere,
    find_parts,
    refuse_selection,
)

__all__ = ["SelectableSurface", "select_bodies"]


_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]


class SelectableSurface:
    """The surface of an asset, with what selections can refer to."""

    def __init__(self, asset: Asset, welded: WeldedMesh) -> None:
        self._asset, self.welded = asset, welded

    @property
    def mesh(self) -> RestMesh:
        """The welded mesh, in the file's units."""
        return self.welded.mesh

    @cached_property
    def parts(self) -> Parts:
        """What the asset names."""
        return self._asset.parts()

    @cached_property
    def components(self) -> NDArray[np.int64]:
        """Connected component (F,) of each face."""
        return np.asarray(self.mesh.components.numpy()[self.mesh.faces.numpy()[:, 0]])

    def faces(self, place: List, number: int, selection: Selection) -> _Flags:
        """Return flags (F,) of the faces that a selection selects.

        Parameters
        ----------
        place : str or tuple
            Name of the list in `params`, or the path to it there, for errors.
        number : int
            Place of the selection in the list.

        Raises
        ------
        ParameterError
            It selects nothing.
        """
        what, wanted = selection.where
        if what == "component":
            flags = self.components == wanted
        elif what in {"box", "sphere", "capsule"}:
            corners = self.mesh.verts.numpy()[self.mesh.faces.numpy()]
            flags = _inside(wanted, corners.reshape(-1, 3)).reshape(-1, 3).all(1)
        else:
            flags = self._triangles(place, number, selection)[self.welded.face_source]
        if not flags.any():
            raise self._nothing(place, number, what, wanted)
        return np.asarray(flags)

    def _triangles(self, place: List, number: int, selection: Selection) -> _Flags:
        """Return flags (T,) of the source's triangles that a selection by name, colour or number selects."""
        what, wanted = selection.where
        parts = self.parts
        if isinstance(wanted, ColorRange):
            distance = np.linalg.norm(self._asset.vertex_colors() - np.array(wanted.rgb), axis=2)
            return np.asarray((distance <= wanted.within + 1e-6).all(1))
        if what == "faces":
            return self._numbered(place, number, wanted)
        known = {"node": parts.nodes, "mesh": parts.meshes, "material": parts.materials, "joint": parts.joints}
        found = find_parts(place, number, selection, known[what])
        if isinstance(wanted, JointWeight):
            return np.asarray((self._asset.joint_weights(found) > wanted.above).all(1))
        flags_of = {"node": parts.in_node, "mesh": parts.of_mesh, "material": parts.of_material}[what]
        return np.asarray(np.any([flags_of(at) for at in found], axis=0))

    def _numbered(self, place: List, number: int, wanted: tuple[int | tuple[int, int], ...]) -> _Flags:
        count = len(self._asset.surface.triangles)
        flags = np.zeros(count, bool)
        for item in wanted:
            first, last = item if isinstance(item, tuple) else (item, item)
            if last >= count or first > last:
                detail = f"the asset has no triangles {first} to {last}." if first != last else f"no triangle {first}."
                raise refuse_selection(place, number, "faces", detail, f"Its triangles are 0 to {count - 1}.")
            flags[first : last + 1] = True
        return flags

    def _nothing(self, place: List, number: int, what: str, wanted: Any) -> ParameterError:
        """Return the error about a selection of no faces, with what there is."""
        if what == "component":
            advice = f"Its components are 0 to {self.components.max()}; `meshdeform inspect` lists them."
            return refuse_selection(place, number, what, f"the asset has no component {wanted}.", advice)
        if what in {"box", "sphere", "capsule"}:
            low, high = (np.round(bound(self.mesh.verts.numpy(), axis=0), 4).tolist() for bound in (np.min, np.max))
            detail = f"no triangle has all its corners in the {what}."
            return refuse_selection(place, number, what, detail, f"The asset is between {low} and {high}.")
        if what == "color":
            detail = "no triangle has this vertex colour at all its corners."
            return refuse_selection(place, number, what, detail, "Increase `within`, or select otherwise.")
        if what == "joint":
            detail = f"no triangle follows the joint {wanted.name!r} by more than {wanted.above:g} at all its corners."
            return refuse_selection(place, number, what, detail, "Set a lower `above`.")
        detail = f"the {what} {wanted!r} has no triangle with an area."
        if what == "faces":
            detail = "these triangles have no area."
        return refuse_selection(place, number, what, detail, "Leave it out.")


def _inside(shape: Box | Sphere | Capsule, points: _Floats) -> _Flags:
    """Return flags (P,) of the points (P, 3) inside of a shape or on it."""
    if isinstance(shape, Box):
        return np.asarray(((points >= np.array(shape.min)) & (points <= np.array(shape.max))).all(1))
    start = np.array(shape.center if isinstance(shape, Sphere) else shape.start)
    line = np.zeros(3) if isinstance(shape, Sphere) else np.array(shape.end) - start
    arms = points - start
    along = np.clip(arms @ line / max(float(line @ line), 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(arms - along[:, None] * line, axis=1) <= shape.radius)


_Index = NDArray[np.int64]


def select_bodies(selectors: Sequence[RigidSelector], surface: SelectableSurface) -> list[Body]:
    """Return the bodies of an asset that keep their shape.

    Selections that share vertices become one body, which is rigid if one of them is.

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
        for verts in _bodies(selector, surface.faces(("control", "rigid"), number, selector), surface.mesh)
    ]
    bodies = _united(found, len(surface.mesh.verts))
    if len(bodies) == 1 and len(bodies[0].verts) == len(surface.mesh.verts):
        raise ParameterError(
            "params.control.rigid: the whole asset is one rigid body, so nothing is left to deform.",
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
