"""The object store: bytes by key, in a folder or in an S3-compatible bucket, behind one small class.

A key is absent or whole, never half: in a folder a file is written aside, synced to the disk and renamed (obstore's own
folder store does not sync), a bucket puts objects atomically. Torch-free and numpy-free.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Any, BinaryIO, Protocol

from meshdeform.errors import DependencyError, NotFoundError, UnavailableError

__all__ = ["ObjectStore", "StoredObject"]

_CHUNK = 1 << 20
_KEY = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*(/[A-Za-z0-9_-][A-Za-z0-9._-]*)*")
# obstore's own defaults try for three minutes: longer than a request, or a worker's lease, can wait.
_CLIENT: Any = {"connect_timeout": timedelta(seconds=3), "timeout": timedelta(minutes=5)}
_RETRY: Any = {"max_retries": 3, "retry_timeout": timedelta(seconds=10)}
_PARTIAL = ".partial"
_PARTIAL_KEPT_S = 86_400.0


@dataclass(frozen=True)
class StoredObject:
    """What was stored.

    Attributes
    ----------
    size : int
        Bytes.
    sha256 : str
        Hexadecimal.
    """

    size: int
    sha256: str


class ObjectStore:
    """Bytes by key. Keys are slash-separated names of letters, digits, `.`, `_` and `-`.

    Parameters
    ----------
    location : str or Path
        A folder, or a URL: ``s3://BUCKET/PREFIX`` (credentials and endpoint from the usual ``AWS_*`` variables),
        ``memory://`` for tests.

    Raises
    ------
    UnavailableError
        The location cannot be used. Every method raises it when the store does not answer.
    """

    def __init__(self, location: str | Path) -> None:
        text = str(location)
        self._backend: _Backend
        if "://" in text and not text.startswith("file://"):
            self._backend = _Bucket(text)
        else:
            self._backend = _Folder(Path(text.removeprefix("file://")))

    def ping(self) -> None:
        """Return when the store answers."""
        self._backend.ping()

    def put(self, key: str, data: bytes | Path, content_type: str = "application/octet-stream") -> StoredObject:
        """Store bytes, or the bytes of a file, in place of what was there. Durable when it returns.

        Parameters
        ----------
        key : str
        data : bytes or Path
        content_type : str
            Kept where the store can.
        """
        _check(key)
        with _opened(data) as source:
            digest, size = hashlib.sha256(), 0
            while part := source.read(_CHUNK):
                digest.update(part)
                size += len(part)
            source.seek(0)
            self._backend.put(key, source, content_type)
        return StoredObject(size, digest.hexdigest())

    def get(self, key: str) -> bytes:
        """All bytes of an object.

        Raises
        ------
        NotFoundError
            There is none.
        """
        return b"".join(self.stream(key))

    def size(self, key: str) -> int:
        """Bytes of an object.

        Raises
        ------
        NotFoundError
            There is none.
        """
        _check(key)
        return self._backend.size(key)

    def exists(self, key: str) -> bool:
        """Whether there is an object."""
        try:
            self.size(key)
        except NotFoundError:
            return False
        return True

    def stream(self, key: str, start: int = 0, end: int | None = None, chunk: int = _CHUNK) -> Iterator[bytes]:
        """Bytes [start, end) of an object, in parts of about `chunk` bytes.

        Raises
        ------
        NotFoundError
            There is none; raised here, before the first part is asked for.
        """
        _check(key)
        return self._backend.stream(key, start, end, chunk)

    def delete(self, key: str) -> None:
        """Remove an object; nothing happens where there is none."""
        _check(key)
        with suppress(NotFoundError):
            self._backend.delete(key)

    def delete_prefix(self, prefix: str) -> None:
        """Remove every object below a prefix, which ends with a slash: `jobs/ID/`."""
        _check(prefix.removesuffix("/"))
        self._backend.delete_folder(prefix.removesuffix("/"))


class _Backend(Protocol):
    def ping(self) -> None: ...
    def put(self, key: str, source: BinaryIO, content_type: str) -> None: ...
    def size(self, key: str) -> int: ...
    def stream(self, key: str, start: int, end: int | None, chunk: int) -> Iterator[bytes]: ...
    def delete(self, key: str) -> None: ...
    def delete_folder(self, folder: str) -> None: ...


class _Folder:
    """A folder of files."""

    def __init__(self, root: Path) -> None:
        self._root = root.absolute()
        self._partial = self._root / _PARTIAL
        with _file_errors("the folder"):
            self._partial.mkdir(parents=True, exist_ok=True)
            for left_over in self._partial.iterdir():
                # Of a process that died while it wrote; a day is longer than any write takes.
                with suppress(FileNotFoundError):
                    if time.time() - left_over.stat().st_mtime > _PARTIAL_KEPT_S:
                        left_over.unlink()

    def ping(self) -> None:
        with _file_errors("the folder"):
            os.stat(self._partial)  # noqa: PTH116 - a missing folder must raise, which `exists` does not

    def put(self, key: str, source: BinaryIO, content_type: str) -> None:  # noqa: ARG002 - the record keeps it
        path = self._root / key
        with _file_errors(key):
            handle, aside = tempfile.mkstemp(dir=self._partial)
            try:
                with os.fdopen(handle, "wb") as file:
                    shutil.copyfileobj(source, file, _CHUNK)
                    file.flush()
                    os.fsync(file.fileno())
                _rename_into_place(Path(aside), path, self._root)
            finally:
                Path(aside).unlink(missing_ok=True)

    def size(self, key: str) -> int:
        with _file_errors(key):
            found = (self._root / key).stat()
            if not stat.S_ISREG(found.st_mode):
                raise IsADirectoryError(key)
            return found.st_size

    def stream(self, key: str, start: int, end: int | None, chunk: int) -> Iterator[bytes]:
        with _file_errors(key):
            file = (self._root / key).open("rb")
            left = os.fstat(file.fileno()).st_size if end is None else end
            file.seek(start)
        return _parts(key, file, left - start, chunk)

    def delete(self, key: str) -> None:
        with _file_errors(key):
            (self._root / key).unlink()

    def delete_folder(self, folder: str) -> None:
        with _file_errors(folder), suppress(FileNotFoundError):
            shutil.rmtree(self._root / folder)


class _Bucket:
    """Whatever obstore can open."""

    def __init__(self, url: str) -> None:
        # Loaded here, so that a deployment on a folder keeps the megabytes.
        try:
            import obstore
            import obstore.store
        except ModuleNotFoundError as error:
            raise DependencyError(
                "The package obstore is not installed.", advice='Run: pip install "meshdeform[stack]".'
            ) from error
        self._api: Any = obstore
        with self._errors(url):
            if url.startswith("memory:"):
                self._store: Any = obstore.store.MemoryStore()
                return
            self._store = obstore.store.from_url(url, client_options=_CLIENT, retry_config=_RETRY)

    def ping(self) -> None:
        with self._errors("the bucket"):
            next(iter(self._api.list(self._store, prefix="ping", chunk_size=1)), None)

    def put(self, key: str, source: BinaryIO, content_type: str) -> None:
        with self._errors(key):
            self._api.put(self._store, key, source, attributes={"Content-Type": content_type})

    def size(self, key: str) -> int:
        with self._errors(key):
            return int(self._api.head(self._store, key)["size"])

    def stream(self, key: str, start: int, end: int | None, chunk: int) -> Iterator[bytes]:
        if end is not None and start >= end:
            self.size(key)
            return iter(())
        span: Any = {"offset": start} if end is None else (start, end)
        with self._errors(key):
            # An empty object has no range to ask for.
            options = {} if start == 0 and end is None else {"range": span}
            found = self._api.get(self._store, key, options=options)
        return self._stream(key, found, chunk)

    def _stream(self, key: str, found: Any, chunk: int) -> Iterator[bytes]:
        with self._errors(key):
            for part in found.stream(min_chunk_size=chunk):
                yield bytes(part)

    def delete(self, key: str) -> None:
        with self._errors(key):
            self._api.delete(self._store, key)

    def delete_folder(self, folder: str) -> None:
        with self._errors(folder):
            for batch in self._api.list(self._store, prefix=folder):
                if paths := [entry["path"] for entry in batch]:
                    self._api.delete(self._store, paths)

    @contextmanager
    def _errors(self, what: str) -> Iterator[None]:
        try:
            yield
        except (self._api.exceptions.NotFoundError, FileNotFoundError) as error:
            raise NotFoundError(f"The object store has no {what}.") from error
        except (self._api.exceptions.BaseError, OSError, ValueError) as error:
            raise UnavailableError(f"The object store does not answer ({type(error).__name__}).") from error


def _check(key: str) -> None:
    # No empty part, none that begins with a dot: nothing leads out of the folder or hides in it.
    if not _KEY.fullmatch(key):
        raise NotFoundError(f"{key!r} is no key of an object.")


@contextmanager
def _opened(data: bytes | Path) -> Iterator[BinaryIO]:
    if isinstance(data, Path):
        with data.open("rb") as file:
            yield file
    else:
        yield io.BytesIO(data)


def _parts(key: str, file: BinaryIO, left: int, chunk: int) -> Iterator[bytes]:
    with file, _file_errors(key):
        while left > 0 and (part := file.read(min(chunk, left))):
            left -= len(part)
            yield part


def _rename_into_place(aside: Path, path: Path, root: Path) -> None:
    """Rename, and sync every folder that has a new entry: after a power cut the name is there too."""
    missing = [folder for folder in path.parents if folder.is_relative_to(root) and not folder.exists()]
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            aside.replace(path)
            break
        except FileNotFoundError:
            # The folder was removed in between (`delete_folder`); without the file aside this would never end.
            if not aside.exists():
                raise
    for folder in {path.parent, *(folder.parent for folder in missing)}:
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextmanager
def _file_errors(what: str) -> Iterator[None]:
    try:
        yield
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError) as error:
        raise NotFoundError(f"The object store has no {what}.") from error
    except OSError as error:
        raise UnavailableError(f"The object store does not answer ({error.strerror}).") from error
