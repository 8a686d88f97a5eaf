"""Prepare the asset of a run, and give its vertices the shape of the result.

Nodes and backdrops are left out, the rest is welded, and subdivided for `output.subdivide`. At the end the asset's own
vertices, which may be split at seams, get the shape of the welded mesh, with normals and tangents.

Recomputing normals would lose hard edges, custom normals and everything that an artist baked into them. Instead, the
source's normal n at a vertex becomes the direction of ``sum_f |f| cof(J_f) n`` over the faces f around it, with cof(J)
= det(J) J^-T, the map of oriented area elements. Tangents follow J itself and are made perpendicular to the new normal.

A normal that is averaged over a hard edge follows the mean of maps that may differ much, and can end up behind one of
its faces. `rebuild_turned_normals` replaces those.

Source: Turkowski 1990, Properties of Surface-Normal Transformations.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset, Limits, Surface, load_asset
from meshdeform.assets.placement import unit_rows
from meshdeform.assets.subdivide import MAX_TRIANGLES, Subdivision
from meshdeform.deformation.jacobians import completed_jacobians
from meshdeform.errors import AssetEmptyError, ParameterError
from meshdeform.geometry.mesh import TriangleMesh, face_cross
from meshdeform.geometry.weld import WeldedMesh, weld
from meshdeform.rendering.studio import SurfaceState
from meshdeform.requests.choices import BackdropMode
from meshdeform.requests.document import OutputParams, ResolvedParams
from meshdeform.requests.selection import find_excluded

_Floats = NDArray[np.float64]
_ROUNDING = 1e-6
_SHORTEST = 1e-12

_IN_FRONT = 0.05
"""Cosine to a face from which a source normal counts as on one side of it; a smaller one may change sides."""


def transform_normals(normals: _Floats, triangles: NDArray[np.int64], jacobians: _Floats, areas: _Floats) -> _Floats:
    """Transform the source's normals to the deformed surface.

    `normals`, (N, 3) float64: unit normals of the source vertices; NaN rows (no normal) stay NaN. `triangles`, (F, 3)
    int64: source vertices of the faces that have a Jacobian; `jacobians`, (F, 3, 3) float64: completed Jacobians;
    `areas`, (F,) float64: weights. Returns (N, 3) float64 unit normals. A vertex whose faces all collapse, or that no
    face uses, keeps its normal. Where nothing was deformed, the source's numbers are returned, including the float32
    rounding of their length.
    """
    a, b, c = (jacobians[:, k] for k in range(3))
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1)
    return _transform(normals, triangles, cofactors, areas)


def transform_tangents(
    tangents: _Floats, normals: _Floats, triangles: NDArray[np.int64], jacobians: _Floats, areas: _Floats
) -> _Floats:
    """Transform the source's tangents to the deformed surface, perpendicular to its normals.

    `tangents`, (N, 4) float64: unit tangents and handedness; NaN rows stay NaN. `normals`, (N, 3) float64: the
    *deformed* normals; `triangles`, `jacobians` and `areas`: as for `transform_normals`. Returns (N, 4) float64; the
    handedness is the source's.
    """
    moved = _transform(tangents[:, :3], triangles, jacobians, areas)
    flat = moved - (moved * normals).sum(1, keepdims=True) * normals
    length = np.linalg.norm(flat, axis=1, keepdims=True)
    usable = length[:, 0] > 1e-12
    direction = np.where(usable[:, None], flat / np.where(length > 1e-12, length, 1.0), moved)
    direction = np.where(np.isnan(normals), moved, direction)
    return np.concatenate([direction, tangents[:, 3:]], 1)


def rebuild_turned_normals(
    normals: _Floats, source_normals: _Floats, triangles: NDArray[np.int64], rest_faces: _Floats, new_faces: _Floats
) -> tuple[_Floats, int]:
    """Replace transformed normals that have changed sides of one of their faces.

    `normals` and `source_normals`, (N, 3) float64: unit normals after and before; NaN rows (no normal) stay NaN.
    `triangles`, (F, 3) int64: source vertices of the faces; `rest_faces` and `new_faces`, (F, 3) float64: area vectors
    of the faces before and after. Returns (N, 3) float64 unit normals, and how many were replaced: by the mean of the
    deformed area vectors of their faces, on the sides where the source's normal was.
    """
    corners = triangles.reshape(-1)
    before, after = (
        np.repeat(faces / np.maximum(np.linalg.norm(faces, axis=1, keepdims=True), _SHORTEST), 3, axis=0)
        for faces in (rest_faces, new_faces)
    )
    was = (source_normals[corners] * before).sum(1)
    changed = (np.abs(was) > _IN_FRONT) & (np.sign(was) * (normals[corners] * after).sum(1) < 0)
    turned = np.unique(corners[changed])
    if not len(turned):
        return normals, 0
    signed = np.sign(was)[:, None] * np.repeat(new_faces, 3, axis=0)
    signed[~np.isfinite(signed)] = 0.0
    mean = np.stack([np.bincount(corners, signed[:, k], len(normals)) for k in range(3)], 1)[turned]
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    usable = length[:, 0] > 0
    rebuilt = normals.copy()
    rebuilt[turned[usable]] = mean[usable] / length[usable]
    return rebuilt, int(usable.sum())


def _transform(vectors: _Floats, triangles: NDArray[np.int64], maps: _Floats, areas: _Floats) -> _Floats:
    weighted = np.repeat((maps * areas[:, None, None]).reshape(-1, 9), 3, axis=0)
    corners = triangles.reshape(-1)
    total = np.stack([np.bincount(corners, weighted[:, k], len(vectors)) for k in range(9)], 1)
    moved = np.einsum("nij,nj->ni", total.reshape(-1, 3, 3), vectors)
    length = np.linalg.norm(moved, axis=1, keepdims=True)
    scale = np.linalg.norm(total, axis=1, keepdims=True)
    usable = length > 1e-9 * np.maximum(scale, 1e-300)
    # A unit vector rounded to float32 keeps its length, so that it rounds to the same float32 again.
    source_length = np.linalg.norm(vectors, axis=1, keepdims=True)
    lengths = np.where(np.abs(source_length - 1) < _ROUNDING, source_length, 1.0)
    return np.where(usable, moved * (lengths / np.where(usable, length, 1.0)), vectors)


@dataclass(frozen=True)
class DeformedSurface:
    """New positions (N, 3), normals (N, 3) and tangents (N, 4), rows as in `Surface`."""

    positions: _Floats
    normals: _Floats
    tangents: _Floats
    rebuilt_normals: int  # normals that had changed sides of a face


def vertex_jacobians(welded: WeldedMesh, verts: _Floats) -> _Floats:
    """Return the linear map (N, 3, 3) of a deformation around each of the source's vertices, in world space.

    It is the mean of the completed Jacobians of the faces around the welded vertex, by their area; exactly the identity
    where none of these faces moved, and at vertices that no face uses. `verts`, (V, 3) float64: deformed welded
    vertices, in world space.
    """
    rest = welded.mesh
    corners, count, areas = rest.faces.ravel(), len(rest.verts), rest.areas
    bent = np.where(_moved(rest, verts)[:, None, None], completed_jacobians(rest, verts) - np.eye(3), 0.0)
    weighted = np.repeat((areas[:, None, None] * bent).reshape(-1, 9), 3, axis=0)
    total = np.stack([np.bincount(corners, weighted[:, k], count) for k in range(9)], 1).reshape(-1, 3, 3)
    weight = np.bincount(corners, np.repeat(areas, 3), count)
    around = np.eye(3) + total / np.maximum(weight, 1e-300)[:, None, None]
    jacobians = np.tile(np.eye(3), (len(welded.vertex_map), 1, 1))
    used = welded.vertex_map >= 0
    jacobians[used] = around[welded.vertex_map[used]]
    return jacobians


def _moved(rest: TriangleMesh, verts: _Floats) -> NDArray[np.bool_]:
    """Return flags (F,) of the faces of which a corner is no longer where it was at rest."""
    return np.asarray((verts != rest.verts).any(1)[rest.faces].any(1))


def deformed_surface(surface: Surface, welded: WeldedMesh, verts: _Floats) -> DeformedSurface:
    """Move a surface with its welded vertices (V, 3) float64, world space."""
    rest = welded.mesh
    jacobians = completed_jacobians(rest, verts)
    areas = rest.areas
    triangles = surface.triangles[welded.face_source]
    normals = transform_normals(surface.normals, triangles, jacobians, areas)
    faces = face_cross(rest.verts, rest.faces), face_cross(verts, rest.faces)
    normals, rebuilt = rebuild_turned_normals(normals, surface.normals, triangles, *faces)
    tangents = transform_tangents(surface.tangents, normals, triangles, jacobians, areas)
    # The Jacobian of a face that did not move is the identity but for rounding.
    still = np.ones(len(normals), bool)
    still[triangles[_moved(rest, verts)].ravel()] = False
    normals[still], tangents[still] = surface.normals[still], surface.tangents[still]
    return DeformedSurface(welded.scatter(verts, surface.positions), normals, tangents, rebuilt)


def affine_surface(surface: Surface, welded: WeldedMesh, affine: _Floats) -> tuple[DeformedSurface, _Floats]:
    """Move every vertex that is deformed by one affine map (3, 4), without any solve.

    Returns the surface, and the linear map (N, 3, 3) around each vertex.
    """
    linear, shift = affine[:, :3], affine[:, 3]
    used = welded.vertex_map >= 0
    jacobians = np.tile(np.eye(3), (len(used), 1, 1))
    jacobians[used] = linear
    positions, normals, tangents = surface.positions.copy(), surface.normals.copy(), surface.tangents.copy()
    positions[used] += surface.positions[used] @ (linear - np.eye(3)).T + shift
    normals[used] = unit_rows(normals[used] @ np.linalg.inv(linear))
    tangents[used, :3] = unit_rows(tangents[used, :3] @ linear.T)
    return DeformedSurface(positions, normals, tangents, 0), jacobians


@dataclass(frozen=True)
class Shown:
    """A source and its result as viewers show them."""

    # The welded surfaces, +Y up, with the same faces
    source: TriangleMesh
    result: TriangleMesh
    poses: tuple[SurfaceState, SurfaceState]  # of all vertices of the files, for pictures: source and result

    @classmethod
    def of(cls, asset: Asset, written: Asset, welded: WeldedMesh, verts: _Floats) -> Shown:
        """Compare the source with the result, read back from its file.

        `verts`, (V, 3) float64: deformed positions of the welded vertices.
        """
        # Not rounded to the precision of the file, unless vertices cannot be moved where the file is shown.
        result = TriangleMesh(verts, welded.mesh.faces)
        if asset.surface.stays.any():
            result = welded.gather(written.surface.positions)
        before, after = (SurfaceState(each.surface.positions, each.surface.normals) for each in (asset, written))
        return cls(welded.mesh, result, (before, after))


def prepared(
    asset: Asset, params: ResolvedParams, output: OutputParams, limits: Limits | None
) -> tuple[Asset, Subdivision | None]:
    """Return the asset that a run deforms, and what was split if it is subdivided."""
    if params.exclude:
        asset = _without(asset, params.exclude)
    return subdivided(asset, limits) if output.subdivide else (asset, None)


def _without(asset: Asset, exclude: Sequence[str | int]) -> Asset:
    try:
        return asset.without(find_excluded(exclude, asset.pieces().nodes))
    except AssetEmptyError as error:
        detail = "params.control.exclude: nothing is left to deform."
        raise ParameterError.at(["params", "control", "exclude"], detail, "Exclude fewer nodes.") from error


def drawn_triangles(asset: Asset, backdrop: BackdropMode = BackdropMode.LEAVE) -> NDArray[np.bool_]:
    """Return flags (T,) of the triangles of the surface that are drawn and deformed: all but a backdrop's."""
    hidden = asset.backdrop
    if hidden is None or not hidden.left or backdrop is BackdropMode.DEFORM:
        return np.ones(len(asset.surface.triangles), bool)
    return ~hidden.triangles


def welded_surface(asset: Asset, backdrop: BackdropMode = BackdropMode.LEAVE) -> WeldedMesh:
    """Weld the triangles that are drawn and deformed."""
    surface = asset.surface
    return weld(surface.positions, surface.triangles, left_out=~drawn_triangles(asset, backdrop))


def subdivided(asset: Asset, limits: Limits | None) -> tuple[Asset, Subdivision]:
    """Return the asset with its long edges split, within the limits of the deployment, and what was split."""
    return asset.subdivided(min(MAX_TRIANGLES, (limits or Limits()).max_triangles))


def shape_id(asset_sha256: str, asset: Asset, params: ResolvedParams, output: OutputParams) -> str:
    """Return the id of the mesh that a run deforms; a checkpoint fits only its own."""
    done = ["subdivided"] if output.subdivide else []
    if asset.rig().joints:
        done.append("shown")  # skins were deformed in their bind pose once
    without = [json.dumps(name) for name in params.exclude]
    if not drawn_triangles(asset, params.backdrop).all():
        without.append("backdrop")
    return "+".join([asset_sha256, *done, *without])


def read_result(result: bytes) -> Asset:
    """Read our own `result.glb` back, without the limits for sources."""
    return load_asset(result, "result.glb", Limits.unlimited())
