"""Select faces of the surface of an asset, as the selections of a request say. Torch-free."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.assets.surface_pieces import SurfacePieces
from meshdeform.errors import ParameterError
from meshdeform.requests.selection import (
    BoxParams,
    CapsuleParams,
    ColorParams,
    JointParams,
    List,
    SelectionParams,
    SphereParams,
    check_faces,
    find_parts,
    refuse_selection,
)

if TYPE_CHECKING:
    from meshdeform.assets import Asset
    from meshdeform.plain.body import Body

_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


class SelectableSurface:
    """The surface of an asset, with what selections can refer to.

    `verts`, (V, 3) float64: welded, in the file's units; `faces`, (F, 3) int64; `sources`, (F,) int64: the triangle of
    the asset that each face is.
    """

    def __init__(self, asset: Asset, verts: _Floats, faces: _Index, sources: _Index) -> None:
        self._asset, self._verts, self._faces, self._sources = asset, verts, faces, sources

    @classmethod
    def of_body(cls, asset: Asset, body: Body) -> Self:
        """Return the surface of a body of an asset."""
        corners = body.vertex_map[asset.surface.triangles]
        solid = (corners >= 0).all(1) & (corners != np.roll(corners, 1, axis=1)).all(1)
        return cls(asset, body.points, body.faces, np.flatnonzero(solid))

    @cached_property
    def parts(self) -> SurfacePieces:
        """Names in the asset."""
        return self._asset.pieces()

    @cached_property
    def components(self) -> NDArray[np.int64]:
        """Connected component (F,) of each face."""
        used, corners = np.unique(self._faces, return_inverse=True)
        rows, columns = np.concatenate([corners.reshape(-1, 3)[:, :2], corners.reshape(-1, 3)[:, 1:]]).T
        graph = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(len(used),) * 2)
        labels = csgraph.connected_components(graph, directed=False)[1]
        return np.asarray(labels.astype(np.int64)[corners.reshape(-1, 3)[:, 0]])

    def faces(self, path: List, number: int, selection: SelectionParams) -> _Flags:
        """Return flags (F,) of the faces that a selection selects.

        `path`: name of the list in `params`, or the path to it there, for errors; `number`: index of the selection in
        the list.
        """
        what, reference = selection.where
        if what == "component":
            flags = self.components == reference
        elif what in {"box", "sphere", "capsule"}:
            corners = self._verts[self._faces]
            flags = _inside(reference, corners.reshape(-1, 3)).reshape(-1, 3).all(1)
        else:
            flags = self._triangles(path, number, selection)[self._sources]
        if not flags.any():
            raise self._nothing(path, number, what, reference)
        return np.asarray(flags)

    def _triangles(self, path: List, number: int, selection: SelectionParams) -> _Flags:
        """Return flags (T,) of the source's triangles that a selection by name, colour or number selects."""
        what, reference = selection.where
        parts = self.parts
        if isinstance(reference, ColorParams):
            distance = np.linalg.norm(self._asset.vertex_colors() - np.array(reference.rgb), axis=2)
            return np.asarray((distance <= reference.within + 1e-6).all(1))
        if what == "faces":
            return self._numbered(path, number, reference)
        known = {"node": parts.nodes, "mesh": parts.meshes, "material": parts.materials, "joint": parts.joints}
        matches = find_parts(path, number, selection, known[what])
        if isinstance(reference, JointParams):
            return np.asarray((self._asset.joint_weights(matches) > reference.above).all(1))
        flags_of = {"node": parts.in_node, "mesh": parts.of_mesh, "material": parts.of_material}[what]
        return np.asarray(np.any([flags_of(at) for at in matches], axis=0))

    def _numbered(self, path: List, number: int, reference: tuple[int | tuple[int, int], ...]) -> _Flags:
        count = len(self._asset.surface.triangles)
        check_faces(path, number, reference, count)
        flags = np.zeros(count, bool)
        for item in reference:
            first, last = item if isinstance(item, tuple) else (item, item)
            flags[first : last + 1] = True
        return flags

    def _nothing(self, path: List, number: int, what: str, reference: Any) -> ParameterError:
        """Return the error about a selection of no faces, with what there is."""
        if what == "component":
            advice = f"Its components are 0 to {self.components.max()}; `meshdeform inspect` lists them."
            return refuse_selection(path, number, what, f"the asset has no component {reference}.", advice)
        if what in {"box", "sphere", "capsule"}:
            low, high = (np.round(bound(self._verts, axis=0), 4).tolist() for bound in (np.min, np.max))
            detail = f"no triangle has all its corners in the {what}."
            return refuse_selection(path, number, what, detail, f"The asset is between {low} and {high}.")
        if what == "color":
            detail = "no triangle has this vertex colour at all its corners."
            return refuse_selection(path, number, what, detail, "Increase `within`, or select otherwise.")
        if what == "joint":
            detail = (
                f"no triangle follows the joint {reference.name!r} by more than {reference.above:g} at all its corners."
            )
            return refuse_selection(path, number, what, detail, "Set a lower `above`.")
        detail = f"the {what} {reference!r} has no triangle with an area."
        if what == "faces":
            detail = "these triangles have no area."
        return refuse_selection(path, number, what, detail, "Leave it out.")


def _inside(shape: BoxParams | SphereParams | CapsuleParams, points: _Floats) -> _Flags:
    """Return flags (P,) of the points (P, 3) inside of a shape or on it."""
    if isinstance(shape, BoxParams):
        return np.asarray(((points >= np.array(shape.min)) & (points <= np.array(shape.max))).all(1))
    start = np.array(shape.center if isinstance(shape, SphereParams) else shape.start)
    line = np.zeros(3) if isinstance(shape, SphereParams) else np.array(shape.end) - start
    arms = points - start
    along = np.clip(arms @ line / max(float(line @ line), 1e-300), 0.0, 1.0)
    return np.asarray(np.linalg.norm(arms - along[:, None] * line, axis=1) <= shape.radius)
