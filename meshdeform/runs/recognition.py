"""Recognise what an asset is, by the nouns of the builtin prior."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from meshdeform.deformation.orientation import Front
from meshdeform.errors import ModelError, PromptError, VocabularyError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge import Judge
from meshdeform.priors.base import Prior
from meshdeform.priors.builtin.grammar import parse
from meshdeform.priors.builtin.vocabulary import NOUN_GROUPS
from meshdeform.requests.choices import OrientationMode
from meshdeform.requests.document import ResolvedParams
from meshdeform.requests.models import is_builtin
from meshdeform.runs.goals import score_distillation

__all__ = ["CROOKED", "Recognition", "front_of", "known_source", "recognise"]

_log = logging.getLogger(__name__)
_SURE = 0.5
CROOKED = frozenset({"twisted", "leaning", "bent"})
"""What a prompt may ask for that costs symmetry and flatness."""
_BUILT = ("vehicles", "furniture", "buildings", "vessels and tools")


@dataclass(frozen=True)
class Recognition:
    """What a source was taken for.

    Attributes
    ----------
    noun : str
        The most probable noun; empty if there is no judge.
    probability : float
        1 for a noun that the request gives.
    nouns : mapping of str to float
        The probabilities of all nouns; empty if no judge was asked.
    """

    noun: str
    probability: float
    nouns: Mapping[str, float] = field(default_factory=dict)

    @property
    def sure(self) -> bool:
        """Whether the source counts as recognised."""
        return self.probability >= _SURE

    @property
    def built(self) -> bool:
        """Whether it was recognised as something that people build, which stands upright."""
        return self.sure and any(self.noun in NOUN_GROUPS[group] for group in _BUILT)

    def to_dict(self) -> dict[str, Any]:
        """Return the member `source_noun` of the report."""
        return {"noun": self.noun, "probability": round(self.probability, 4), "recognised": self.sure}


def recognise(mesh: TriangleMesh, given: str | None = None) -> Recognition:
    """Return what a mesh, +Y up, is taken for, or the noun that is given for it."""
    if given is not None:
        return Recognition(given, 1.0)
    try:
        nouns = Judge().noun_probabilities(mesh)
    except ModelError as error:
        _log.warning("the source is not recognised: %s", error)
        return Recognition("", 0.0)
    noun = max(nouns, key=nouns.__getitem__)
    return Recognition(noun, nouns[noun], nouns)


def known_source(mesh: TriangleMesh, prior: Prior | None, params: ResolvedParams) -> Recognition | None:
    """Return what the source of a run is taken for; None where nothing depends on it."""
    if prior is None or not is_builtin(params.model) or params.orientation is not OrientationMode.AUTO:
        return None
    return recognise(mesh, params.source_noun)


def front_of(source: Recognition | None, prior: Prior | None, params: ResolvedParams, prompt: str) -> Front | None:
    """Return who finds the front of a source: the prior, asked for what the source is."""
    if source is None or prior is None:
        return None
    grader = score_distillation(prior, f"a {source.noun}", params) if source.sure else None
    try:
        asked = parse(prompt)
    except (PromptError, VocabularyError):  # there is none, or it has taught words
        return Front(grader, source.built)
    grown = not any(asked.noun in NOUN_GROUPS[group] for group in _BUILT)
    return Front(grader, source.built, grown, any(attribute.degree in CROOKED for attribute in asked.attributes))
