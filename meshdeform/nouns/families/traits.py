"""Turn attributes into sizes of parts; `deformed` deforms whole shapes.

Labels are true by construction. The size of a part is drawn from one of three disjoint ranges (lesser, neutral,
greater), chosen by the label.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from meshdeform.priors.builtin.grammar import Attribute
from meshdeform.vocabulary.nouns import PARTS

Range = tuple[float, float]
Rng = np.random.Generator


class Traits:
    """Attributes of one member of a family; `asked`: the parts whose size has been drawn."""

    def __init__(self, attributes: Iterable[Attribute] = ()) -> None:
        self._degrees = {attribute.part: attribute.degree for attribute in attributes if attribute.part != "whole"}
        self.asked: set[str] = set()

    def draw(self, rng: Rng, part: str, lesser: Range, neutral: Range, greater: Range) -> float:
        """Draw the size of a part uniformly from the range that the attributes specify.

        Parameters
        ----------
        rng : numpy.random.Generator
            Source of one random number.
        part : str
            A name in `grammar.PARTS`.
        lesser, neutral, greater : (low, high)
            Disjoint ranges in the family's unit.
        """
        self.asked.add(part)
        degree = self._degrees.get(part)
        if degree is None:
            return float(rng.uniform(*neutral))
        return float(rng.uniform(*(lesser if degree == PARTS[part][0] else greater)))
