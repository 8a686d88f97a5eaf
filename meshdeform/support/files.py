"""Name files readably, write them atomically, and tell their contents apart. Standard library only."""

from __future__ import annotations

import hashlib
import io
import os
import re
import zipfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

_MAX_LENGTH = 48


def slug(text: str) -> str:
    """Return text for a file name: words joined by hyphens, at most 48 characters; empty if there is no word."""
    return re.sub(r"\W+", "-", text).strip("-_")[:_MAX_LENGTH].strip("-_")


def artifact_name(artifact: str, base: str) -> str:
    """Return the file name for an artifact: `BASE.glb` for `result.glb`, `BASE.preview.png` for `preview.png`."""
    return f"{base}{artifact.removeprefix('result')}" if artifact.startswith("result.") else f"{base}.{artifact}"


def result_name(artifact: str, *, source: str, goal: str, seed: int | None) -> str:
    """Return the file name for an artifact: `duck-a-tall-vase-seed7.glb` for `result.glb`.

    `result.glb` loses its stem; any other artifact keeps it: `duck-a-tall-vase-seed7.preview.png`. The source is the
    name of the file that the job deforms and may be empty; the goal is the prompt, or what stands for it.
    """
    # Not `Path.stem`: the name is a client's, of any platform.
    filename = re.split(r"[\\/]", source)[-1]
    stem = filename.rpartition(".")[0] or filename
    words = [slug(stem), slug(goal), "" if seed is None else f"seed{seed}"]
    base = "-".join(filter(None, words))
    return artifact_name(artifact, base) if base else artifact


def write_files(contents: Mapping[Path, bytes]) -> None:
    """Write every file or none: all bytes are on the disk before the first file is renamed.

    If one cannot be written (`OSError`), existing files with these names are unchanged.
    """
    with ExitStack() as cleanup:
        written = {path: _write_beside(path, data, cleanup) for path, data in contents.items()}
        for path, temporary in written.items():
            temporary.replace(path)


def file_sha256(path: Path) -> str:
    """Return the hexadecimal SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def zipped(files: Mapping[str, bytes | str]) -> bytes:
    """Return a ZIP of files by name, compressed: the same bytes for the same files. Texts become UTF-8."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def _write_beside(path: Path, data: bytes, cleanup: ExitStack) -> Path:
    """Write `data` to a file next to `path`, where renaming is atomic; clean-up removes it unless it was renamed."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    cleanup.callback(temporary.unlink, missing_ok=True)
    with temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    return temporary
