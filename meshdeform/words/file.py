"""Read and write a word: `NAME.word`, a safetensors file of arrays and one line of JSON, which nothing executes.

======================= ========== ====== ==========================================================
tensor                  shape      type   content
======================= ========== ====== ==========================================================
`counts`                (M, 2)     U16    vertices and faces of each shape
`faces`                 (F, 3)     U16    of all shapes one after the other, each counted from its own 0
`labels`                (F,)       U8     part of each face: its index in `parts`, or 255
`verts`                 (V, 3)     F32    +Y up, front +Z, the box about the origin with a diagonal of 1
======================= ========== ====== ==========================================================

The metadata has `format`, and as JSON the `word`: `noun`, `synonyms`, `like` (the noun as whose parts its were read,
or empty), the names of the `parts`, and of each of the `shapes` the name of its `source`, that file's `sha256` and
`licence`. Equal words have equal bytes: tensors and members are in the order of the alphabet, and what is written
otherwise is no word. Its SHA-256 is its identity.
"""

from __future__ import annotations

import hashlib
import json
import re
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from meshdeform.errors import AssetError, AssetFormatError, AssetTooLargeError, readable_size
from meshdeform.words.limits import (
    MAX_FACES,
    MAX_HEADER_BYTES,
    MAX_NAME,
    MAX_PARTS,
    MAX_SHAPES,
    MAX_SYNONYMS,
    MAX_TEXT,
    MAX_WORD_BYTES,
    MAX_WORDS,
    MAX_WORDS_BYTES,
    MIN_FACES,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["NAME", "PART", "SUFFIX", "ShapeSource", "Word", "WordShape", "joined", "read_words", "write_word"]

SUFFIX = ".word"
NAME = re.compile(r"[a-z]+(-[a-z]+)*")
"""A noun or a synonym: small letters, words joined by hyphens."""
PART = re.compile(r"[a-z]+([ -][a-z]+)*")
"""The name of a part."""
_FORMAT, _ANY_VERSION = "meshdeform-word-1", "meshdeform-word-"
_SHA256 = re.compile(r"[0-9a-f]{64}")
_AGAIN = "Export the word again, or make it anew: meshdeform words add."
_MEMBERS = {"noun", "synonyms", "like", "parts", "shapes"}
_TYPES = {"counts": "U16", "faces": "U16", "labels": "U8", "verts": "F32"}
_SIZES = {"U16": 2, "U8": 1, "F32": 4}


@dataclass(frozen=True)
class ShapeSource:
    """Where a shape of a word comes from: the name and the SHA-256 of its file, and its licence if that is known."""

    source: str
    sha256: str = ""
    licence: str = ""


@dataclass(frozen=True)
class WordShape:
    """A shape of a word.

    `verts` (V, 3) float64: +Y up, the front toward +Z, the box about the origin with a diagonal of 1. `faces` (F, 3)
    int64. `labels` (F,) int64: the part of each face, an index in the word's `parts`, or -1.
    """

    verts: NDArray[np.float64]
    faces: NDArray[np.int64]
    labels: NDArray[np.int64]


@dataclass(frozen=True)
class Word:
    """A word of somebody's own, by its file.

    `noun` and `synonyms`: in small letters, several words joined by hyphens; `parts`: the names of the parts of its
    shapes; `like`: the noun of ours that it is like, or empty; `sources` and `faces`: of each shape, where it comes
    from and how many it has. `Word.read` makes it and checks all but the numbers in the arrays, as `shapes` does.
    """

    noun: str
    synonyms: tuple[str, ...]
    like: str
    parts: tuple[str, ...]
    sources: tuple[ShapeSource, ...]
    faces: tuple[int, ...]
    data: bytes = field(repr=False)

    @cached_property
    def sha256(self) -> str:
        """Its identity: the SHA-256 of its bytes, in hexadecimal."""
        return hashlib.sha256(self.data).hexdigest()

    @classmethod
    def read(cls, data: bytes) -> Word:
        """Return the word of a file's bytes; without numpy.

        Raises
        ------
        AssetTooLargeError
            It has more bytes than a word may have.
        AssetFormatError
            The bytes are no word, or of another version.
        AssetError
            They are damaged: sizes, names or the order are not those of a word.
        """
        if len(data) > MAX_WORD_BYTES:
            raise AssetTooLargeError(
                f"The word has more than {readable_size(MAX_WORD_BYTES)}.", advice="Make it of fewer meshes."
            )
        header = _header(data)
        try:
            return _word_of(header.pop("__metadata__"), header, data)
        except (KeyError, ValueError, TypeError, AttributeError, IndexError, RecursionError) as error:
            raise AssetError(f"The word is damaged: {str(error)[:120]}.", advice=_AGAIN) from error

    @property
    def told(self) -> dict[str, Any]:
        """What it is besides its arrays, as JSON has it."""
        return {
            "noun": self.noun,
            "synonyms": list(self.synonyms),
            "like": self.like,
            "parts": list(self.parts),
            "shapes": [vars(source) for source in self.sources],
        }

    @cached_property
    def shapes(self) -> tuple[WordShape, ...]:
        """Its shapes, checked.

        Raises AssetError: a number is not finite or out of range.
        """
        from meshdeform.words.arrays import unpacked

        try:
            return unpacked(self.data[_start(self.data) :], len(self.sources), len(self.parts))
        except ValueError as error:
            raise AssetError(f"The word is damaged: {error}.", advice=_AGAIN) from error

    def checked(self) -> Word:
        """Return the word after its arrays were checked, too."""
        assert self.shapes
        return self


def write_word(
    noun: str,
    shapes: Sequence[WordShape],
    sources: Sequence[ShapeSource],
    *,
    parts: Sequence[str] = (),
    synonyms: Sequence[str] = (),
    like: str = "",
) -> Word:
    """Return a word of shapes, of which `sources` tells where they come from; equal words have equal bytes.

    Raises
    ------
    AssetError
        What is given makes no word: too many shapes, faces or names, or numbers that are not finite.
    """
    from meshdeform.words.arrays import packed

    order = sorted(range(len(parts)), key=lambda number: parts[number])
    tensors = packed(shapes, order)
    told = {
        "noun": noun,
        "synonyms": sorted(set(synonyms)),
        "like": like,
        "parts": [parts[number] for number in order],
        "shapes": [vars(source) for source in sources],
    }
    head = _packed_header(told, {name: list(array.shape) for name, array in tensors.items()})
    return Word.read(head + b"".join(array.tobytes() for array in tensors.values())).checked()


def _start(data: bytes) -> int:
    """Return where the arrays of a file begin."""
    return 8 + int.from_bytes(data[:8], "little")


def _header(data: bytes) -> dict[str, Any]:
    """Return the header of a file of words of this version."""
    try:
        if len(data) < 8 or _start(data) > min(len(data), MAX_HEADER_BYTES):
            raise IndexError
        header = json.loads(data[8 : _start(data)])
        version = str(header["__metadata__"]["format"])
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        version = ""
    if not version.startswith(_ANY_VERSION):
        raise AssetFormatError("The file is no word.", advice="Use a file that `meshdeform words export` wrote.")
    if version != _FORMAT:
        detail = f"The word has the format {version[:40]!r}; this version reads {_FORMAT!r}."
        raise AssetFormatError(detail, advice="Use the version of Meshdeform that wrote it, or a newer one.")
    return dict(header)


def _word_of(metadata: Mapping[str, str], header: Mapping[str, Any], data: bytes) -> Word:
    """Return a word by what its header says, which is checked against the limits and the number of bytes."""
    told = json.loads(metadata["word"])
    _check_names(told)
    sources = tuple(ShapeSource(**each) for each in told["shapes"])
    _check_sources(sources)
    if sorted(header) != sorted(_TYPES) or header["counts"]["shape"] != [len(sources), 2]:
        raise ValueError("its arrays are not those of a word")
    shapes = {name: header[name]["shape"] for name in _TYPES}
    end = _start(data) + sum(_SIZES[_TYPES[name]] * _product(shape) for name, shape in shapes.items())
    if len(data) != end:
        raise ValueError("bytes are missing, or there are too many")
    faces = _check_counts(data, len(sources), shapes)
    if data[: _start(data)] != _packed_header(told, shapes):
        raise ValueError("it is not written as words are")
    return Word(told["noun"], tuple(told["synonyms"]), told["like"], tuple(told["parts"]), sources, faces, data)


def _check_names(told: Mapping[str, Any]) -> None:
    """Refuse nouns and parts whose names are none, too many, or not in order, and members that no word has."""
    if told.keys() != _MEMBERS:
        raise ValueError("it tells more or less than words do")
    names = [told["noun"], *told["synonyms"], *([told["like"]] if told["like"] else [])]
    if not all(NAME.fullmatch(name) and len(name) <= MAX_NAME for name in names):
        raise ValueError("a name is no noun")
    if not all(PART.fullmatch(part) and len(part) <= MAX_NAME for part in told["parts"]):
        raise ValueError("a part has no proper name")
    if len(told["synonyms"]) > MAX_SYNONYMS or len(told["parts"]) > MAX_PARTS:
        raise ValueError("it has too many names")
    if any(told[name] != sorted(set(told[name])) for name in ("synonyms", "parts")):
        raise ValueError("its names are not in order")


def _check_sources(sources: Sequence[ShapeSource]) -> None:
    """Refuse too many shapes, and texts that are too long."""
    if not 1 <= len(sources) <= MAX_SHAPES:
        raise ValueError(f"it has {len(sources)} shapes, and a word has 1 to {MAX_SHAPES}")
    for each in sources:
        texts = (each.source, each.sha256, each.licence)
        if not all(isinstance(text, str) and len(text) <= MAX_TEXT for text in texts):
            raise ValueError("where a shape comes from is not told properly")
        if each.sha256 and not _SHA256.fullmatch(each.sha256):
            raise ValueError("the digest of a source is none")


def _check_counts(data: bytes, count: int, shapes: Mapping[str, Sequence[int]]) -> tuple[int, ...]:
    """Return the faces of each shape, by the numbers at the head of the arrays, which are to fit their lengths."""
    counts = struct.unpack_from(f"<{2 * count}H", data, _start(data))
    verts, faces = counts[::2], counts[1::2]
    rows = {"counts": count, "faces": sum(faces), "labels": sum(faces), "verts": sum(verts)}
    columns = {"counts": [2], "faces": [3], "labels": [], "verts": [3]}
    if any(shapes[name] != [rows[name], *columns[name]] for name in _TYPES):
        raise ValueError("its arrays have other lengths than its shapes")
    if not all(MIN_FACES <= each <= MAX_FACES for each in faces) or min(verts) < 3:
        raise ValueError(f"a shape has fewer than {MIN_FACES} or more than {MAX_FACES:,} faces")
    return faces


def _product(shape: Sequence[int]) -> int:
    product = 1
    for length in shape:
        if not isinstance(length, int) or not 0 <= length <= 2**31:
            raise ValueError("an array has no proper size")
        product *= length
    return product


def _packed_header(told: Mapping[str, Any], shapes: Mapping[str, Sequence[int]]) -> bytes:
    """Return the first bytes of a file, up to its arrays: the same for the same content."""
    header: dict[str, Any] = {"__metadata__": {"format": _FORMAT, "word": _compact(told)}}
    end = 0
    for name in sorted(_TYPES):
        begin, kind = end, _TYPES[name]
        end += _SIZES[kind] * _product(shapes[name])
        header[name] = {"dtype": kind, "shape": list(shapes[name]), "data_offsets": [begin, end]}
    text = _compact(header).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text


def _compact(value: Mapping[str, Any]) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def joined(words: Iterable[Word]) -> bytes:
    """Return several words in the bytes of one file, by the alphabet, as `read_words` reads them."""
    return b"".join(word.data for word in sorted(words, key=lambda word: word.noun))


def read_words(data: bytes) -> list[Word]:
    """Return the words of a file, which has at least one; without numpy, as `Word.read` does.

    Raises AssetError, as `Word.read` does; or two words have the same noun, or there are too many.
    """
    if len(data) > MAX_WORDS_BYTES:
        raise AssetTooLargeError(f"The file has more than {readable_size(MAX_WORDS_BYTES)}.", advice="Divide it.")
    words = list[Word]()
    while data or not words:
        if len(words) == MAX_WORDS:  # before all that follows is read
            raise AssetTooLargeError(f"The file has more than {MAX_WORDS} words.", advice="Divide it.")
        header = _header(data)
        try:
            end = _start(data) + max(int(header[name]["data_offsets"][1]) for name in _TYPES)
        except (KeyError, ValueError, TypeError, IndexError) as error:
            raise AssetError("The word is damaged: its arrays have no places.", advice=_AGAIN) from error
        words.append(Word.read(data[:end]))
        data = data[end:]
    nouns = [word.noun for word in words]
    if nouns != sorted(set(nouns)):
        raise AssetError("The words of the file are not in order, or one is there twice.", advice=_AGAIN)
    return words
