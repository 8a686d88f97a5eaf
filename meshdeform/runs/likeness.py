"""Estimate whether a result looks like its prompt, by the judge that ships with the builtin prior."""

from __future__ import annotations

import logging
from typing import Any

from meshdeform.errors import ModelError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge import Judge
from meshdeform.priors.builtin.grammar import parse

__all__ = ["likeness", "summarize"]

_log = logging.getLogger(__name__)


def likeness(mesh: TriangleMesh, prompt: str) -> dict[str, Any] | None:
    """Compare a mesh with the noun of a prompt of the builtin prior.

    Parameters
    ----------
    mesh : TriangleMesh
        +Y up, of any position and size.
    prompt : str

    Returns
    -------
    As in `summarize`, with the judge's identity; None if its weights are missing or damaged, which is logged.
    """
    try:
        judge = Judge()
    except ModelError as error:
        _log.warning("the result's likeness is not estimated: %s", error)
        return None
    return {**summarize(judge.noun_probabilities(mesh), parse(prompt).noun), "judge": judge.identity}


def summarize(probabilities: dict[str, float], noun: str) -> dict[str, Any]:
    """Summarize the probabilities of all nouns for a result that should be `noun`.

    Returns
    -------
    dict
        `noun`, its `probability` and `rank` from 1, the number of `nouns`, the most probable other one as `next`, and
        `matches`: whether the rank is 1.
    """
    wanted = probabilities[noun]
    other = max((name for name in probabilities if name != noun), key=probabilities.__getitem__)
    rank = 1 + sum(probability > wanted for probability in probabilities.values())
    return {
        "noun": noun,
        "probability": round(wanted, 4),
        "rank": rank,
        "nouns": len(probabilities),
        "next": {"noun": other, "probability": round(probabilities[other], 4)},
        "matches": rank == 1,
    }
