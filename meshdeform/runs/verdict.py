"""Judge the likeness of a result, and what broke of its structure.

Ranks of nouns are among all that the judge knows. What follows from both is decided in `meshdeform.runs.worth`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import ModelError
from meshdeform.geometry.intersections import TooManyPairsError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.moved_cuts import newly_cut
from meshdeform.geometry.quality import measure_structure
from meshdeform.judge import Judge
from meshdeform.runs.prompts import Prompts
from meshdeform.vocabulary.grammar import parse
from meshdeform.words import own_word

_log = logging.getLogger(__name__)
_Compare = Callable[[TriangleMesh, str], dict[str, Any] | None]
_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]

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
    stood in others. Returns dict: the fields of `meshdeform.geometry.quality.Structure`, `cut_share` (of the faces; 0
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
    return [_SENTENCES[name].format(structure[name]) for name in _beyond(structure, excused, tolerated)]


def _beyond(
    structure: Mapping[str, Any], excused: Collection[str] = (), tolerated: Mapping[str, float] | None = None
) -> list[str]:
    """Return the figures that are beyond their limits."""
    factors = tolerated or {}
    return [
        name
        for name, limit in LIMITS.items()
        if name not in excused and (structure.get(name) or 0.0) > limit * factors.get(name, 1.0)
    ]


def prompt_reports(
    prompts: Prompts, rest: TriangleMesh, mesh: TriangleMesh, compare: _Compare | None
) -> list[dict[str, Any]]:
    """Return the report's `prompts`: each with its weight, its region, and what became of it.

    `rest` and `mesh`: the welded source and result in their world. `compare`: compares a mesh with a prompt; a prompt
    with a region is compared with the region alone, of the source as well (`before`), since what a piece of an asset
    looks like to the judge says little by itself.
    """
    reports = []
    diagonal = float(np.linalg.norm(np.ptp(rest.verts, axis=0)))
    moved = ((mesh.verts - rest.verts) ** 2).sum(1) / diagonal**2
    corners = mesh.faces
    for each, faces in zip(prompts.given, prompts.faces, strict=True):
        report = each.model_dump(mode="json", exclude_none=True)
        report["faces"] = len(mesh.faces) if faces is None else int(faces.sum())
        if faces is not None:
            within = np.zeros(len(moved), bool)
            within[corners[faces].ravel()] = True
            report["moved"] = {"inside": _rms(moved[within]), "outside": _rms(moved[~within])}
        if compare is not None:
            report["likeness"] = likeness = compare(mesh if faces is None else _part(mesh, faces), each.prompt)
            if faces is not None and likeness is not None:
                likeness["before"] = before(compare(_part(rest, faces), each.prompt))
        reports.append(report)
    return reports


def _rms(squares: _Floats) -> float:
    return float(np.sqrt(squares.mean())) if len(squares) else 0.0


def _part(mesh: TriangleMesh, faces: _Flags) -> TriangleMesh:
    """Return some faces of a mesh as a mesh of their own."""
    used, corners = np.unique(mesh.faces[faces], return_inverse=True)
    return TriangleMesh(mesh.verts[used], corners.reshape(-1, 3).astype(np.int64))


def likeness(mesh: TriangleMesh, prompt: str) -> dict[str, Any] | None:
    """Compare a mesh with the noun of a prompt of the builtin prior.

    `mesh`: +Y up, of any position and size. Returns as in `summarize`, with the judge's identity; None for what no
    judge has seen, such as a word of somebody's own, or if its weights are missing or damaged, which is logged.
    """
    noun = parse(prompt).noun
    if own_word(noun) is not None:
        return None
    try:
        judge = Judge()
    except ModelError as error:
        _log.warning("the result's likeness is not estimated: %s", error)
        return None
    if noun not in judge.nouns:
        return None
    return {**summarize(judge.noun_probabilities(mesh), noun), "judge": judge.identity}


def likeness_and_before(source: TriangleMesh, result: TriangleMesh, prompt: str) -> dict[str, Any] | None:
    """Return the likeness of a result to the noun of a prompt, with that of its source as `before`.

    None as in `likeness`.
    """
    compared = likeness(result, prompt)
    if compared is not None:
        compared["before"] = before(likeness(source, prompt))
    return compared


def summarize(probabilities: Mapping[str, float], noun: str) -> dict[str, Any]:
    """Summarize the probabilities of all nouns for a result that should be `noun`.

    Returns dict: `noun`, its `probability` and `rank` from 1, the number of `nouns`, the most probable other one as
    `next`, and `matches`: whether the rank is 1.
    """
    share = probabilities[noun]
    other = max((name for name in probabilities if name != noun), key=probabilities.__getitem__)
    rank = 1 + sum(probability > share for probability in probabilities.values())
    return {
        "noun": noun,
        "probability": round(share, 4),
        "rank": rank,
        "nouns": len(probabilities),
        "next": {"noun": other, "probability": round(probabilities[other], 4)},
        "matches": rank == 1,
    }


def before(source: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return the member `before` of a likeness: what the likeness of the source says of the same noun."""
    return None if source is None else {name: source[name] for name in ("probability", "rank")}
