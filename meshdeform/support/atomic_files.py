"""Write files so that each is either all there or not there at all. Standard library only."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

__all__ = ["write_files"]


def write_files(contents: Mapping[Path, bytes]) -> None:
    """Write every file, or none: all bytes are on the disk before the first name changes.

    Raises
    ------
    OSError
        A file cannot be written; the files of these names are as they were before.
    """
    with ExitStack() as cleanup:
        written = {path: _write_beside(path, data, cleanup) for path, data in contents.items()}
        for path, temporary in written.items():
            temporary.replace(path)


def _write_beside(path: Path, data: bytes, cleanup: ExitStack) -> Path:
    """Write `data` next to `path`, where renaming it is atomic; it is removed at clean-up unless it was renamed."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    cleanup.callback(temporary.unlink, missing_ok=True)
    with temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    return temporary
