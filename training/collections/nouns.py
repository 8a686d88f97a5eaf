"""Name the noun that a file of a collection shows, from the words of its name.

A name is cut into words ("Table_RoundLarge" is "table round large"), words about size, colour and state are dropped,
and what remains must be one of a noun's phrases in `nouns.txt`. Tiles, terrain and parts of kits ("wall corner gate")
have no phrase.
"""

from __future__ import annotations

import re
from pathlib import Path


def _table() -> dict[str, list[str]]:
    """Return the phrases of each noun, and of `variants` the words that are dropped."""
    text = (Path(__file__).parent / "nouns.txt").read_text(encoding="utf-8")
    joined = re.sub(r"\n +", " ", re.sub(r"(?m)^#.*\n", "", text))
    rows = (line.partition(": ") for line in joined.splitlines())
    return {noun: [phrase.strip() for phrase in phrases.split(";")] for noun, _, phrases in rows}


_PHRASES = _table()
_VARIANTS = frozenset(_PHRASES.pop("variants"))
NAMED = frozenset(_PHRASES)
"""The nouns that names tell."""
_NOUN_OF = {phrase: noun for noun, phrases in _PHRASES.items() for phrase in phrases}


def words_of(name: str) -> list[str]:
    """Cut the name of a file, without its ending, into lower-case words of two letters or more; drop variants."""
    spaced = re.sub(r"([a-z])([A-Z0-9])", r"\1 \2", name)
    spaced = re.sub(r"([A-Z])([A-Z][a-z])", r"\1 \2", spaced)
    spaced = re.sub(r"([0-9])([A-Za-z])", r"\1 \2", spaced)
    return [word for word in re.split(r"[^a-z]+", spaced.lower()) if len(word) > 1 and word not in _VARIANTS]


def noun_of(name: str) -> str | None:
    """Return the noun that a file of this name shows, or None."""
    return _NOUN_OF.get(" ".join(words_of(name)))
