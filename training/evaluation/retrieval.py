"""Check whether a result shows its prompt: an independent judge retrieves it among all prompts of the suite.

A result is a hit if no other prompt of the suite fits it better (rank 1); with P prompts, chance hits 1 / P. The share
of hits is the retrieval precision at 1, or R-precision with one relevant prompt per result.

Sources: Park et al. 2021, Benchmark for Compositional Text-to-Image Synthesis (R-precision by CLIP); Jain et al. 2022,
Dream Fields, section 4 (for shapes made from text).
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import ParameterError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.vocabulary.grammar import parse

BUILTIN_JUDGE, NO_JUDGE = "builtin", "none"


class ShapeJudge(Protocol):
    """Judge of which prompt a mesh shows."""

    @property
    def identity(self) -> Mapping[str, str]:
        """`id`, `revision` and `sha256` of the judge."""

    def log_likelihoods(self, mesh: TriangleMesh, prompts: Sequence[str]) -> NDArray[np.floating]:
        """Score how well each prompt fits the mesh: (P,), log p(mesh | prompt) up to a constant of the mesh."""

    def noun_probabilities(self, mesh: TriangleMesh) -> dict[str, float]:
        """Return the probability of each noun of the judge's vocabulary; they sum to 1."""


def load_judge(name: str) -> ShapeJudge | None:
    """Load a judge by name: `builtin`, `none`, or `package.module:name` of a callable that returns one.

    Raises
    ------
    ParameterError
        There is no judge of this name.
    ModelError
        The weights are not available.
    """
    if name == NO_JUDGE:
        return None
    if name == BUILTIN_JUDGE:
        name = "meshdeform.judge:Judge"
    module, _, attribute = name.partition(":")
    try:
        make: Callable[[], ShapeJudge] = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise ParameterError(
            f"There is no judge {name!r}: {error}.", advice="Use --judge builtin, none, or package.module:name."
        ) from error
    return make()


def ranked(scores: Mapping[str, float], noun: str) -> dict[str, Any]:
    """Return rank (1 is best; ties count against it), hit and probability of a noun by log likelihoods."""
    best = max(scores.values())
    weights = {name: math.exp(score - best) for name, score in scores.items()}
    rank = sum(score >= scores[noun] for score in scores.values())
    return {
        "rank": rank,
        "hit": rank == 1,
        "probability": weights[noun] / sum(weights.values()),
        "retrieved": max(scores, key=lambda name: scores[name]),
    }


def judgement(judge: ShapeJudge, mesh: TriangleMesh, prompts: Sequence[str], prompt: str) -> dict[str, Any]:
    """Judge one result.

    Returns
    -------
    dict
        `rank`, `hit`, `probability` and `retrieved` of the prompt among all `prompts`; `noun_rank`, `noun_hit` and
        `noun_probability` of its noun among all nouns of the judge; `log_likelihoods` by prompt.

    Raises
    ------
    PromptError, VocabularyError
        The judge does not understand a prompt.
    """
    scores = dict(zip(prompts, judge.log_likelihoods(mesh, prompts).tolist(), strict=True))
    nouns, noun = judge.noun_probabilities(mesh), parse(prompt).noun
    rank = sum(share >= nouns[noun] for share in nouns.values())
    return {
        **ranked(scores, prompt),
        "noun_rank": rank,
        "noun_hit": rank == 1,
        "noun_probability": nouns[noun],
        "log_likelihoods": scores,
    }
