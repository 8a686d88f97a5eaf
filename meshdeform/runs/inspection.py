"""Describe the parts of an asset, and propose those that should keep their shape. Imports torch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset
from meshdeform.assets.surface import Parts
from meshdeform.deformation.constraints import find_partners
from meshdeform.geometry.congruence import Component, components_of, congruent_groups, is_of_revolution
from meshdeform.geometry.weld import WeldedMesh
from meshdeform.plain.body import body_of
from meshdeform.runs.changes import part_names
from meshdeform.runs.surfaces import welded_surface

MAX_COMPARED = 200
"""Components that are compared with each other: those with the most faces."""

_Index = NDArray[np.int64]


def inspect_parts(asset: Asset) -> dict[str, Any]:
    """Return the names that a selection can refer to in an asset, and proposals for `params.control.rigid`, as JSON.

    Beside the named `nodes`, `mesh_names`, `materials` and `joints` there are the `box` of its coordinates, whether it
    has vertex `colors`, the `parts` that a change in plain words can name, and its `symmetry`: the axes along which
    `params.control.symmetry` can be kept.

    A component has its `number` for `params.control.rigid`, its `triangles`, its `size` as a share of the asset's,
    its `nodes` and its `materials`. A proposal has the numbers of its `components`, whether they are
    `congruent` and `round`, and the `selectors` that select them.
    """
    parts = asset.parts()
    welded = welded_surface(asset)
    components = components_of(welded.mesh)
    owners = _owners(welded, parts)
    size = float(np.linalg.norm(np.ptp(welded.mesh.verts.numpy(), axis=0)))
    return {
        "triangles": len(asset.surface.triangles),
        "vertices": len(asset.surface.positions),
        "nodes": parts.nodes,
        "materials": parts.materials,
        "mesh_names": parts.meshes,
        "joints": parts.joints,
        "colors": bool(np.isfinite(asset.vertex_colors()).any()),
        "box": {name: bound.tolist() for name, bound in _box(welded).items()},
        "parts": part_names(body_of(asset, welded.vertex_map, welded.first_rows(), welded.mesh.faces.numpy())),
        "symmetry": [name for axis, name in enumerate("xyz") if not find_partners(welded.mesh, axis).unmatched],
        "components": [
            {
                "number": component.number,
                "triangles": len(component.faces),
                "size": round(float(np.linalg.norm(np.ptp(component.points, axis=0))) / size, 4),
                **{what: _values(found, components=[component.number]) for what, found in owners.items()},
            }
            for component in components
        ],
        "proposals": _proposals(components, owners),
        "warnings": list(asset.summary.warnings),
    }


def _box(welded: WeldedMesh) -> dict[str, NDArray[np.float64]]:
    points = welded.mesh.verts.numpy()
    return {"min": points.min(0), "max": points.max(0)}


def _owners(welded: WeldedMesh, parts: Parts) -> dict[str, _Index]:
    """Return, for `nodes` and `materials`, the distinct pairs (P, 2) of component and index."""
    component = welded.mesh.components.numpy()[welded.mesh.faces.numpy()[:, 0]]
    indices = {"nodes": parts.node_of_triangle, "materials": parts.material_of_triangle}
    return {
        what: np.unique(np.stack([component, of_triangle[welded.face_source]], 1), axis=0)
        for what, of_triangle in indices.items()
    }


def _values(pairs: _Index, *, components: Sequence[int]) -> list[int]:
    found = np.unique(pairs[np.isin(pairs[:, 0], components), 1])
    return [int(value) for value in found if value >= 0]


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
