"""Find the known nouns whose meaning is nearest to that of another word. Torch-free.

The meaning of a word is its place in a part of WordNet's hierarchy of nouns (`nouns.txt.gz`, made by
`release/nouns.py`; its licence is at its head). The nearest of two nouns is the one whose lowest common kind with the
word is the narrower, measured by the number of things of that kind: a mug and a goblet are drinking vessels, a mug and
a house only artefacts. Ties go to the shorter way in the tree.

Sources: Miller 1995, WordNet; Resnik 1995 (the common kind that says most); Seco et al. 2004, eq. 2 (a kind says the
more, the fewer things it has).
"""

from __future__ import annotations

import gzip
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

_TABLE = Path(__file__).parent / "nouns.txt.gz"
_WIDEST = 600
"""A common kind of more things than this says nothing: everything that was made is an artefact."""


@dataclass(frozen=True)
class _Tree:
    """Kinds by number: the parent of each (-1: none), how many things it has, and the kinds of each word."""

    parents: list[int] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)
    kinds: dict[str, list[tuple[int, int]]] = field(default_factory=lambda: defaultdict(list))

    def line(self, kind: int) -> list[int]:
        """Return a kind and all that it belongs to, narrowest first."""
        found = []
        while kind >= 0:
            found.append(kind)
            kind = self.parents[kind]
        return found


@lru_cache(maxsize=1)
def _tree() -> _Tree:
    tree = _Tree()
    above: list[int] = []
    for line in gzip.decompress(_TABLE.read_bytes()).decode().splitlines():
        if line.startswith("#"):
            continue
        depth, *words = line.split()
        del above[int(depth) :]
        for word in words:
            name, _, rank = word.partition(":")
            tree.kinds[name].append((len(tree.parents), int(rank or 1)))
        tree.parents.append(above[-1] if above else -1)
        above.append(len(tree.sizes))
        tree.sizes.append(1)
    for kind in range(len(tree.parents) - 1, -1, -1):  # children come after their parents
        if tree.parents[kind] >= 0:
            tree.sizes[tree.parents[kind]] += tree.sizes[kind]
    return tree


def is_noun(word: str) -> bool:
    """Return whether the hierarchy has a word."""
    return word in _tree().kinds


def nearest(word: str, nouns: Iterable[str], count: int = 3) -> list[str]:
    """Return the nouns whose meaning is nearest to that of a word, nearest first.

    Parameters
    ----------
    word : str
        In small letters, singular.
    nouns : iterable of str
        The nouns to choose from, singular; those without a place in the hierarchy are never chosen.
    count : int
        Maximum number of nouns.

    Returns
    -------
    list of str
        Empty if the word has no place in the hierarchy, or nothing in common with any noun.
    """
    tree = _tree()
    scores: dict[str, tuple[int, int]] = {}
    for start, rank in tree.kinds.get(word, []):
        steps = {kind: step for step, kind in enumerate(tree.line(start))}
        for noun in nouns:
            for kind, other_rank in tree.kinds.get(noun, []):
                way, common = next(
                    ((step, kind) for step, kind in enumerate(tree.line(kind)) if kind in steps), (0, -1)
                )
                if common >= 0 and tree.sizes[common] <= _WIDEST:
                    score = (tree.sizes[common] * rank * other_rank, way + steps[common])
                    scores[noun] = min(score, scores.get(noun, score))
    return sorted(scores, key=lambda noun: (*scores[noun], noun))[:count]
