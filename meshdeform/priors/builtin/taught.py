"""Describe files of weights of the builtin prior with their own words, and check them. Torch-free.

A file is safetensors, never a pickle. Its metadata has, besides what `network.py` writes:

`words_format`
    "1". Files without it have the words of the package.
`words`
    The tokens in the order of their numbers, separated by spaces.
`nouns`
    JSON: `nouns` (parts by noun), `synonyms` and `lessons` (what was taught, in order).

`check` reads only the header: sizes, names and shapes, and the words; `check_numbers` the rest.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from meshdeform.errors import ModelError
from meshdeform.priors.builtin.grammar import ATTRIBUTES, BUILTIN_WORDS, Words
from meshdeform.priors.model_files import CONVERT
from meshdeform.requests.choices import is_taught
from meshdeform.vocabulary.nouns import PARTS

MAX_FILE_BYTES = 256 * 2**20
"""The shipped weights take 8 MiB, and a noun's pictures for replay 1.5 MiB."""
MAX_NOUNS = 200
_MAX_HEADER_BYTES = 4 * 2**20
_FORMAT = "1"
_WORD = re.compile(r"[a-z]+(-[a-z]+)*")
_LONGEST_WORD = 40
_ADVICE = "Use a file that `meshdeform teach` wrote, or teach it again."
_ROWS = "text.word.weight"
REPLAY = "replay."
"""Tensors whose name begins so are pictures, and no part of the network."""


@dataclass(frozen=True)
class Lesson:
    """The words that a file of weights was taught."""

    noun: str
    synonyms: tuple[str, ...]
    attributes: tuple[str, ...]  # attributes that meshes were labelled with
    meshes: tuple[str, ...]  # names of the files
    licence: str  # one line about the meshes' licence; may be empty
    date: str  # day of the lesson, as YYYY-MM-DD
    steps: int
    seed: int


def metadata_of(words: Words, lessons: Sequence[Lesson]) -> dict[str, str]:
    """Return the metadata that describes a file's words."""
    document = {
        "nouns": {noun: list(parts) for noun, parts in words.nouns.items()},
        "synonyms": dict(words.synonyms),
        "lessons": [asdict(lesson) for lesson in lessons],
    }
    return {"words_format": _FORMAT, "words": " ".join(words.tokens), "nouns": json.dumps(document)}


def words_of(metadata: Mapping[str, str], path: Path) -> Words:
    """Return the words of a file.

    Raises ModelError: the metadata is not of this format, or its parts contradict each other.
    """
    if "words_format" not in metadata:
        if metadata.get("words", "").split() != list(BUILTIN_WORDS.tokens):
            raise ModelError(f"The weights in {path} were trained for another vocabulary.", advice=_ADVICE)
        return BUILTIN_WORDS
    if metadata["words_format"] != _FORMAT:
        raise ModelError(
            f"The weights in {path} have words of the format {metadata['words_format'][:20]!r}; this version reads "
            f"{_FORMAT!r}.",
            advice="Use the version of Meshdeform that wrote them, or a newer one.",
        )
    document = _document(metadata, path)
    tokens = tuple(metadata.get("words", "").split())
    nouns = {str(noun): tuple(map(str, parts)) for noun, parts in document["nouns"].items()}
    synonyms = {str(word): str(noun) for word, noun in document["synonyms"].items()}
    own_parts = {part for parts in nouns.values() for part in parts}
    fixed = set(BUILTIN_WORDS.tokens) - set(BUILTIN_WORDS.nouns)
    # Weights of an older edition lack the parts that came later; their nouns do not have them.
    needed = (fixed - set(PARTS)) | own_parts | set(nouns)
    wrong = (
        not 0 < len(nouns) <= MAX_NOUNS
        or not needed <= set(tokens) <= fixed | set(nouns)
        or len(tokens) != len(set(tokens))
        or tokens[0] != BUILTIN_WORDS.tokens[0]
        or not all(_WORD.fullmatch(word) and len(word) <= _LONGEST_WORD for word in (*nouns, *synonyms))
        or not set(synonyms.values()) <= set(nouns)
        or not own_parts <= set(PARTS)
    )
    if wrong:
        raise ModelError(f"The words of the weights in {path} contradict each other.", advice=_ADVICE)
    return Words(nouns, synonyms, tokens)


def lessons_of(metadata: Mapping[str, str], path: Path) -> tuple[Lesson, ...]:
    """Return the lessons of a file, in order; none for the weights in the package.

    Raises ModelError: the metadata is not of this format.
    """
    if "words_format" not in metadata:
        return ()
    try:
        return tuple(_lesson(entry) for entry in _document(metadata, path)["lessons"])
    except (KeyError, TypeError, ValueError) as error:
        raise ModelError(f"The weights in {path} have an unreadable list of lessons.", advice=_ADVICE) from error


def _lesson(entry: Mapping[str, Any]) -> Lesson:
    texts = {name: str(entry[name])[:500] for name in ("noun", "licence", "date")}
    lists = {name: tuple(str(item)[:500] for item in entry[name]) for name in ("synonyms", "attributes", "meshes")}
    if not set(lists["attributes"]) <= set(map(str, ATTRIBUTES)):
        raise ValueError("unknown attributes")
    return Lesson(**texts, **lists, steps=int(entry["steps"]), seed=int(entry["seed"]))  # type: ignore[arg-type]


def _document(metadata: Mapping[str, str], path: Path) -> dict[str, Any]:
    try:
        document = json.loads(metadata.get("nouns", ""))
    except (ValueError, RecursionError):
        document = None
    kinds = {"nouns": dict, "synonyms": dict, "lessons": list}
    if not isinstance(document, dict) or not all(isinstance(document.get(key), kind) for key, kind in kinds.items()):
        raise ModelError(f"The weights in {path} have unreadable words.", advice=_ADVICE)
    if not all(isinstance(parts, list) for parts in document["nouns"].values()):
        raise ModelError(f"The weights in {path} have unreadable words.", advice=_ADVICE)
    return document


def read_metadata(path: Path) -> dict[str, str]:
    """Read a file's metadata from its header, and check its size against the header's.

    Raises ModelError: there is no file, it is too large, or it is not safetensors of this prior.
    """
    header = _header(path)
    rows = header.get(_ROWS)
    if not isinstance(rows, dict) or "stem.weight" not in header:
        raise ModelError(
            f"The file {path} has no weights of the builtin prior.",
            advice=f"Single files of other models are not read. {CONVERT}",
        )
    metadata = header.get("__metadata__") or {}
    return {str(key): str(value) for key, value in metadata.items()}


def check(path: Path) -> Words:
    """Check the header of a file, and return its words; see `read_metadata` and `words_of`."""
    metadata = read_metadata(path)
    words = words_of(metadata, path)
    shape = _header(path)[_ROWS].get("shape")
    if not isinstance(shape, list) or shape[:1] != [len(words.tokens)]:
        raise ModelError(f"The weights in {path} have {shape} for {len(words.tokens)} words.", advice=_ADVICE)
    return words


def check_numbers(path: Path) -> None:
    """Check that the tensors of a file that passed `check` are floats, and finite; reads all of it, with numpy.

    Raises ModelError: they are not, or the file is damaged.
    """
    import numpy as np
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(path, "np") as file:
            for name in file.keys():  # noqa: SIM118 - it is no mapping
                values = file.get_tensor(name)
                if not name.startswith(REPLAY) and values.dtype.kind != "f":
                    raise ModelError(
                        f"The tensor {name[:100]!r} in {path} is {values.dtype}, not float.", advice=_ADVICE
                    )
                if values.dtype.kind == "f" and not np.isfinite(values).all():
                    raise ModelError(f"The weights in {path} contain numbers that are not finite.", advice=_ADVICE)
    except (SafetensorError, TypeError, ValueError, KeyError, AttributeError) as error:
        raise ModelError(f"The file {path} is not safetensors: {str(error)[:200]}.", advice=_ADVICE) from error


def known_words(model: str) -> Words:
    """Return the words of `builtin`, or of a file that `meshdeform teach` wrote; see `check`."""
    return check(Path(model).expanduser()) if is_taught(model) else BUILTIN_WORDS


def _header(path: Path) -> dict[str, Any]:
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise ModelError(
                f"The file {path} has {size:,} bytes; weights of the builtin prior have at most {MAX_FILE_BYTES:,}.",
                advice=CONVERT,
            )
        with path.open("rb") as file:
            length = int.from_bytes(file.read(8), "little")
            header = json.loads(file.read(length)) if length <= min(size, _MAX_HEADER_BYTES) else {}
        ends = [int(entry["data_offsets"][1]) for name, entry in header.items() if name != "__metadata__"]
    except FileNotFoundError as error:
        raise ModelError(f"There is no file {path} on the machine that runs the worker.", advice=_ADVICE) from error
    except OSError as error:
        raise ModelError(f"The file {path} cannot be read: {error.strerror}.", advice=_ADVICE) from error
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, RecursionError) as error:
        raise ModelError(f"The file {path} is not safetensors: {error}.", advice=_ADVICE) from error
    if not ends or max(ends) != size - 8 - length or not isinstance(header.get("__metadata__") or {}, dict):
        raise ModelError(f"The file {path} is not safetensors, or it is not whole.", advice=_ADVICE)
    return dict(header)
