"""Store each object as a file in a folder, synced to the disk before `put` returns.

A network disk that is not mounted looks like an empty folder, or like none. A marker file at the root tells such a
store, which is away, from one that lacks an object: an object is missing only while the marker is there.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TypeVar

from meshdeform.errors import NotFoundError, UnavailableError
from meshdeform.storage.base import CHUNK, file_errors, is_key

T = TypeVar("T")
MARKER = ".meshdeform-store"
_MARKER_TEXT = "This folder is an object store of Meshdeform. Without this file it counts as away, as if not mounted.\n"
_PARTIAL = ".partial"
_LOCKED = "locked-"
# How long a file is kept of whose writer nothing is known: of an edition that locks none, or where locks do not work.
_PARTIAL_KEPT_S = 3600.0


class Folder:
    """A folder of files. Incomplete files are in `.partial`.

    With `create`, a missing or empty folder becomes a new store. Otherwise it counts as a store that is away.
    """

    def __init__(self, root: Path, *, create: bool = True) -> None:
        self.root = root.absolute()
        self._partial = self.root / _PARTIAL
        with suppress(UnavailableError):
            self.ping()
            self._clean_up()
            return
        if create:
            with file_errors():
                self.root.mkdir(parents=True, exist_ok=True)
                self._mark()

    def ping(self, timeout_s: float | None = None) -> None:  # noqa: ARG002
        """Return if the store is there."""
        with file_errors():
            if (self.root / MARKER).exists():
                return
        raise UnavailableError(
            f"The object store's folder {self.root.name} is missing or empty.",
            advice=f"Mount it. If it is to be an empty store, create the file {MARKER} in it.",
        )

    def _mark(self) -> None:
        (self.root / MARKER).write_text(_MARKER_TEXT)
        sync_folder(self.root)

    def _clean_up(self) -> None:
        """Remove partial files of processes that died while writing."""
        with file_errors(), suppress(FileNotFoundError):
            for left_over in self._partial.iterdir():
                with suppress(FileNotFoundError), left_over.open("r+b") as file:
                    if _is_left(file, left_over.name):
                        left_over.unlink()

    def _new_partial(self) -> tuple[int, Path]:
        """Create a file that is locked while its writer lives."""
        while True:
            handle, name = tempfile.mkstemp(dir=self._partial, prefix=_LOCKED)
            with suppress(OSError):
                fcntl.flock(handle, fcntl.LOCK_EX)
            # Another process may have taken it for a dead one's before it was locked.
            if (path := Path(name)).exists():
                return handle, path
            os.close(handle)

    @contextmanager
    def errors(self, what: str) -> Iterator[None]:
        """Translate file errors; a file is only missing if the store is there."""
        try:
            with file_errors(what):
                yield
        except NotFoundError:
            self.ping()
            raise

    def _ask(self, key: str, question: Callable[[Path], T]) -> T:
        """Ask about a file, again if it is missing: the store may have come back between the miss and the check."""
        with suppress(NotFoundError), self.errors(key):
            return question(self.root / key)
        with self.errors(key):
            return question(self.root / key)

    def put(self, key: str, source: BinaryIO, content_type: str) -> None:  # noqa: ARG002 - the record keeps it
        """Write a temporary file, sync it, rename it and sync the folders."""
        self.ping()
        with file_errors():
            self._partial.mkdir(exist_ok=True)
            handle, temporary = self._new_partial()
            try:
                with os.fdopen(handle, "wb") as file:
                    shutil.copyfileobj(source, file, CHUNK)
                    file.flush()
                    os.fsync(file.fileno())
                    self.rename_into_place(temporary, key)
            finally:
                temporary.unlink(missing_ok=True)

    def size(self, key: str) -> int:
        """Return the size of a file in bytes."""
        return self._ask(key, _size)

    def stream(self, key: str, start: int, end: int | None, chunk: int) -> Iterator[bytes]:
        """Open the file immediately and read it as the chunks are consumed."""
        file = self._ask(key, lambda path: path.open("rb"))
        with file_errors():
            size = os.fstat(file.fileno()).st_size
            file.seek(start)
        return _chunks(key, file, (size if end is None else min(end, size)) - start, chunk)

    def copy(self, source: str, destination: str) -> None:
        """Copy a file. A hard link would keep the original's age, and some file systems have none."""
        with self._ask(source, lambda path: path.open("rb")) as file:
            self.put(destination, file, "")

    def list(self, folder: str) -> Iterator[tuple[str, int]]:
        """Yield every file below a folder, sorted by name."""
        self.ping()  # an empty folder in place of the store lists nothing
        try:
            with self.errors(folder):
                entries = sorted(os.scandir(self.root / folder), key=lambda entry: entry.name)
        except NotFoundError:
            return
        for entry in entries:
            key = f"{folder}/{entry.name}" if folder else entry.name
            if not is_key(key):
                continue
            with file_errors():
                if entry.is_dir(follow_symlinks=False):
                    yield from self.list(key)
                    continue
            try:
                with self.errors(key):
                    status = entry.stat()
            except NotFoundError:
                continue  # removed since the folder was read
            if stat.S_ISREG(status.st_mode):
                yield key, status.st_size

    def sync(self, key: str) -> None:
        """Sync the folders above a file, which another process may have renamed into place a moment ago."""
        for parent in (self.root / key).parents:
            if not parent.is_relative_to(self.root):
                break
            with self.errors(key):
                sync_folder(parent)

    def delete(self, key: str) -> None:
        """Remove a file."""
        self._ask(key, Path.unlink)

    def delete_folder(self, folder: str) -> None:
        """Remove a folder with all its contents."""
        with suppress(NotFoundError):
            self._ask(folder, shutil.rmtree)

    def rename_into_place(self, temporary: Path, key: str) -> None:
        """Rename a file and sync every folder with a new entry, so that the name survives a power cut."""
        path = self.root / key
        self.ping()  # so that no folder is made where the store is not mounted
        missing = [folder for folder in path.parents if folder.is_relative_to(self.root) and not folder.exists()]
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

    def presign(self, method: str, key: str, expires_s: int) -> str | None:  # noqa: ARG002
        """Return None: only the API serves the folder, and it signs its own URLs."""
        return None


def sync_folder(folder: Path) -> None:
    """Sync a folder's entries to the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _is_left(file: BinaryIO, name: str) -> bool:
    """Return whether the writer of a file in `.partial` is gone."""
    if name.startswith(_LOCKED):
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            pass
        else:
            return True
    return time.time() - os.fstat(file.fileno()).st_mtime > _PARTIAL_KEPT_S


def _size(path: Path) -> int:
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise IsADirectoryError(path.name)
    return status.st_size


def _chunks(key: str, file: BinaryIO, left: int, chunk: int) -> Iterator[bytes]:
    with file, file_errors():
        while left > 0 and (data := file.read(min(chunk, left))):
            left -= len(data)
            yield data
        if left > 0:
            raise UnavailableError(f"The object store's {key} ends {left} bytes early.")
