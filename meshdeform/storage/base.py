"""Define keys, errors and the interface of a backend for all object stores."""

from __future__ import annotations

import errno
import hashlib
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import BinaryIO, Protocol

from meshdeform.errors import NotFoundError, UnavailableError

CHUNK = 1 << 20
_KEY = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*(/[A-Za-z0-9_-][A-Za-z0-9._-]*)*")


@dataclass(frozen=True)
class StoredObject:
    """The size of an object in bytes, and its SHA-256 (hexadecimal)."""

    size: int
    sha256: str


class Backend(Protocol):
    """The interface of an object store's backend. Keys are checked before they are passed in."""

    def ping(self, timeout_s: float | None = None) -> None:
        """Return once the store answers, or raise UnavailableError if it does not within the time."""

    def put(self, key: str, source: BinaryIO, content_type: str) -> None:
        """Store the bytes of a file durably and atomically."""

    def size(self, key: str) -> int:
        """Return the size of an object in bytes."""

    def stream(self, key: str, start: int, end: int | None, chunk: int) -> Iterator[bytes]:
        """Yield bytes [start, end) in chunks; raise NotFoundError before the first, UnavailableError if cut short."""

    def copy(self, source: str, destination: str) -> None:
        """Copy an object to another key."""

    def list(self, folder: str) -> Iterator[tuple[str, int]]:
        """Yield the key and size of every object below a folder, or of all objects."""

    def sync(self, key: str) -> None:
        """Make the name of an existing object durable."""

    def delete(self, key: str) -> None:
        """Remove an object; raise NotFoundError if there is none."""

    def delete_folder(self, folder: str) -> None:
        """Remove every object below a folder."""

    def presign(self, method: str, key: str, expires_s: int) -> str | None:
        """Return a signed URL for `method`, or None if the store has no URLs."""


def is_key(text: str) -> bool:
    """Return whether a text is a valid object key."""
    return _KEY.fullmatch(text) is not None


def check_key(key: str) -> None:
    """Refuse an invalid key: no name in it is empty or begins with a dot: none leaves the store or is hidden."""
    if not is_key(key):
        raise NotFoundError(f"{key!r} is not a valid object key.")


def measured(chunks: Iterable[bytes]) -> StoredObject:
    """Return the size and digest of bytes given in chunks."""
    digest, size = hashlib.sha256(), 0
    for chunk in chunks:
        digest.update(chunk)
        size += len(chunk)
    return StoredObject(size, digest.hexdigest())


def chunks_of(source: BinaryIO) -> Iterator[bytes]:
    """Yield the rest of a file in chunks."""
    while chunk := source.read(CHUNK):
        yield chunk


@contextmanager
def file_errors(what: str | None = None) -> Iterator[None]:
    """Translate the operating system's file errors into Meshdeform's; without a name, nothing may be missing."""
    try:
        yield
    except OSError as error:
        if what is not None and isinstance(error, FileNotFoundError | NotADirectoryError | IsADirectoryError):
            raise NotFoundError(f"The object store has no {what}.") from error
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise UnavailableError(
                f"The disk is full ({error.strerror}).",
                advice="Free space where MESHDEFORM_STORAGE_URL and MESHDEFORM_DATA_DIR point, then try again. The "
                "incomplete file was removed; files that existed before are intact.",
            ) from error
        raise UnavailableError(f"The object store does not answer ({error.strerror}).") from error
