"""Turn the parameters that control where an asset may deform into constraints, and measure that they were met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.assets import Asset
from meshdeform.deformation.constraints import Constraints, Handle, freedom_around
from meshdeform.deformation.handles import handle_rows
from meshdeform.deformation.mirror import TOLERANCE, Mirror, Partners, find_partners
from meshdeform.deformation.rigid_bodies import Body
from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import RestMesh
from meshdeform.geometry.places import NearestPlaces
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.rendering.cameras import Frame
from meshdeform.requests import selection
from meshdeform.requests.choices import RegionAction, Symmetry
from meshdeform.requests.document import ResolvedParams
from meshdeform.runs.selection import SelectableSurface, select_bodies
from meshdeform.runs.text_deform_checks import check_places

__all__ = ["Control", "control_report", "read_control"]


_AUTO_ORDER = (0, 2, 1)

_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Control:
    """What a request says about where its asset may deform.

    Attributes
    ----------
    constraints : Constraints
        On the welded mesh in the cameras' frame.
    bodies : list of Body
        What keeps its shape; a body that touches what is kept is kept as a whole, and not listed.
    regions : list of dict
        For each region: its `action`, and the `faces` that it selects.
    partners : Partners, optional
        The mirrored partners of the vertices, if a symmetry is kept.
    """

    constraints: Constraints = field(default_factory=Constraints)
    bodies: list[Body] = field(default_factory=list)
    regions: list[dict[str, Any]] = field(default_factory=list)
    partners: Partners | None = None


def read_control(params: ResolvedParams, surface: SelectableSurface, frame: Frame, mesh: RestMesh) -> Control:
    """Return the constraints of a request.

    Parameters
    ----------
    surface : SelectableSurface
        In the file's units.
    mesh : RestMesh
        The welded mesh in the cameras' frame.

    Raises
    ------
    ParameterError
        A selection selects nothing, everything is kept, a handle has no free point or is far away, or the asset lacks
        the symmetry.
    """
    verts = surface.mesh.verts.numpy()
    check_places(params, {"asset": (verts.min(0).tolist(), verts.max(0).tolist())})
    kept, regions = _kept(params.regions, surface)
    bodies = select_bodies(params.rigid, surface)
    partners = _partners(params.symmetry, surface.mesh)
    kept = _completed(kept, bodies, partners)
    bodies = [body for body in bodies if not kept[body.verts].any()]
    if kept.all():
        raise _refusal("regions", "they keep the whole asset, so nothing is left to deform.", "Keep less.")
    diagonal = float(np.linalg.norm(np.ptp(mesh.verts.numpy(), axis=0)))
    falloff = params.falloff * diagonal
    handles = [_handle(number, item, surface, frame, kept, bodies) for number, item in enumerate(params.handles)]
    constraints = Constraints(
        _freedom(mesh, kept, falloff, partners),
        falloff,
        Mirror.of_partners(partners) if partners is not None else None,
        handles,
    )
    return Control(constraints, bodies, regions, partners)


def _kept(regions: Sequence[selection.Region], surface: SelectableSurface) -> tuple[_Flags, list[dict[str, Any]]]:
    """Return flags (V,) of the vertices that the regions keep, and what each region selects."""
    faces = surface.mesh.faces.numpy()
    kept, allowed = np.zeros(len(faces), bool), np.zeros(len(faces), bool)
    found = []
    for number, region in enumerate(regions):
        flags = surface.faces(("control", "regions"), number, region)
        found.append({"action": region.action.value, "faces": int(flags.sum())})
        if region.action is RegionAction.KEEP:
            kept |= flags
        else:
            allowed |= flags
    if allowed.any():
        kept |= ~allowed
    verts = np.zeros(len(surface.mesh.verts), bool)
    verts[faces[kept].ravel()] = True
    return verts, found


def _completed(kept: _Flags, bodies: Sequence[Body], partners: Partners | None) -> _Flags:
    """Return the kept vertices (V,) with the mirror images of all, and with the whole of bodies that they touch."""
    kept = kept.copy()
    while True:
        before = int(kept.sum())
        for body in bodies:
            kept[body.verts] |= kept[body.verts].any()
        if partners is not None:
            kept |= kept[partners.partner]
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
        found = (find_partners(mesh, axis) for axis in _AUTO_ORDER)
        return next((partners for partners in found if not partners.unmatched), None)
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
    item: selection.Handle,
    surface: SelectableSurface,
    frame: Frame,
    kept: _Flags,
    bodies: Sequence[Body],
) -> Handle:
    corners, shares = _held_point(number, item, surface)
    where = f"handle {number}"
    if kept[list(corners)].all():
        raise _refusal("handles", f"{where} holds a point that is kept.", "Move it, or keep less.", number)
    if any(np.isin(corners, body.verts).any() for body in bodies):
        raise _refusal("handles", f"{where} holds a point of a rigid part.", "Leave out one of the two.", number)
    goal = frame.enter(torch.tensor(item.to, dtype=torch.float64)).numpy()
    return Handle(corners, shares, goal, item.weight)


def _held_point(
    number: int, item: selection.Handle, surface: SelectableSurface
) -> tuple[tuple[int, ...], tuple[float, ...]]:
    """Return the welded vertices around the point that a handle holds, and its barycentric coordinates."""
    if item.vertex is not None:
        sources = surface.welded.vertex_map
        if item.vertex >= len(sources) or sources[item.vertex] < 0:
            detail = f"handle {number}: no triangle has the vertex {item.vertex}."
            raise _refusal("handles", detail, f"The asset's vertices are 0 to {len(sources) - 1}.", number)
        return (int(sources[item.vertex]),), (1.0,)
    places = NearestPlaces(surface.mesh, np.array([item.position], np.float64), np.zeros((1, 3)))
    return tuple(int(corner) for corner in places.corners[0]), tuple(float(share) for share in places.weights[0])


def _refusal(name: str, detail: str, advice: str, *place: int) -> ParameterError:
    return ParameterError.at(["params", "control", name, *place], f"params.control.{name}: {detail}", advice)


def control_report(
    control: Control, params: ResolvedParams, welded: WeldedMesh, frame: Frame, source: Asset, result: Asset
) -> dict[str, Any]:
    """Return the members of the report about control that the request uses; lengths are shares of the diagonal.

    Parameters
    ----------
    result : Asset
        `result.glb`, read back.
    """
    before, after = source.surface.positions, result.surface.positions
    diagonal = float(np.linalg.norm(np.ptp(welded.mesh.verts.numpy(), axis=0)))
    places = welded.mesh.verts.numpy().copy()
    used = np.flatnonzero(welded.vertex_map >= 0)
    places[welded.vertex_map[used]] = after[used]
    report: dict[str, Any] = {}
    kept = control.constraints.kept
    if kept is not None:
        rows = used[kept[welded.vertex_map[used]]]
        report["regions"] = {
            "selected": control.regions,
            "kept_faces": int(kept[welded.mesh.faces.numpy()].all(1).sum()),
            "kept_vertices": int(kept.sum()),
            "max_moved": float(np.abs(after[rows] - before[rows]).max(initial=0.0)) / diagonal,
        }
    if control.constraints.handles:
        report["handles"] = _handles(control, frame, places, diagonal)
    if params.symmetry != "none":
        report["symmetry"] = _symmetry(control, welded.mesh, places, diagonal)
    return report


def _handles(control: Control, frame: Frame, places: _Floats, diagonal: float) -> list[dict[str, Any]]:
    handles = control.constraints.handles
    reached = handle_rows(handles, len(places)) @ places
    goals = np.stack([handle.goal for handle in handles]) / frame.scale + frame.centre.numpy()
    missing = np.linalg.norm(reached - goals, axis=1) / diagonal
    return [
        {"weight": handle.weight, "reached": point.tolist(), "distance": float(distance)}
        for handle, point, distance in zip(handles, reached, missing, strict=True)
    ]


def _symmetry(control: Control, mesh: RestMesh, places: _Floats, diagonal: float) -> dict[str, Any]:
    if control.partners is None:
        closest = min((find_partners(mesh, axis) for axis in range(3)), key=lambda found: found.unmatched)
        return {"axis": None, "closest": "xyz"[closest.axis], "unmatched_vertices": closest.unmatched}
    axis, partner = control.partners.axis, control.partners.partner
    moved = places - mesh.verts.numpy()
    mirrored = moved[partner]
    mirrored[:, axis] *= -1
    return {
        "axis": "xyz"[axis],
        "source_deviation": control.partners.deviation,
        "added_deviation": float(np.linalg.norm(moved - mirrored, axis=1).max()) / diagonal,
    }
