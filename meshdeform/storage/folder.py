"""Store each object as a file in a folder, synced to the disk before `put` returns."""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from meshdeform.errors import UnavailableError
from meshdeform.storage.base import CHUNK, file_errors, is_key

__all__ = ["Folder", "rename_into_place", "sync_folder"]

_PARTIAL = ".partial"
_PARTIAL_KEPT_S = 86_400.0


class Folder:
    """A folder of files. Incomplete files are in `.partial`.

    Parameters
    ----------
    root : Path
        Created if missing.
    """

    def __init__(self, root: Path) -> None:
        self.root = root.absolute()
        self._partial = self.root / _PARTIAL
        with file_errors("the folder"):
            self._partial.mkdir(parents=True, exist_ok=True)
            for left_over in self._partial.iterdir():
                # Left by a process that died while writing; no write takes a day.
                with suppress(FileNotFoundError):
                    if time.time() - left_over.stat().st_mtime > _PARTIAL_KEPT_S:
                        left_over.unlink()

    def ping(self, timeout_s: float | None = None) -> None:  # noqa: ARG002
        """Return if the folder exists."""
        with file_errors("the folder"):
            os.stat(self._partial)  # noqa: PTH116 - a missing folder must raise, which `exists` does not

    def put(self, key: str, source: BinaryIO, content_type: str) -> None:  # noqa: ARG002 - the record keeps it
        """Write a temporary file, sync it, rename it and sync the folders."""
        with file_errors(key):
            handle, temporary = tempfile.mkstemp(dir=self._partial)
            try:
                with os.fdopen(handle, "wb") as file:
                    shutil.copyfileobj(source, file, CHUNK)
                    file.flush()
                    os.fsync(file.fileno())
                rename_into_place(Path(temporary), self.root / key, self.root)
            finally:
                Path(temporary).unlink(missing_ok=True)

    def size(self, key: str) -> int:
        """Return the size of a file in bytes."""
        with file_errors(key):
            found = (self.root / key).stat()
            if not stat.S_ISREG(found.st_mode):
                raise IsADirectoryError(key)
            return found.st_size

    def stream(self, key: str, start: int, end: int | None, chunk: int) -> Iterator[bytes]:
        """Open the file immediately and read it as the chunks are consumed."""
        with file_errors(key):
            file = (self.root / key).open("rb")
            size = os.fstat(file.fileno()).st_size
            file.seek(start)
        return _parts(key, file, (size if end is None else min(end, size)) - start, chunk)

    def copy(self, source: str, destination: str) -> None:
        """Copy a file. A hard link would keep the original's age, and some file systems have none."""
        with file_errors(source):
            file = (self.root / source).open("rb")
        with file:
            self.put(destination, file, "")

    def list(self, folder: str) -> Iterator[tuple[str, int]]:
        """Yield every file below a folder, sorted by name."""
        with file_errors(folder):
            try:
                entries = sorted(os.scandir(self.root / folder), key=lambda entry: entry.name)
            except (FileNotFoundError, NotADirectoryError):
                return
        for entry in entries:
            key = f"{folder}/{entry.name}" if folder else entry.name
            if not is_key(key):
                continue
            with file_errors(key):
                if entry.is_dir(follow_symlinks=False):
                    yield from self.list(key)
                    continue
                try:
                    found = entry.stat()
                except FileNotFoundError:
                    continue  # removed since the folder was read
            if stat.S_ISREG(found.st_mode):
                yield key, found.st_size

    def sync(self, key: str) -> None:
        """Sync the folders above a file, which another process may have renamed into place a moment ago."""
        for parent in (self.root / key).parents:
            if not parent.is_relative_to(self.root):
                break
            with file_errors(key):
                sync_folder(parent)

    def delete(self, key: str) -> None:
        """Remove a file."""
        with file_errors(key):
            (self.root / key).unlink()

    def delete_folder(self, folder: str) -> None:
        """Remove a folder with all its contents."""
        with file_errors(folder), suppress(FileNotFoundError):
            shutil.rmtree(self.root / folder)

    def presign(self, method: str, key: str, expires_s: int) -> str | None:  # noqa: ARG002
        """Return None: only the API serves the folder, and it signs its own URLs."""
        return None


def rename_into_place(temporary: Path, path: Path, root: Path) -> None:
    """Rename a file and sync every folder with a new entry, so that the name survives a power cut."""
    missing = [folder for folder in path.parents if folder.is_relative_to(root) and not folder.exists()]
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            temporary.replace(path)
            break
        except FileNotFoundError:
            # `delete_folder` removed the folder in between. Retry, unless the temporary file is missing, too.
            if not temporary.exists():
                raise
    for folder in {path.parent, *(folder.parent for folder in missing)}:
        sync_folder(folder)


def sync_folder(folder: Path) -> None:
    """Sync a folder's entries to the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _parts(key: str, file: BinaryIO, left: int, chunk: int) -> Iterator[bytes]:
    with file, file_errors(key):
        while left > 0 and (part := file.read(min(chunk, left))):
            left -= len(part)
            yield part
        if left > 0:
            raise UnavailableError(f"The object store's {key} ends {left} bytes early.")
