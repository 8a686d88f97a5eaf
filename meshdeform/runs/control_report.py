"""Measure on the written file that what controls where an asset may deform was met."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset
from meshdeform.deformation.handles import handle_rows
from meshdeform.deformation.mirror import find_partners
from meshdeform.geometry.rest_mesh import RestMesh
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.rendering.cameras import Frame
from meshdeform.requests.control import LengthLimits
from meshdeform.requests.document import ResolvedParams
from meshdeform.runs.control import Control

__all__ = ["control_report"]

_Floats = NDArray[np.float64]


def control_report(
    control: Control, params: ResolvedParams, welded: WeldedMesh, frame: Frame, source: Asset, result: Asset
) -> dict[str, Any]:
    """Return the members of the report about control that the request uses; lengths are shares of the diagonal.

    Parameters
    ----------
    control : Control
    params : ResolvedParams
    welded : WeldedMesh
    frame : Frame
    source : Asset
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
    if params.length != LengthLimits():
        report["length"] = _lengths(params, welded.mesh.verts.numpy(), places)
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


def _lengths(params: ResolvedParams, before: _Floats, after: _Floats) -> dict[str, Any]:
    sizes, new = np.ptp(before, axis=0), np.ptp(after, axis=0)
    return {
        name: {
            "source": float(sizes[axis]),
            "result": float(new[axis]),
            "min": low * float(sizes[axis]) if low > 0 else None,
            "max": high * float(sizes[axis]) if high < np.inf else None,
        }
        for axis, (name, (low, high)) in enumerate(zip("xyz", params.length.bounds, strict=True))
    }
