"""Find what a source is, as the judge takes it or as it was read, and what follows from it for a prompt.

The judge's nouns are those of the builtin prior. With the joints of a person, an asset is one.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from meshdeform.deformation.controls import UNKNOWN, Nature
from meshdeform.deformation.orientation import AHEAD, Orientation, OrientationSource
from meshdeform.errors import ModelError, PromptError, VocabularyError
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge import Judge
from meshdeform.priors.builtin.grammar import parse
from meshdeform.priors.builtin.vocabulary import NOUN_GROUPS, TURNED
from meshdeform.reading import Reading
from meshdeform.requests.choices import GuidanceKind, OrientationMode, is_builtin
from meshdeform.requests.document import ResolvedParams

_log = logging.getLogger(__name__)
_SURE, _SURE_READ, _CALLED = 0.97, 0.9, 0.5
"""Probability from which a source counts as recognised by the judge alone and by its reading, and from which it does if
the prompt calls it the same: as of 19 of 20 real assets it is right (`bench.recognition`)."""

_LIKELY, _CERTAIN = 0.5, 0.8
"""Probabilities from which a source's noun says how it is treated, and from which nothing else is likely."""

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


def asks_source(params: ResolvedParams) -> bool:
    """Return whether anything depends on what the source is: the front, of a model that sees the azimuth."""
    of_prompt = params.guidance is GuidanceKind.SDS and is_builtin(params.model)
    return of_prompt and params.orientation is OrientationMode.AUTO


def front_of(reading: Reading | None, params: ResolvedParams) -> Orientation:
    """Return the front of a source for `params.guidance.orientation` = `auto`, by its reading if it has one."""
    if params.guidance is not GuidanceKind.SDS:
        return AHEAD
    if not is_builtin(params.model):
        return Orientation(source=OrientationSource.UNCONDITIONED)
    if reading is None:
        return Orientation(source=OrientationSource.UNRECOGNISED)
    source = OrientationSource.FOUND if reading.front_sure else OrientationSource.UNDECIDED
    return Orientation(reading.front_azimuth_deg, source)


def nature_of(source: Recognition | None, prompt: str) -> Nature:
    """Return what is known of a source and of what a prompt makes of it."""
    if source is None:
        return UNKNOWN
    try:
        wish = parse(prompt)
    except (PromptError, VocabularyError):  # there is none, or it has taught words
        return Nature(source.built)
    grown = not any(wish.noun in NOUN_GROUPS[group] for group in _BUILT)
    crooked = any(attribute.degree in CROOKED for attribute in wish.attributes)
    return Nature(source.built, grown, crooked, wish.noun in TURNED)
