"""Receive resumable uploads in the folder of an object store.

The bytes received so far are in `.uploads/ID`. They are synced to the disk before `append` returns, and become an
object by one rename. Only one process at a time writes to an upload: the file itself is the lock.
"""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from meshdeform.errors import AssetTooLargeError, ConflictError, MeshdeformError, NotFoundError
from meshdeform.storage.base import StoredObject, chunks_of, file_errors, is_key, measured
from meshdeform.storage.folder import Folder, sync_folder

_UPLOADS = ".uploads"


class UploadArea:
    """The unfinished uploads in the folder of an object store."""

    def __init__(self, folder: Folder) -> None:
        self._folder, self._area = folder, folder.root / _UPLOADS

    def append(self, upload_id: str, offset: int, chunks: Iterable[bytes], max_bytes: int) -> int:
        """Append bytes; see `ObjectStore.append`."""
        path = self._path(upload_id)
        if offset == 0:
            self._create(path)
        with self._locked(path) as file:
            present = os.fstat(file.fileno()).st_size
            if offset != present:
                raise ConflictError(
                    f"The upload has {present} bytes, not {offset}.", advice="Resume at its offset.", offset=present
                )
            file.seek(present)
            return _write(file, present, chunks, max_bytes)

    def appended(self, upload_id: str) -> StoredObject:
        """Return the size and digest of the bytes received so far."""
        with self._folder.errors("such upload"), self._path(upload_id).open("rb") as file:
            return measured(chunks_of(file))

    def size(self, upload_id: str) -> int:
        """Return the number of bytes received so far."""
        with self._folder.errors("such upload"):
            return self._path(upload_id).stat().st_size

    def commit(self, upload_id: str, key: str) -> StoredObject:
        """Turn the upload into an object; see `ObjectStore.commit_append`."""
        path, destination = self._path(upload_id), self._folder.root / key
        try:
            with self._locked(path) as file, self._folder.errors(key):
                measured_file = measured(chunks_of(file))
                # The bytes of an interrupted append may not be on the disk yet.
                os.fsync(file.fileno())
                self._folder.rename_into_place(path, key)
                return measured_file
        except NotFoundError:
            # Already renamed, by a process that died before it could record it.
            with self._folder.errors("such upload"), destination.open("rb") as file:
                measured_file = measured(chunks_of(file))
                sync_folder(destination.parent)
                return measured_file

    def discard(self, upload_id: str) -> None:
        """Remove the bytes received so far."""
        path = self._path(upload_id)
        with suppress(NotFoundError), self._folder.errors("such upload"):
            path.unlink()

    def _path(self, upload_id: str) -> Path:
        if not is_key(upload_id) or "/" in upload_id:
            raise NotFoundError(f"{upload_id!r} is not an upload.")
        return self._area / upload_id

    def _create(self, path: Path) -> None:
        self._folder.ping()
        with file_errors():
            if path.exists():
                return
            if not self._area.exists():
                self._area.mkdir(exist_ok=True)
                sync_folder(self._folder.root)
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT, 0o600))
            sync_folder(self._area)

    @contextmanager
    def _locked(self, path: Path) -> Iterator[BinaryIO]:
        with self._folder.errors("such upload"):
            file = path.open("r+b", buffering=0)
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise ConflictError(
                    "Another request is writing to this upload.", advice="Request its offset and resume there."
                ) from error
            with self._folder.errors("such upload"):
                # Between opening and locking, another process may have committed or removed it.
                if not os.path.samestat(os.fstat(file.fileno()), path.stat()):
                    raise FileNotFoundError(errno.ENOENT, "replaced")
            yield file


def _write(file: BinaryIO, present: int, chunks: Iterable[bytes], max_bytes: int) -> int:
    size = present
    try:
        try:
            for chunk in chunks:
                if size + len(chunk) > max_bytes:
                    raise AssetTooLargeError(f"The upload is over {max_bytes} bytes.")
                with file_errors():
                    rest = memoryview(chunk)
                    while rest:
                        rest = rest[file.write(rest) :]
                size += len(chunk)
        finally:
            # Also if the sender disconnected: keep the received bytes, so that it can resume.
            with file_errors():
                os.fsync(file.fileno())
    except MeshdeformError:
        # Over the limit, or the disk is full: discard the bytes of this call.
        with suppress(OSError):
            file.truncate(present)
        raise
    return size
