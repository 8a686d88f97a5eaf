"""Say by a run's own checks whether its result is worse than doing nothing.

It is if nothing was gained of what the prompt asks for, while a figure of the structure is beyond `LIMITS`. The noun's
rank among all that the judge knows must become half of the source's to count as gained, since far from the first ones
it changes by chance: a van that was number 115 among boats is no boat as number 62. Ranks ignore attributes: of a
prompt that has any, the rank must only not become worse. A source that ranks first already has no rank to gain: there,
without attributes, the structure alone decides.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.structure import measure_structure
from meshdeform.priors.builtin.grammar import parse
from meshdeform.priors.builtin.words import ParsedPrompt
from meshdeform.runs.recognition import CROOKED

__all__ = ["KEEP_RESULT", "KEEP_SOURCE", "LIMITS", "kept_structure", "verdict", "worse_than_source"]

KEEP_RESULT, KEEP_SOURCE = "keep_result", "keep_source"

LIMITS = {
    "asymmetry": 0.01,  # of the diagonal: a leg or a wheel is seen to be longer than its mirror image
    "flatness": 0.01,  # of a piece's diagonal: a table top or a wall is seen to bulge
    "contacts": 0.005,  # of the diagonal: a gap between parts is seen
    "cut_share": 0.01,  # of the faces: fewer usually hide where parts meet
    "flipped_faces": 0.0,  # each is a hole or a dark spot
}
"""Largest figures of a result whose structure counts as kept."""

_SENTENCES = {
    "asymmetry": "Mirror symmetry was lost: {:.1%} of the diagonal.",
    "flatness": "Flat pieces were bent: {:.1%} of their diagonals.",
    "contacts": "Parts that touched came apart: {:.1%} of the diagonal.",
    "cut_share": "Faces newly cut others: {:.1%} of all.",
    "flipped_faces": "Faces were flipped: {:,}.",
}


def kept_structure(source: TriangleMesh, result: TriangleMesh, quality: Mapping[str, Any]) -> dict[str, Any]:
    """Measure what a result kept of its source.

    Parameters
    ----------
    source, result : TriangleMesh
        With the same faces, +Y up.
    quality : mapping
        The fields of `meshdeform.geometry.quality.MeshQuality` for these two.

    Returns
    -------
    dict
        The fields of `meshdeform.geometry.structure.Structure`, `cut_share` (of the faces; 0 if not counted) and
        `flipped_faces`.
    """
    cuts = quality["self_intersections_added"] or 0
    shares = {"cut_share": cuts / len(source.faces), "flipped_faces": quality["flipped_faces"]}
    return {**measure_structure(source, result).to_dict(), **shares}


def worse_than_source(before: int, after: int, structure: Mapping[str, Any]) -> bool:
    """Return whether a noun gained no rank at all, from `before` to `after`, while the structure suffered."""
    return after >= before and bool(_beyond(structure))


def verdict(prompt: str, likeness: Mapping[str, Any], structure: Mapping[str, Any]) -> dict[str, Any]:
    """Return the report's member `verdict`.

    Parameters
    ----------
    prompt : str
    likeness : mapping
        That of the report, with its `before`.
    structure : mapping
        As `kept_structure` returns it.

    Returns
    -------
    dict
        `value`: `keep_result` or `keep_source`; its `reasons`, a list of sentences that is empty for `keep_result`;
        and the `structure`.
    """
    rank, was = likeness["rank"], likeness["before"]["rank"]
    attributes = parse(prompt).attributes
    gained = rank <= was if attributes else 2 * rank <= was
    crooked = any(attribute.degree in CROOKED for attribute in attributes)
    beyond = _beyond(structure, excused=("asymmetry", "flatness") if crooked else ())
    if gained or not beyond:
        return {"value": KEEP_RESULT, "reasons": [], "structure": dict(structure)}
    reasons = [_rank_reason(likeness["noun"], rank, was, likeness["nouns"])]
    reasons += [_SENTENCES[name].format(structure[name]) for name in beyond]
    return {"value": KEEP_SOURCE, "reasons": reasons, "structure": dict(structure)}


def _beyond(structure: Mapping[str, Any], excused: Collection[str] = ()) -> list[str]:
    """Return the figures that are beyond their limits."""
    return [name for name, limit in LIMITS.items() if name not in excused and (structure[name] or 0.0) > limit]


def _rank_reason(noun: str, rank: int, was: int, nouns: int) -> str:
    """Say why no rank was gained."""
    what = ParsedPrompt(noun)
    if rank == was == 1:
        return f"The source looked like {what} already."
    more = "hardly more" if rank < was else "no more"
    return f"It looks {more} like {what} than before: rank {rank} of {nouns} nouns, was {was}."
