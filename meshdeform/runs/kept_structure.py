"""Say what a result kept of the structure of its source, and what of it broke.

What follows from that is decided in `meshdeform.runs.worth`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import suppress
from typing import Any

from meshdeform.geometry.intersections import TooManyPairsError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.moved_cuts import newly_cut
from meshdeform.geometry.structure_changes import measure_structure

LIMITS = {
    "asymmetry": 0.01,  # of the diagonal: a leg or a wheel is seen to be longer than its mirror image
    "flatness": 0.01,  # of a piece's diagonal: a table top or a wall is seen to bulge
    "contacts": 0.005,  # of the diagonal: a gap between parts is seen
    "cut_share": 0.01,  # of the faces: fewer usually hide where parts meet
    "flipped_faces": 0.0,  # each is a hole or a dark spot
    "opened_junctions": 0.0,  # each is the end of a crack, through which one looks into the asset
}
"""Largest figures of a result whose structure counts as kept."""

_SENTENCES = {
    "asymmetry": "Mirror symmetry was lost: {:.1%} of the diagonal.",
    "flatness": "Flat pieces were bent: {:.1%} of their diagonals.",
    "contacts": "Parts that touched came apart: {:.1%} of the diagonal.",
    "cut_share": "Faces newly cut others: {:.1%} of all.",
    "flipped_faces": "Faces were flipped: {:,}.",
    "opened_junctions": "Cracks opened: {:,} of the vertices on edges of other faces came off.",
}


def kept_structure(
    source: TriangleMesh, result: TriangleMesh, quality: Mapping[str, Any], *, of_parts: bool = False
) -> dict[str, Any]:
    """Measure how much a result kept of its source.

    `source` and `result`: with the same faces, +Y up; `quality`: the fields of
    `meshdeform.geometry.quality.MeshQuality` for these two; `of_parts`: whether only parts were changed, which may have
    stood in others. Returns dict: the fields of `StructureChanges`, `cut_share` (of the faces; 0
    if not counted; of parts beyond the limit without cuts that moved on), `flipped_faces` and `opened_junctions`.
    """
    cuts = quality["self_intersections_added"] or 0
    if of_parts and cuts > LIMITS["cut_share"] * len(source.faces):
        with suppress(TooManyPairsError):
            cuts = int(newly_cut(source.verts, result.verts, source.faces).sum())
    faults = {name: quality[name] for name in ("flipped_faces", "opened_junctions")}
    return {**measure_structure(source, result).to_dict(), "cut_share": cuts / len(source.faces), **faults}


def broken(
    structure: Mapping[str, Any], excused: Collection[str] = (), tolerated: Mapping[str, float] | None = None
) -> list[str]:
    """Return what of a structure is beyond its limits, in sentences.

    `excused`: figures that do not count; `tolerated`: by which factor a figure may exceed its limit.
    """
    factors = tolerated or {}
    return [
        _SENTENCES[name].format(structure[name])
        for name, limit in LIMITS.items()
        if name not in excused and (structure.get(name) or 0.0) > limit * factors.get(name, 1.0)
    ]
