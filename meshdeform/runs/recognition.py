"""Find what a source is: as the judge takes it, or as it was read.

The judge's nouns are those of the builtin prior. With the joints of a person, an asset is one.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from meshdeform.deformation.orientation import Front, Mixture
from meshdeform.errors import ModelError, PromptError, VocabularyError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge import Judge
from meshdeform.priors.base import Prior
from meshdeform.priors.builtin.grammar import parse
from meshdeform.priors.builtin.vocabulary import NOUN_GROUPS, TURNED
from meshdeform.reading import Reading
from meshdeform.requests.choices import OrientationMode, is_builtin
from meshdeform.requests.document import ResolvedParams
from meshdeform.runs.goals import score_distillation

_log = logging.getLogger(__name__)
_SURE, _SURE_READ, _CALLED = 0.97, 0.9, 0.5
"""Probability from which a source counts as recognised by the judge alone and by its reading, and from which it does if
the prompt calls it the same: as of 19 of 20 real assets it is right (`bench.recognition`)."""

_LIKELY, _CERTAIN, _MOST = 0.5, 0.8, 3
"""Probabilities from which a source's noun says how it is treated, and from which it alone says where the front is;
number of nouns that say it otherwise."""

CROOKED = frozenset({"twisted", "leaning", "bent"})
"""Words of prompts that cost symmetry and flatness."""

_LIMBS = ("head", "arm(?!at)|hand(?!le)", "leg|thigh|foot")
_OF_ANIMALS = "tail|wing|front|paw|hoof"
"""In the names of joints: of a person, and of nobody."""

_BUILT = ("vehicles", "furniture", "buildings", "vessels and tools")


@dataclass(frozen=True)
class Recognition:
    """Noun that a source was taken for."""

    noun: str  # the most probable noun; empty if there is no judge
    probability: float  # 1 for a noun that the request gives
    nouns: Mapping[str, float] = field(default_factory=dict)
    """The probabilities of all nouns; empty if no judge was asked."""
    called: str = ""  # what the prompt says that it is
    read: bool = False  # whether the reading decided, not the judge alone

    @property
    def sure(self) -> bool:
        """Whether the source counts as recognised."""
        by_itself = _SURE_READ if self.read else _SURE
        return self.probability >= (_CALLED if self.called == self.noun else by_itself)

    def with_reading(self, reading: Reading | None) -> Recognition:
        """Return what a reading took the source for, which is right more often than the judge alone.

        It has the judge's probabilities of all nouns.
        """
        if reading is None:
            return self
        return replace(self, noun=reading.noun, probability=reading.probability, read=True)

    @property
    def likely_noun(self) -> str:
        """The noun if it is likely, else an empty text."""
        return self.noun if self.probability >= _LIKELY else ""

    @property
    def certain(self) -> bool:
        """Whether nothing else is likely."""
        return self.probability >= _CERTAIN

    @property
    def built(self) -> bool:
        """Whether it is likely to be something that people build, which stands upright."""
        return any(self.likely_noun in NOUN_GROUPS[group] for group in _BUILT)

    def likely(self) -> dict[str, float]:
        """Return the nouns that it most likely is, with their weights; none if too little is known."""
        if self.certain:
            return {self.noun: 1.0}
        first = dict(sorted(self.nouns.items(), key=lambda item: -item[1])[:_MOST])
        total = sum(first.values())
        return {noun: probability / total for noun, probability in first.items()} if total >= _LIKELY else {}

    def to_dict(self) -> dict[str, Any]:
        """Return the member `source_noun` of the report."""
        return {"noun": self.noun, "probability": round(self.probability, 4), "recognised": self.sure}


def recognise(mesh: TriangleMesh, noun_given: str | None = None, joints: Iterable[str] = ()) -> Recognition:
    """Return the noun that a mesh, +Y up, is taken for, or the one that is given for it.

    With the joints of a person it is one, unless it clearly is another figure: to the judge, whoever holds out both
    arms looks like a helicopter.
    """
    if noun_given is not None:
        return Recognition(noun_given, 1.0)
    try:
        nouns = Judge().noun_probabilities(mesh)
    except ModelError as error:
        _log.warning("the source is not recognised: %s", error)
        return Recognition("", 0.0)
    noun = max(nouns, key=nouns.__getitem__)
    recognition = Recognition(noun, nouns[noun], nouns)
    figure = recognition.likely_noun in NOUN_GROUPS["figures"]
    return Recognition("person", 1.0, nouns) if _is_person(joints) and not figure else recognition


def _is_person(joints: Iterable[str]) -> bool:
    names = " ".join(joints).lower()
    return all(re.search(part, names) for part in _LIMBS) and not re.search(_OF_ANIMALS, names)


def known_source(
    mesh: TriangleMesh,
    prior: Prior | None,
    params: ResolvedParams,
    known: Recognition | None = None,
    joints: Iterable[str] = (),
) -> Recognition | None:
    """Return the noun of a run's source, `known` if it was asked; None where nothing depends on it."""
    if prior is None or not is_builtin(params.model) or params.orientation is not OrientationMode.AUTO:
        return None
    return known or recognise(mesh, params.source_noun, joints)


def front_of(source: Recognition | None, prior: Prior | None, params: ResolvedParams, prompt: str) -> Front | None:
    """Return who finds the front of a source: the prior, asked for what the source is."""
    if source is None or prior is None:
        return None
    likely = [(score_distillation(prior, f"a {noun}", params), weight) for noun, weight in source.likely().items()]
    grader = Mixture(likely) if likely else None
    try:
        reading = parse(prompt)
    except (PromptError, VocabularyError):  # there is none, or it has taught words
        return Front(grader, source.built)
    grown = not any(reading.noun in NOUN_GROUPS[group] for group in _BUILT)
    crooked = any(attribute.degree in CROOKED for attribute in reading.attributes)
    return Front(grader, source.built, grown, crooked, reading.noun in TURNED)
