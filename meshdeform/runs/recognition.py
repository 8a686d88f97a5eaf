"""Say what a source was taken for, by its reading or as the request has it, and what follows from it for a prompt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

from meshdeform.deformation.structure import UNKNOWN, Nature
from meshdeform.errors import PromptError, VocabularyError
from meshdeform.reading import Reading
from meshdeform.reading.result import SURE
from meshdeform.requests.document import ResolvedParams
from meshdeform.runs.front import asks_source
from meshdeform.runs.kept_readings import given_noun
from meshdeform.vocabulary.grammar import parse
from meshdeform.vocabulary.nouns import NOUN_GROUPS, ROUND

_LIKELY = 0.5
"""Probability from which a source's noun says how it is treated."""

CROOKED = frozenset({"twisted", "leaning", "bent"})
"""Words of prompts that cost symmetry and flatness."""

_BUILT = ("vehicles", "furniture", "buildings", "vessels and tools")


@dataclass(frozen=True)
class Recognition:
    """Noun that a source was taken for."""

    noun: str = ""  # empty if it could not be read
    probability: float = 0.0  # 1 for a noun that the request gives

    @classmethod
    def of(cls, params: ResolvedParams, reading: Reading | None) -> Self:
        """Return the noun that a request gives, which need not be a builtin one, or else that of a reading."""
        if params.source_noun is not None:
            return cls(given_noun(params) or params.source_noun, 1.0)
        return cls() if reading is None else cls(reading.noun, reading.probability)

    @property
    def sure(self) -> bool:
        """Whether the source counts as recognised."""
        return self.probability >= SURE

    @property
    def likely(self) -> bool:
        """Whether it is more likely that than anything else."""
        return self.probability >= _LIKELY

    @property
    def built(self) -> bool:
        """Whether it is likely to be something that people build, which stands upright."""
        return self.likely and any(self.noun in NOUN_GROUPS[group] for group in _BUILT)

    def to_dict(self) -> dict[str, Any]:
        """Return the member `source_noun` of the report."""
        return {"noun": self.noun, "probability": round(self.probability, 4), "recognised": self.sure}


def nature_of(params: ResolvedParams, reading: Reading | None, prompt: str) -> Nature:
    """Return what is known of a source with this reading, and of what a prompt makes of it."""
    if not asks_source(params):
        return UNKNOWN
    source = Recognition.of(params, reading)
    try:
        wish = parse(prompt)
    except (PromptError, VocabularyError):  # there is none, or it is free text
        return Nature(source.built)
    grown = not any(wish.noun in NOUN_GROUPS[group] for group in _BUILT)
    crooked = any(attribute.degree in CROOKED for attribute in wish.attributes)
    return Nature(source.built, grown, crooked, wish.noun in ROUND)
