"""Find the faces of an asset's surface that a selection of the request selects."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset
from meshdeform.assets.parts import Parts
from meshdeform.errors import ParameterError
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.requests.selection import (
    Box,
    Capsule,
    ColorRange,
    JointWeight,
    List,
    Selection,
    Sphere,
    find_parts,
    refuse_selection,
)

__all__ = ["SelectableSurface"]

_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]


class SelectableSurface:
    """The surface of an asset, with what selections can refer to.

    Attributes
    ----------
    welded : WeldedMesh
    """

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
        selection : Selection

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
