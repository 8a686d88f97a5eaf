"""Say what a mesh looks like to the judge of the builtin prior's nouns."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from meshdeform.errors import ModelError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.torch_threads import one_torch_thread
from meshdeform.judge import Judge
from meshdeform.priors.builtin.grammar import parse

__all__ = ["before", "likeness", "likeness_and_before", "summarize"]

_log = logging.getLogger(__name__)


@one_torch_thread()
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


def likeness_and_before(
    source: TriangleMesh, result: TriangleMesh, prompt: str, nouns: Mapping[str, float]
) -> dict[str, Any] | None:
    """Compare a result and its source with the noun of a prompt.

    Parameters
    ----------
    source, result : TriangleMesh
    prompt : str
    nouns : mapping of str to float
        The probabilities of all nouns for the source; if it is empty, the judge is asked.

    Returns
    -------
    The likeness of the result, with that of the source as `before`; None as in `likeness`.
    """
    compared = likeness(result, prompt)
    if compared is not None:
        compared["before"] = before(summarize(nouns, compared["noun"]) if nouns else likeness(source, prompt))
    return compared


def summarize(probabilities: Mapping[str, float], noun: str) -> dict[str, Any]:
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


def before(source: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return the member `before` of a likeness: what the likeness of the source says of the same noun."""
    return None if source is None else {name: source[name] for name in ("probability", "rank")}
