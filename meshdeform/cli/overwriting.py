"""Refuse to overwrite files that an earlier run did not write."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from meshdeform.errors import ParameterError

__all__ = ["check_checkpoint", "check_outputs"]

_FORCE = "Choose another name with -o, or overwrite it with --force."


def check_outputs(outputs: Mapping[str, Path], inputs: Sequence[Path]) -> None:
    """Refuse outputs that would replace an input or a file of the user.

    Files of an earlier run may be replaced, so that loops and Makefiles work: the report beside the result has the
    result's SHA-256. A result that was edited since then is a file of the user.

    Parameters
    ----------
    outputs : mapping
        `result`, `report`, `preview`, and if requested `morph`.
    inputs : sequence of Path

    Raises
    ------
    ParameterError
        A file would be lost.
    """
    for path in outputs.values():
        if path.exists() and any(source.exists() and path.samefile(source) for source in inputs):
            raise ParameterError(f"{path} is an input of this run.", advice=_FORCE)
    report = _read_report(outputs["report"])
    for name, path in outputs.items():
        if path.exists() and not _is_ours(name, path, report):
            raise ParameterError(f"{path} exists and was not written by an earlier run.", advice=_FORCE)


def check_checkpoint(path: Path) -> None:
    """Refuse to replace a file that is not a checkpoint.

    Raises
    ------
    ParameterError
        The file is something else.
    """
    if path.exists() and not _is_checkpoint(path):
        raise ParameterError(
            f"{path} exists and is not a checkpoint.",
            advice="Choose another name with --checkpoint, or overwrite it with --force.",
        )


def _read_report(path: Path) -> dict[str, Any] | None:
    try:
        found = json.loads(path.read_bytes())
        digest = found["result"]["sha256"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return found if isinstance(digest, str) and "fingerprint" in found else None


def _is_ours(name: str, path: Path, report: Mapping[str, Any] | None) -> bool:
    if report is None:
        return False
    if name == "result":
        digest = (report.get(name) or {}).get("sha256")
        return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == digest
    return True  # its name is made from that of the result


def _is_checkpoint(path: Path) -> bool:
    # The layout of safetensors: 8 bytes of length, then JSON.
    try:
        with path.open("rb") as file:
            size = int.from_bytes(file.read(8), "little")
            header = json.loads(file.read(min(size, 2**24)))
        return str(header["__metadata__"]["format"]).startswith("meshdeform-checkpoint")
    except (OSError, ValueError, KeyError, TypeError):
        return False
