"""Check files of weights of the builtin prior by their headers: size, names, shapes and vocabulary. Torch-free.

A file is safetensors, never a pickle. Its metadata lists the tokens in the order of their numbers (`words`).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from meshdeform.errors import KindRetiredError, ModelError
from meshdeform.priors.builtin.grammar import VOCABULARY
from meshdeform.priors.model_files import CONVERT

MAX_FILE_BYTES = 256 * 2**20
"""The shipped weights take 8 MiB."""
_MAX_HEADER_BYTES = 4 * 2**20
_ADVICE = "Use a file that `python -m training.prior.train` wrote."
_ROWS = "text.word.weight"
_TAUGHT = "words_format"
"""Metadata of files whose words were taught; none is written any more."""


def check(path: Path) -> None:
    """Refuse a file that is not of this prior and this vocabulary; only its header is read.

    Raises ModelError: there is no file, it is too large, or it is not safetensors of this prior and vocabulary. Raises
    KindRetiredError: its words were taught.
    """
    header = _header(path)
    rows = header.get(_ROWS)
    if not isinstance(rows, dict) or "stem.weight" not in header:
        raise ModelError(
            f"The file {path} has no weights of the builtin prior.",
            advice=f"Single files of other models are not read. {CONVERT}",
        )
    metadata = header.get("__metadata__") or {}
    if _TAUGHT in metadata:
        raise KindRetiredError(f"The words of {path.name} were taught, and such weights are no longer read.")
    if str(metadata.get("words", "")).split() != list(VOCABULARY):
        raise ModelError(f"The weights in {path} were trained for another vocabulary.", advice=_ADVICE)
    shape = rows.get("shape")
    if not isinstance(shape, list) or shape[:1] != [len(VOCABULARY)]:
        raise ModelError(f"The weights in {path} have {shape} for {len(VOCABULARY)} words.", advice=_ADVICE)


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
