"""Limits of words, all in one place."""

MAX_SHAPES = 200
"""Meshes of a word."""
MAX_FACES, MIN_FACES = 4_000, 4
"""Faces of a shape, as it is kept; what is sent may have more, and is reduced."""
MAX_WORD_BYTES = 16 * 2**20
"""Bytes of a word's file: 200 shapes of 4,000 faces take 11 MB."""
MAX_WORDS_BYTES = 64 * 2**20
"""Bytes of a file of several words."""
MAX_HEADER_BYTES = 256 * 2**10
MAX_WORDS = 200
"""Words of one owner."""
MAX_SYNONYMS = 16
MAX_PARTS = 64
"""Names of parts of a word."""
MAX_NAME = 40
"""Characters of a noun, a synonym, or the name of a part."""
MAX_TEXT = 200
"""Characters of the name of a source file, and of its licence."""
