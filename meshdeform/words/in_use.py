"""Let prompts, readings and fits know words of somebody's own, for as long as a block lasts.

What is known belongs to the thread or the task that entered the block (`contextvars`), so that two owners at once do
not share any.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from types import MappingProxyType

from meshdeform.vocabulary.lookup import using_words
from meshdeform.vocabulary.nouns import NOUNS, PARTS
from meshdeform.vocabulary.solids import part_label
from meshdeform.words.file import Word
from meshdeform.words.names import vocabulary

__all__ = ["in_use", "like_of", "own_word", "parts_to_set", "words_in_use"]

_words: ContextVar[Mapping[str, Word]] = ContextVar("words", default=MappingProxyType({}))


@contextmanager
def in_use(words: Iterable[Word]) -> Iterator[None]:
    """Let everything within the block know these words, in place of those of a block around it."""
    own = {word.noun: word for word in words}
    parts = {noun: parts_to_set(word) for noun, word in own.items()}
    token = _words.set(own)
    try:
        with using_words(vocabulary(own.values(), parts)):
            yield
    finally:
        _words.reset(token)


def parts_to_set(word: Word) -> tuple[str, ...]:
    """Return the parts of a word whose size a prompt can set."""
    return tuple(part for part in PARTS if part_label(part) in word.parts)


def words_in_use() -> tuple[Word, ...]:
    """Return the words that are known here, by the alphabet."""
    return tuple(sorted(_words.get().values(), key=lambda word: word.noun))


def own_word(noun: str) -> Word | None:
    """Return the word of a noun that is known here; None if the noun is ours."""
    return _words.get().get(noun)


def like_of(noun: str) -> str:
    """Return the noun of ours that a noun is like; a noun of ours itself, and one that is like none, as it is."""
    word = own_word(noun)
    return word.like if word is not None and word.like in NOUNS else noun
