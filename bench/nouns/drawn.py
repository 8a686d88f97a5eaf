"""Draw forty of the nouns that came after the first 149, to be made from a sphere and from a real asset each.

    python -m bench.nouns.drawn          the nouns, as `SEED` draws them

The seed was committed before any of them was run.
"""

from __future__ import annotations

import random

from meshdeform.priors.builtin.vocabulary import NOUNS as FIRST
from meshdeform.vocabulary.nouns import NOUNS

SEED, COUNT = 65, 40


def drawn() -> list[str]:
    """Return the nouns that the seed draws, by the alphabet."""
    return sorted(random.Random(SEED).sample(sorted(set(NOUNS) - set(FIRST)), COUNT))


if __name__ == "__main__":
    print(*drawn())
