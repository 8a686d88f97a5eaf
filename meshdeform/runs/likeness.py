"""Judge the likeness of a result to the nouns of its prompts.

Ranks of nouns are among all that the judge knows. What follows from them is decided in `meshdeform.runs.worth`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import ModelError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge import Judge
from meshdeform.runs.prompts import Prompts
from meshdeform.vocabulary.grammar import parse
from meshdeform.words import own_word

_log = logging.getLogger(__name__)
_Compare = Callable[[TriangleMesh, str], dict[str, Any] | None]
_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]


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
            report["likeness"] = likeness = compare(mesh if faces is None else _submesh(mesh, faces), each.prompt)
            if faces is not None and likeness is not None:
                likeness["before"] = before(compare(_submesh(rest, faces), each.prompt))
        reports.append(report)
    return reports


def _rms(squares: _Floats) -> float:
    return float(np.sqrt(squares.mean())) if len(squares) else 0.0


def _submesh(mesh: TriangleMesh, faces: _Flags) -> TriangleMesh:
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
