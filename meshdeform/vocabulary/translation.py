"""Translate German and Spanish prompts word by word; `translations.txt` has the words without their endings.

Words that belong together have hyphens there: `oso-de-peluche`. A word may mean a noun and a part, such as `Schere`,
scissors and claws: it is the noun until the prompt has one. Pure Python.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

__all__ = ["LANGUAGES", "english_of", "translated"]

_TABLE = Path(__file__).parent / "translations.txt"
_ENDINGS = (
    ("", "e", "n", "s", "en", "er", "es", "em", "ern"),
    ("", "s", "es"),
)
"""Endings of inflected words, by language: German, Spanish."""
_SPANISH = 1
LANGUAGES = len(_ENDINGS)
"""Number of languages other than English."""
_LONGEST = 4
"""Words that one entry has at most."""
_WRITTEN_OUT = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})


@lru_cache(maxsize=2)
def _languages(path: Path) -> tuple[dict[str, tuple[str, ...]], ...]:
    """Return the English words of each word of a table, in the table's order, by language."""
    tables: tuple[dict[str, tuple[str, ...]], ...] = ({}, {})
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            english, *others = line.split("|")
            for language, words in zip(tables, others, strict=True):
                for word in words.split():
                    language[word] = (*language.get(word, ()), english.strip())
    for language in tables:  # accents tell "Höcker" from "Hocker" where they are written
        for word in list(language):
            for spelling in (_plain(word), word.translate(_WRITTEN_OUT)):
                language.setdefault(spelling, language[word])
    return tables


def _plain(word: str) -> str:
    """Return a word without accents, as many people type it."""
    letters = unicodedata.normalize("NFKD", word.replace("ß", "ss"))
    return "".join(letter for letter in letters if not unicodedata.combining(letter))


def _meanings(word: str, language: int, path: Path = _TABLE) -> tuple[str, ...]:
    """Return the English words of an inflected word of a language, by a table in a file; none if it lacks it."""
    table = _languages(path)[language]
    stems = [
        form.removesuffix(ending)
        for form in (word, _plain(word))
        for ending in _ENDINGS[language]
        if form.endswith(ending)
    ]
    if language == _SPANISH:  # alto, alta; cruz, cruces
        stems += [stem[:-1] + "o" for stem in stems if stem.endswith("a")]
        stems += [stem[:-1] + "z" for stem in stems if stem.endswith("c")]
    return next((table[stem] for stem in stems if stem in table), ())


def english_of(word: str, language: int, path: Path = _TABLE) -> str | None:
    """Return the English word of an inflected word of a language, by a table in a file; None if it lacks it.

    Of a noun and a part it is the part.
    """
    meanings = _meanings(word, language, path)
    return meanings[-1] if meanings else None


def translated(
    words: Sequence[str],
    is_english: Callable[[str], bool],
    is_kept: Callable[[str], bool],
    is_adjective: Callable[[str], bool],
    is_noun: Callable[[str], bool],
) -> list[str]:
    """Return the words of a prompt in English, or as they are if they are in no other language.

    They are in a language that understands all of them, or more than are English; then what it lacks stays.
    `words`: in lower case. `is_english`, `is_kept`, `is_adjective`, `is_noun`: whether a word is English at all; may
    stand in another language's sentence, such as a name; is an adjective, which Spanish puts after its noun; is a noun.
    """
    ours = sum(map(is_english, words))
    readings: list[tuple[int, int, list[str]]] = []
    for language in range(LANGUAGES):
        told = _joined(words, language)
        understood = sum(bool(_meanings(word, language)) for word in told)
        lacking = sum(not _meanings(word, language) and not is_kept(word) for word in told)
        if understood and (not lacking or understood > ours):
            english = _in_order(told, language, is_noun)
            readings.append((lacking, -understood, _adjectives_first(english, is_adjective) if language else english))
    return min(readings)[2] if readings else list(words)


def _in_order(told: Sequence[str], language: int, is_noun: Callable[[str], bool]) -> list[str]:
    """Return the English word of each word: of a noun and a part the noun, until there is one."""
    english: list[str] = []
    for word in told:
        meanings = _meanings(word, language) or (word,)
        english.append(meanings[-1 if any(map(is_noun, english)) else 0])
    return english


def _joined(words: Sequence[str], language: int) -> list[str]:
    """Return words with those joined by hyphens that are one entry, and others divided at their hyphens."""
    rest: list[str] = []
    for word in words:
        pieces = word.split("-")
        whole = _meanings(word, language) or not all(_meanings(piece, language) for piece in pieces)
        rest += [word] if whole else pieces
    joined: list[str] = []
    while rest:
        together = next((n for n in range(_LONGEST, 1, -1) if _meanings("-".join(rest[:n]), language)), 1)
        joined.append("-".join(rest[:together]))
        del rest[:together]
    return joined


def _adjectives_first(words: Sequence[str], is_adjective: Callable[[str], bool]) -> list[str]:
    """Put adjectives that follow a noun before it: "perro gordo con cola larga"."""
    ordered: list[str] = []
    index = 0
    for word in words:
        if is_adjective(word):
            ordered.insert(index, word)
            index += 1
        else:
            index = len(ordered) if word not in ("and", "a") else index
            ordered.append(word)
    return ordered
