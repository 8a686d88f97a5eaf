"""Words of people's own: a noun, its synonyms, and the shapes that it stands for, in a file of one word.

`file` reads and writes a word, `names` says which nouns can be one, `store` keeps the words of a user in a folder, and
`in_use` lets prompts, readings and fits know some words for as long as a block lasts. No torch; numpy only where shapes
are read.
"""

from meshdeform.words.file import ShapeSource, Word, WordShape, joined, read_words, write_word
from meshdeform.words.in_use import in_use, like_of, own_word, parts_to_set, words_in_use
from meshdeform.words.limits import MAX_FACES, MAX_SHAPES, MAX_WORD_BYTES, MAX_WORDS
from meshdeform.words.names import check_names, read_like, read_name
from meshdeform.words.offer import WordOffer
from meshdeform.words.store import WordFolder

__all__ = [
    "MAX_FACES",
    "MAX_SHAPES",
    "MAX_WORDS",
    "MAX_WORD_BYTES",
    "ShapeSource",
    "Word",
    "WordFolder",
    "WordOffer",
    "WordShape",
    "check_names",
    "in_use",
    "joined",
    "like_of",
    "own_word",
    "parts_to_set",
    "read_like",
    "read_name",
    "read_words",
    "words_in_use",
    "write_word",
]
