"""Turn attributes into sizes of parts; `deformed` deforms whole shapes.

Labels are true by construction. The size of a part is drawn from one of three disjoint ranges (lesser, neutral,
greater), chosen by the label.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import PARTS

Range = tuple[float, float]
Rng = np.random.Generator


class Traits:
    """Attributes of one member of a family; `asked`: the parts whose size has been drawn.

    `sizes`: of some parts, a size in place of a draw: -1 the least that there is, 0 the middle, 1 the greatest.
    """

    def __init__(self, attributes: Iterable[Attribute] = (), sizes: Mapping[str, float] | None = None) -> None:
        self._degrees = {attribute.part: attribute.degree for attribute in attributes if attribute.part != "whole"}
        self._sizes = dict(sizes or {})
        self.asked: set[str] = set()

    def draw(self, rng: Rng, part: str, lesser: Range, neutral: Range, greater: Range) -> float:
        """Draw the size of a part uniformly from the range that the attributes specify.

        Parameters
        ----------
        rng : numpy.random.Generator
            Source of one random number.
        part : str
            A name in `vocabulary.nouns.PARTS`.
        lesser, neutral, greater : (low, high)
            Disjoint ranges in the family's unit.
        """
        self.asked.add(part)
        if part in self._sizes:
            rng.uniform()  # all that is drawn after it stays
            size, middle = self._sizes[part], sum(neutral) / 2
            return middle + abs(size) * ((lesser[0] if size < 0 else greater[1]) - middle)
        degree = self._degrees.get(part)
        if degree is None:
            return float(rng.uniform(*neutral))
        return float(rng.uniform(*(lesser if degree == PARTS[part][0] else greater)))
