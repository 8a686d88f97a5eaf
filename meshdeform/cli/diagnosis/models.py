"""Check the built-in model and the configured one, without loading either."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import struct
from base64 import urlsafe_b64decode
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import meshdeform
from meshdeform.cli.diagnosis.checks import Finding, Subject, fail, ok

__all__ = ["check_builtin", "check_model"]

_WEIGHTS = "meshdeform/priors/builtin/weights/prior.safetensors"
_ADVICE = "Install meshdeform again: the weights are part of the package."


def check_builtin() -> Iterator[Finding]:
    """Check that the weights exist, are complete, fit the grammar and are the installed ones."""
    path = Path(meshdeform.__file__).parent.parent / _WEIGHTS
    if not path.is_file():
        yield fail("builtin prior", f"there is no {path}", _ADVICE)
        return
    data = path.read_bytes()
    digest = hashlib.sha256(data)
    try:
        metadata = _metadata(data)
    except ValueError as error:
        yield fail("builtin prior", f"{path} is damaged: {error}", _ADVICE)
        return
    if metadata.get("vocabulary") != _vocabulary_hash():
        yield fail("builtin prior", f"{path} was trained for another vocabulary", _ADVICE)
    elif _installed_digest() not in (None, digest.digest()):
        yield fail("builtin prior", f"{path} is not the file that was installed", _ADVICE)
    else:
        yield ok("builtin prior", f"{len(data) / 2**20:.1f} MiB, SHA-256 {digest.hexdigest()[:16]}")


def _metadata(data: bytes) -> dict[str, Any]:
    """Return the metadata of a safetensors file; check its lengths against the file.

    Source: the format of github.com/huggingface/safetensors: 8 bytes of length, JSON, the tensors' bytes.
    """
    if len(data) < 8:
        raise ValueError("it is cut off")
    (size,) = struct.unpack("<Q", data[:8])
    if size > len(data) - 8:
        raise ValueError("it is cut off")
    header = json.loads(data[8 : 8 + size])
    ends = [tensor["data_offsets"][1] for name, tensor in header.items() if name != "__metadata__"]
    if not ends or max(ends) != len(data) - 8 - size:
        raise ValueError("its length differs from the one in its header")
    return dict(header.get("__metadata__", {}))


def _vocabulary_hash() -> str:
    """Return what `meshdeform.priors.builtin.weights_file.vocabulary_hash` returns, without torch; a test compares."""
    from meshdeform.priors.builtin.grammar import VOCABULARY

    return hashlib.sha256(" ".join(VOCABULARY).encode()).hexdigest()[:16]


def _installed_digest() -> bytes | None:
    """Return the SHA-256 of the weights from the installation record; None in a clone, which has no record."""
    for file in importlib.metadata.files("meshdeform") or ():
        if file.as_posix() == _WEIGHTS and file.hash is not None and file.hash.mode == "sha256":
            return urlsafe_b64decode(file.hash.value + "=" * (-len(file.hash.value) % 4))
    return None


def check_model(subject: Subject) -> Iterator[Finding]:
    """Check that all files of MESHDEFORM_MODEL exist, according to its index."""
    model = subject.settings.model
    if model == "builtin":
        yield ok("model", "builtin (MESHDEFORM_MODEL is not set)")
        return
    from meshdeform.priors.model_files import find

    files = find(model, subject.settings.model_revision)
    size = sum(path.stat().st_size for part in files.parts.values() for path in part.files)
    yield ok("model", f"{model}: {size / 2**30:.1f} GiB in {files.folder}")
