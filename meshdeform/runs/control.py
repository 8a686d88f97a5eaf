"""Turn the parameters that control where an asset may deform into constraints, and measure that they were met.

A selection of the request selects faces of the surface, or bodies that keep their shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.assets import Asset
from meshdeform.assets.surface_pieces import SurfacePieces
from meshdeform.deformation.constraints import (
    TOLERANCE,
    Constraints,
    HandleConstraint,
    Mirror,
    Partners,
    RigidBody,
    find_partners,
    freedom_around,
    handle_rows,
)
from meshdeform.errors import ParameterError
from meshdeform.geometry.congruence import Component, components_of, congruent_groups, is_of_revolution
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.nearest_points import NearestPoints
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.rendering.cameras import CameraFrame
from meshdeform.requests import selection
from meshdeform.requests.choices import RegionAction, Rigidity, Symmetry
from meshdeform.requests.document import DeformParams, ResolvedParams, resolve
from meshdeform.requests.selection import RigidParams
from meshdeform.runs.changes import parts_found
from meshdeform.runs.reading import ReadingSource, reading_document, welded_body
from meshdeform.runs.selectable import SelectableSurface
from meshdeform.runs.surfaces import welded_surface
from meshdeform.runs.text_deform_check import check_points

_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]
_AUTO_ORDER = (0, 2, 1)
_Index = NDArray[np.int64]
MAX_COMPARED = 200
"""Components that are compared with each other: those with the most faces."""


class WeldedSurface(SelectableSurface):
    """The surface of an asset that a run deforms, with what selections can refer to."""

    def __init__(self, asset: Asset, welded: WeldedMesh) -> None:
        mesh = welded.mesh
        super().__init__(asset, mesh.verts, mesh.faces, welded.face_source)
        self.welded = welded

    @property
    def mesh(self) -> RestMesh:
        """The welded mesh, in the file's units."""
        return self.welded.mesh


def select_bodies(selectors: Sequence[RigidParams], surface: WeldedSurface) -> list[RigidBody]:
    """Return the bodies of an asset that keep their shape.

    Selections that share vertices become one body, which is rigid if one of them is.
    """
    if not selectors:
        return []
    selected = [
        RigidBody(verts, selector.mode)
        for number, selector in enumerate(selectors)
        for verts in _bodies(selector, surface.faces(("control", "rigid"), number, selector), surface.mesh)
    ]
    bodies = _united([_with_edges(body, surface.mesh) for body in selected], len(surface.mesh.verts))
    if len(bodies) == 1 and len(bodies[0].verts) == len(surface.mesh.verts):
        raise ParameterError(
            "params.control.rigid: the whole asset is one rigid body, so nothing is left to deform.",
            advice="Select the parts that keep their shape only.",
        )
    return bodies


def _with_edges(body: RigidBody, mesh: RestMesh) -> RigidBody:
    """Return a body with the ends of the edges on which its vertices lie, which would come off it otherwise."""
    if not len(mesh.junctions):
        return body
    members = np.zeros(len(mesh.verts), bool)
    members[body.verts] = True
    return replace(body, verts=np.flatnonzero(mesh.junctions.completed(members)))


def _bodies(selector: RigidParams, flags: _Flags, mesh: RestMesh) -> list[_Index]:
    """Return the vertices of each body: all together, or each connected part of the selected faces."""
    faces = mesh.faces[flags]
    verts, local = np.unique(faces, return_inverse=True)
    if selector.together:
        return [verts]
    corners = local.reshape(-1, 3)
    rows, columns = np.concatenate([corners[:, :2], corners[:, 1:]]).T
    graph = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(len(verts), len(verts)))
    count, label = csgraph.connected_components(graph, directed=False)
    return _groups(verts, label, count)


def _united(bodies: Sequence[RigidBody], count: int) -> list[RigidBody]:
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
    return [RigidBody(np.unique(verts), mode) for verts, mode in zip(groups, modes, strict=True)]


def _groups(values: _Index, label: NDArray[np.int32], count: int) -> list[_Index]:
    """Return the values with each of `count` labels."""
    order = np.argsort(label, kind="stable")
    return np.split(values[order], np.cumsum(np.bincount(label, minlength=count))[:-1])


@dataclass(frozen=True)
class AssetControl:
    """Control of a request over where its asset may deform."""

    constraints: Constraints = field(default_factory=Constraints)  # on the welded mesh in the cameras' frame
    bodies: list[RigidBody] = field(default_factory=list)
    """Bodies that keep their shape; one that touches what is kept is kept as a whole, and not listed."""
    regions: list[dict[str, Any]] = field(default_factory=list)
    """For each region: its `action`, and the `faces` that it selects."""
    partners: Partners | None = None  # the mirrored partners of the vertices, if a symmetry is kept


def read_control(params: ResolvedParams, surface: WeldedSurface, frame: CameraFrame, mesh: RestMesh) -> AssetControl:
    """Return the constraints of a request.

    `surface`: in the file's units; `mesh`: the welded mesh in the cameras' frame.
    """
    verts = surface.mesh.verts
    check_points(params, {"asset": (verts.min(0).tolist(), verts.max(0).tolist())})
    kept, regions = _kept_verts(params.regions, surface)
    bodies = select_bodies(params.rigid, surface)
    partners = _partners(params.symmetry, surface.mesh)
    kept = _completed(kept, bodies, partners, surface.mesh)
    bodies = [body for body in bodies if not kept[body.verts].any()]
    if kept.all():
        raise _refusal("regions", "they keep the whole asset, so nothing is left to deform.", "Keep less.")
    diagonal = float(np.linalg.norm(np.ptp(mesh.verts, axis=0)))
    falloff = params.falloff * diagonal
    handles = [_handle(number, item, surface, frame, kept, bodies) for number, item in enumerate(params.handles)]
    constraints = Constraints(
        _freedom(mesh, kept, falloff, partners),
        falloff,
        Mirror.of_partners(partners) if partners is not None else None,
        handles,
    )
    return AssetControl(constraints, bodies, regions, partners)


def _kept_verts(
    regions: Sequence[selection.RegionParams], surface: WeldedSurface
) -> tuple[_Flags, list[dict[str, Any]]]:
    """Return flags (V,) of the vertices that the regions keep, and what each region selects."""
    faces = surface.mesh.faces
    kept, allowed = np.zeros(len(faces), bool), np.zeros(len(faces), bool)
    properties = []
    for number, region in enumerate(regions):
        flags = surface.faces(("control", "regions"), number, region)
        properties.append({"action": region.action.value, "faces": int(flags.sum())})
        if region.action is RegionAction.KEEP:
            kept |= flags
        else:
            allowed |= flags
    if allowed.any():
        kept |= ~allowed
    verts = np.zeros(len(surface.mesh.verts), bool)
    verts[faces[kept].ravel()] = True
    return verts, properties


def _completed(kept: _Flags, bodies: Sequence[RigidBody], partners: Partners | None, mesh: RestMesh) -> _Flags:
    """Return the kept vertices (V,) with the mirror images of all, and with the whole of bodies that they touch.

    An edge on which a kept vertex lies is kept as well: otherwise, it would leave that behind.
    """
    kept = kept.copy()
    while True:
        before = int(kept.sum())
        for body in bodies:
            kept[body.verts] |= kept[body.verts].any()
        if partners is not None:
            kept |= kept[partners.partner]
        kept = mesh.junctions.completed(kept)
        if int(kept.sum()) == before:
            return kept


def _freedom(mesh: RestMesh, kept: _Flags, falloff: float, partners: Partners | None) -> _Floats | None:
    if not kept.any():
        return None
    freedom = freedom_around(mesh, kept, falloff)
    return freedom if partners is None else np.minimum(freedom, freedom[partners.partner])


def _partners(symmetry: Symmetry, mesh: RestMesh) -> Partners | None:
    if symmetry is Symmetry.NONE:
        return None
    if symmetry is Symmetry.AUTO:
        candidates = (find_partners(mesh, axis) for axis in _AUTO_ORDER)
        return next((partners for partners in candidates if not partners.unmatched), None)
    partners = find_partners(mesh, "xyz".index(symmetry.value))
    if partners.unmatched:
        raise _refusal(
            "symmetry",
            f"the asset is not symmetric along {symmetry.value}: {partners.unmatched:,} of its {len(mesh.verts):,} "
            f"vertices have no mirrored partner within {TOLERANCE:g} of its diagonal.",
            "Set it to none, or to auto, which keeps a symmetry only where there is one.",
        )
    return partners


def _handle(
    number: int,
    item: selection.HandleParams,
    surface: WeldedSurface,
    frame: CameraFrame,
    kept: _Flags,
    bodies: Sequence[RigidBody],
) -> HandleConstraint:
    corners, shares = _held_point(number, item, surface)
    where = f"handle {number}"
    if kept[list(corners)].all():
        raise _refusal("handles", f"{where} holds a point that is kept.", "Move it, or keep less.", number)
    if any(np.isin(corners, body.verts).any() for body in bodies):
        raise _refusal("handles", f"{where} holds a point of a rigid part.", "Leave out one of the two.", number)
    goal = frame.enter(np.array(item.to, np.float64))
    return HandleConstraint(corners, shares, goal, item.weight)


def _held_point(
    number: int, item: selection.HandleParams, surface: WeldedSurface
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Return the welded vertices around the point that a handle holds, and its barycentric coordinates."""
    if item.vertex is not None:
        sources = surface.welded.vertex_map
        if item.vertex >= len(sources) or sources[item.vertex] < 0:
            detail = f"handle {number}: no triangle has the vertex {item.vertex}."
            raise _refusal("handles", detail, f"The asset's vertices are 0 to {len(sources) - 1}.", number)
        return (int(sources[item.vertex]),), (1.0,)
    nearest = NearestPoints(surface.mesh, np.array([item.position], np.float64), np.zeros((1, 3)))
    return tuple(int(corner) for corner in nearest.corners[0]), tuple(float(share) for share in nearest.weights[0])


def _refusal(name: str, detail: str, advice: str, *index: int) -> ParameterError:
    return ParameterError.at(["params", "control", name, *index], f"params.control.{name}: {detail}", advice)


def control_report(
    control: AssetControl, params: ResolvedParams, welded: WeldedMesh, frame: CameraFrame, source: Asset, result: Asset
) -> dict[str, Any]:
    """Return the members of the report about control that the request uses; lengths are shares of the diagonal.

    `result`: `result.glb`, read back.
    """
    before, after = source.surface.positions, result.surface.positions
    diagonal = float(np.linalg.norm(np.ptp(welded.mesh.verts, axis=0)))
    positions = welded.mesh.verts.copy()
    used = np.flatnonzero(welded.vertex_map >= 0)
    positions[welded.vertex_map[used]] = after[used]
    report: dict[str, Any] = {}
    kept = control.constraints.kept
    if kept is not None:
        rows = used[kept[welded.vertex_map[used]]]
        report["regions"] = {
            "selected": control.regions,
            "kept_faces": int(kept[welded.mesh.faces].all(1).sum()),
            "kept_vertices": int(kept.sum()),
            "max_moved": float(np.abs(after[rows] - before[rows]).max(initial=0.0)) / diagonal,
        }
    if control.constraints.handles:
        report["handles"] = _handles_report(control, frame, positions, diagonal)
    if params.symmetry != "none":
        report["symmetry"] = _symmetry_report(control, welded.mesh, positions, diagonal)
    return report


def _handles_report(
    control: AssetControl, frame: CameraFrame, positions: _Floats, diagonal: float
) -> list[dict[str, Any]]:
    handles = control.constraints.handles
    reached = handle_rows(handles, len(positions)) @ positions
    goals = np.stack([handle.goal for handle in handles]) / frame.scale + frame.centre
    missing = np.linalg.norm(reached - goals, axis=1) / diagonal
    return [
        {"weight": handle.weight, "reached": point.tolist(), "distance": float(distance)}
        for handle, point, distance in zip(handles, reached, missing, strict=True)
    ]


def _symmetry_report(control: AssetControl, mesh: RestMesh, positions: _Floats, diagonal: float) -> dict[str, Any]:
    if control.partners is None:
        closest = min((find_partners(mesh, axis) for axis in range(3)), key=lambda partners: partners.unmatched)
        return {"axis": None, "closest": "xyz"[closest.axis], "unmatched_vertices": closest.unmatched}
    axis, partner = control.partners.axis, control.partners.partner
    moved = positions - mesh.verts
    mirrored = moved[partner]
    mirrored[:, axis] *= -1
    return {
        "axis": "xyz"[axis],
        "source_deviation": control.partners.deviation,
        "added_deviation": float(np.linalg.norm(moved - mirrored, axis=1).max()) / diagonal,
    }


def inspect_parts(
    asset: Asset, params: ResolvedParams | None = None, source: ReadingSource | None = None
) -> dict[str, Any]:
    """Return the names that a selection can refer to in an asset, and proposals for `params.control.rigid`, as JSON.

    `params`: give its noun, its front and corrections of its parts; by default nothing; `source`: its file, if the
    reading is kept.

    Beside the named `nodes`, `mesh_names`, `materials` and `joints` there are the `box` of its coordinates, whether it
    has vertex `colors`, its `reading` (`runs.reading.reading_document`; None if it cannot be read), the `parts` that a
    change in plain words can name (`changes.parts_found`), and its `symmetry`: the axes along which
    `params.control.symmetry` can be kept.

    A component has its `number` for `params.control.rigid`, its `triangles`, its `size` as a share of the asset's,
    its `nodes` and its `materials`. A proposal has the numbers of its `components`, whether they are
    `congruent` and `round`, and the `selectors` that select them.
    """
    parts = asset.pieces()
    welded = welded_surface(asset)
    components = components_of(welded.mesh)
    owners = _owners(welded, parts)
    size = float(np.linalg.norm(np.ptp(welded.mesh.verts, axis=0)))
    params = params or resolve(DeformParams())
    body = welded_body(asset, welded, params, source)
    return {
        "triangles": len(asset.surface.triangles),
        "vertices": len(asset.surface.positions),
        "nodes": parts.nodes,
        "materials": parts.materials,
        "mesh_names": parts.meshes,
        "joints": parts.joints,
        "colors": bool(np.isfinite(asset.vertex_colors()).any()),
        "box": {name: bound.tolist() for name, bound in _box(welded).items()},
        "reading": reading_document(body.reader.reading, params),
        "parts": parts_found(body, params),
        "symmetry": [name for axis, name in enumerate("xyz") if not find_partners(welded.mesh, axis).unmatched],
        "components": [
            {
                "number": component.number,
                "triangles": len(component.faces),
                "size": round(float(np.linalg.norm(np.ptp(component.points, axis=0))) / size, 4),
                **{what: _values(pairs, components=[component.number]) for what, pairs in owners.items()},
            }
            for component in components
        ],
        "proposals": _proposals(components, owners),
        "warnings": list(asset.summary.warnings),
    }


def _box(welded: WeldedMesh) -> dict[str, NDArray[np.float64]]:
    points = welded.mesh.verts
    return {"min": points.min(0), "max": points.max(0)}


def _owners(welded: WeldedMesh, parts: SurfacePieces) -> dict[str, _Index]:
    """Return, for `nodes` and `materials`, the distinct pairs (P, 2) of component and index."""
    component = welded.mesh.components[welded.mesh.faces[:, 0]]
    indices = {"nodes": parts.node_of_triangle, "materials": parts.material_of_triangle}
    return {
        what: np.unique(np.stack([component, of_triangle[welded.face_source]], 1), axis=0)
        for what, of_triangle in indices.items()
    }


def _values(pairs: _Index, *, components: Sequence[int]) -> list[int]:
    values = np.unique(pairs[np.isin(pairs[:, 0], components), 1])
    return [int(value) for value in values if value >= 0]


def _proposals(components: Sequence[Component], owners: dict[str, _Index]) -> list[dict[str, Any]]:
    """Propose groups of congruent components and others that are round, unless there is only one; round ones first."""
    if len(components) < 2:
        return []
    most = sorted(components, key=lambda component: (-len(component.faces), component.number))[:MAX_COMPARED]
    compared = {component.number: component for component in most}
    groups = congruent_groups(sorted(most, key=lambda component: component.number))
    grouped = {number for group in groups for number in group}
    alone = [[number] for number in sorted(compared) if number not in grouped]
    proposals: list[dict[str, Any]] = []
    for group in [*groups, *alone]:
        is_round = is_of_revolution(compared[group[0]])
        if len(group) > 1 or is_round:
            proposals.append(
                {
                    "components": group,
                    "congruent": len(group) > 1,
                    "round": is_round,
                    "selectors": _selectors(group, owners),
                }
            )
    return sorted(proposals, key=lambda proposal: not proposal["round"])


def _selectors(group: list[int], owners: dict[str, _Index]) -> list[dict[str, int]]:
    """Return selectors of exactly these components: one material, else nodes, else the components themselves."""
    for what, most in (("materials", 1), ("nodes", len(group))):
        pairs = owners[what]
        values = _values(pairs, components=group)
        whole = np.unique(pairs[np.isin(pairs[:, 1], values), 0]).tolist() == sorted(group)
        if whole and 0 < len(values) <= most:
            return [{what[:-1]: value} for value in values]
    return [{"component": number} for number in group]
