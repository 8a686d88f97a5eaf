"""Translate prompts of the builtin prior from German and Spanish, word by word. Torch-free.

`translations.txt` has the words without their endings.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

_TABLE = Path(__file__).parent / "translations.txt"
_ENDINGS = (
    ("", "e", "n", "s", "en", "er", "es", "em", "ern"),
    ("", "s", "es"),
)
"""Endings of inflected words, by language: German, Spanish."""
_SPANISH = 1


@lru_cache(maxsize=1)
def _languages() -> tuple[dict[str, str], ...]:
    """Return the English word of each word, by language."""
    found: tuple[dict[str, str], ...] = ({}, {})
    for line in _TABLE.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            english, *others = line.split("|")
            for language, words in zip(found, others, strict=True):
                for word in words.split():
                    language.setdefault(word, english.strip())
    for language in found:  # accents tell "Höcker" from "Hocker" where they are written
        for word in list(language):
            language.setdefault(_plain(word), language[word])
    return found


def _plain(word: str) -> str:
    """Return a word without accents, as many people type it."""
    letters = unicodedata.normalize("NFKD", word.replace("ß", "ss"))
    return "".join(letter for letter in letters if not unicodedata.combining(letter))


def _in_english(word: str, language: int) -> str | None:
    table = _languages()[language]
    stems = [
        form.removesuffix(ending)
        for form in (word, _plain(word))
        for ending in _ENDINGS[language]
        if form.endswith(ending)
    ]
    if language == _SPANISH:  # alto, alta
        stems += [stem[:-1] + "o" for stem in stems if stem.endswith("a")]
    return next((table[stem] for stem in stems if stem in table), None)


def translated(words: Sequence[str], is_kept: Callable[[str], bool], is_adjective: Callable[[str], bool]) -> list[str]:
    """Return the words of a prompt in English, or as they are if no language understands all of them.

    `words`: in lower case. `is_kept` and `is_adjective`: whether an English word may stand in another language's
    sentence, such as a name; whether it is an adjective, which Spanish puts after its noun.
    """
    for language in range(len(_ENDINGS)):
        found = [_in_english(word, language) or (word if is_kept(word) else "") for word in words]
        if all(found):
            return _before_nouns(found, is_adjective) if language == _SPANISH else found
    return list(words)


def _before_nouns(words: Sequence[str], is_adjective: Callable[[str], bool]) -> list[str]:
    """Put adjectives that follow a noun before it: "perro gordo con cola larga"."""
    ordered: list[str] = []
    place = 0
    for word in words:
        if is_adjective(word):
            ordered.insert(place, word)
            place += 1
        else:
            place = len(ordered) if word not in ("and", "a") else place
            ordered.append(word)
    return ordered
