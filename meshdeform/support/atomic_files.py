"""Write files atomically. Standard library only."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

__all__ = ["write_files"]


def write_files(contents: Mapping[Path, bytes]) -> None:
    """Write every file or none: all bytes are on the disk before the first file is renamed.

    Raises
    ------
    OSError
        A file cannot be written; existing files with these names are unchanged.
    """
    with ExitStack() as cleanup:
        written = {path: _write_beside(path, data, cleanup) for path, data in contents.items()}
        for path, temporary in written.items():
            temporary.replace(path)


def _write_beside(path: Path, data: bytes, cleanup: ExitStack) -> Path:
    """Write `data` to a file next to `path`, where renaming is atomic; clean-up removes it unless it was renamed."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    cleanup.callback(temporary.unlink, missing_ok=True)
    with temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    return temporary
