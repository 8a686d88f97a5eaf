"""Show the asset at any share of the way to its result, and write the way as a morph."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset, Limits
from meshdeform.assets.morph import ANIMATION_NAME, MorphTarget, WeightTrack
from meshdeform.assets.rig import NodeMove
from meshdeform.deformation.edit_map import EditMap, Outside
from meshdeform.deformation.path import ShapePath
from meshdeform.errors import ParameterError
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.requests.choices import BackdropMode
from meshdeform.requests.document import MorphParams
from meshdeform.requests.selection import find_excluded
from meshdeform.runs.surfaces import (
    DeformedSurface,
    deformed_surface,
    drawn_triangles,
    read_result,
    subdivided,
    vertex_jacobians,
    welded_surface,
)

MAX_STRENGTH = 1.5
_Floats = NDArray[np.float64]


class AssetPath:
    """The way of an asset's own vertices from the source to a result, in world space.

    `positions`, (N, 3) float64: positions of the result; rows as in `source.surface`; `welded`: the welded source, if
    known.
    """

    def __init__(self, source: Asset, positions: _Floats, welded: WeldedMesh | None = None) -> None:
        surface = source.surface
        self._source = source
        self._welded = welded or _welded(source, positions)
        self._result = positions
        used = self._welded.vertex_map >= 0
        _, first = np.unique(self._welded.vertex_map[used], return_index=True)
        self._moved = (positions - surface.positions)[np.flatnonzero(used)[first]]

    def at(self, share: float) -> DeformedSurface:
        """Return the surface at a share of the way: 0 is the source, 1 the result, more exaggerates.

        The positions at the ends are exact.
        """
        surface, verts = self._source.surface, self._path.at(share)
        deformed = deformed_surface(surface, self._welded, verts)
        # Vertices that welding merges may differ in the last bits, and no face uses some vertices.
        ends = self._welded.scatter(self._result_verts, surface.positions)
        positions = deformed.positions + share * (self._result - ends)
        if share in (0, 1):
            positions = self._result if share else surface.positions
        return dataclasses.replace(deformed, positions=positions)

    def edit_map(self, share: float, *, with_rig: bool) -> EditMap:
        """Return the transfer of the shape at a share of the way, with the moves of the joints or without."""
        joints = None
        if with_rig:
            moves = self._source.joint_moves(self.at(share).positions, self.jacobians(share))
            joints = {name: np.array([*each.origin, *each.shift, each.growth]) for name, each in moves.values() if name}
        verts = self._result_verts if share == 1 else self._path.at(share)
        return EditMap.between(self._welded.mesh, verts, joints)

    def jacobians(self, share: float) -> _Floats:
        """Return the linear map (N, 3, 3) of the deformation around each vertex at a share of the way."""
        return vertex_jacobians(self._welded, self._path.at(share))

    @property
    def _result_verts(self) -> _Floats:
        return np.asarray(self._welded.mesh.verts + self._moved)

    @cached_property
    def _path(self) -> ShapePath:
        return ShapePath(self._welded.mesh, self._result_verts)


def _welded(source: Asset, positions: _Floats) -> WeldedMesh:
    """Weld the deformed surface: everything but a backdrop that stayed where it was."""
    kept = source.surface.triangles[~drawn_triangles(source)]
    moved = (positions != source.surface.positions).any(1)
    return welded_surface(source, BackdropMode.DEFORM if moved[kept].any() else BackdropMode.LEAVE)


def check_same_asset(source: Asset, result: Asset, names: tuple[str, str] = ("The source", "the result")) -> None:
    """Refuse a result that was not made from the source."""
    before, after = source.surface, result.surface
    if before.positions.shape != after.positions.shape or not np.array_equal(before.triangles, after.triangles):
        raise ParameterError(
            f"{names[1]} was not made from {names[0]}: their triangles differ.",
            advice="Name the asset that was deformed, then its result.",
        )


def matched(source: Asset, result: Asset, exclude: Sequence[str | int], limits: Limits | None) -> tuple[Asset, Asset]:
    """Return the source as its run deformed it, subdivided if the result is, and the same nodes of the result.

    `exclude`: `params.control.exclude` of the run; `limits`: those of the deployment that ran it.
    """
    source, result = (asset.without(find_excluded(exclude, asset.pieces().nodes)) for asset in (source, result))
    if len(source.surface.triangles) < len(result.surface.triangles):
        source, _ = subdivided(source, limits)
    check_same_asset(source, result)
    return source, result


def with_strength(
    source: Asset,
    result: bytes,
    strength: float,
    *,
    exclude: Sequence[str | int] = (),
    limits: Limits | None = None,
    compact: bool = False,
) -> bytes:
    """Return the asset as a GLB with its shape at a share of the way to its result.

    `result`: the GLB that was made from it, returned itself for a strength of 1; `strength`: from 0, the source, to
    `MAX_STRENGTH`; `exclude` and `limits`: as for `matched`; `compact`: drop the data that the new shape made unused.
    """
    if not 0 <= strength <= MAX_STRENGTH:
        raise ParameterError(f"The strength {strength:g} is not between 0 and {MAX_STRENGTH:g}.")
    source, end = matched(source, read_result(result), exclude, limits)
    if strength == 1:
        return result
    origin = None if end.provenance is None else {**end.provenance, "strength": strength}
    if strength == 0:
        surface = source.surface
        return source.replace(surface.positions, compact=compact, provenance=origin)
    path = AssetPath(source, end.surface.positions)
    shape_at = path.at(strength)
    # The rig follows where that of the result did.
    jacobians = None if source.rig_digest() == end.rig_digest() else path.jacobians(strength)
    shape = shape_at.positions, shape_at.normals, shape_at.tangents
    return source.replace(*shape, jacobians=jacobians, compact=compact, provenance=origin)


def edit_of(
    source: Asset,
    result: bytes,
    strength: float = 1.0,
    *,
    exclude: Sequence[str | int] = (),
    limits: Limits | None = None,
) -> EditMap:
    """Return the transfer of an asset's deformation to other files; the arguments are those of `with_strength`."""
    source, end = matched(source, read_result(result), exclude, limits)
    path = AssetPath(source, end.surface.positions)
    # Where nothing was there to follow, nothing was kept either.
    return path.edit_map(strength, with_rig=source.rig_digest() != end.rig_digest() or not source.rig())


def with_edit(asset: Asset, edit: EditMap, outside: Outside = Outside.REFUSE, *, compact: bool = False) -> bytes:
    """Return another asset as a GLB, deformed by a map.

    Where the joints of the map's asset moved, so do this one's, alike if both files have them, and its morph targets.
    """
    welded = welded_surface(asset, BackdropMode.DEFORM)
    verts = edit.move(welded.mesh, outside)
    deformed = deformed_surface(asset.surface, welded, verts)
    shape = deformed.positions, deformed.normals, deformed.tangents
    if edit.joints is None:
        return asset.replace(*shape, compact=compact)
    jacobians = vertex_jacobians(welded, verts)
    joints = {}
    for node, (name, move) in asset.joint_moves(deformed.positions, jacobians).items():
        same = edit.same_joint(name, move.origin)
        joints[node] = move if same is None else NodeMove(move.origin, same[:3], float(same[3]))
    return asset.replace(*shape, jacobians=jacobians, joints=joints, compact=compact)


def write_morph(
    source: Asset,
    path: AssetPath,
    result: DeformedSurface,
    morph: MorphParams,
    *,
    compact: bool = False,
    provenance: Mapping[str, Any] | None = None,
) -> bytes:
    """Return the source as a GLB with the frames of the way to the result as morph targets, and their animation.

    The last target, `deform`, is the result; the others are named `deform 1/8` and so on.
    """
    targets = []
    for number, share in enumerate(morph.shares(), 1):
        shape_at = result if share == 1 else path.at(share)
        name = ANIMATION_NAME if share == 1 else f"{ANIMATION_NAME} {number}/{morph.frames}"
        targets.append(MorphTarget(name, shape_at.positions, shape_at.normals, shape_at.tangents))
    track = WeightTrack(morph.times(), morph.weights())
    return source.morph(targets, track=track, compact=compact, provenance=provenance)
