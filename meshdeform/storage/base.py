"""What every kind of object store has in common: the keys, the errors, and what a backend must do."""

from __future__ import annotations

import errno
import hashlib
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import BinaryIO, Protocol

from meshdeform.errors import NotFoundError, UnavailableError

__all__ = ["CHUNK", "Backend", "StoredObject", "check_key", "file_errors", "is_key", "measured", "parts_of"]

CHUNK = 1 << 20
_KEY = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._-]*(/[A-Za-z0-9_-][A-Za-z0-9._-]*)*")


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


class Backend(Protocol):
    """A kind of object store. Keys are checked before they come here."""

    def ping(self, timeout_s: float | None = None) -> None:
        """Return when the store answers; UnavailableError where it does not within the time."""

    def put(self, key: str, source: BinaryIO, content_type: str) -> None:
        """Store the bytes of a file, durably, all at once."""

    def size(self, key: str) -> int:
        """Bytes of an object."""

    def stream(self, key: str, start: int, end: int | None, chunk: int) -> Iterator[bytes]:
        """Bytes [start, end) in parts; NotFoundError before the first, UnavailableError where it ends early."""

    def copy(self, source: str, destination: str) -> None:
        """Store an object once more."""

    def list(self, folder: str) -> Iterator[tuple[str, int]]:
        """Key and size of every object below a folder, or of all."""

    def delete(self, key: str) -> None:
        """Remove an object; NotFoundError where there is none."""

    def delete_folder(self, folder: str) -> None:
        """Remove every object below a folder."""

    def presign(self, method: str, key: str, expires_s: int) -> str | None:
        """Return a URL for `method`; None where the store has no URLs."""


def is_key(text: str) -> bool:
    """Whether something can be the key of an object."""
    return _KEY.fullmatch(text) is not None


def check_key(key: str) -> None:
    """Refuse what is no key: no empty part, none that begins with a dot, nothing that leads out or hides."""
    if not is_key(key):
        raise NotFoundError(f"{key!r} is no key of an object.")


def measured(parts: Iterable[bytes]) -> StoredObject:
    """Size and digest of bytes that pass by in parts."""
    digest, size = hashlib.sha256(), 0
    for part in parts:
        digest.update(part)
        size += len(part)
    return StoredObject(size, digest.hexdigest())


def parts_of(source: BinaryIO) -> Iterator[bytes]:
    """The rest of a file, in parts."""
    while part := source.read(CHUNK):
        yield part


@contextmanager
def file_errors(what: str) -> Iterator[None]:
    """Turn what the operating system says of a file into our own errors."""
    try:
        yield
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError) as error:
        raise NotFoundError(f"The object store has no {what}.") from error
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise UnavailableError(
                f"The disk is full ({error.strerror}).",
                advice="Free space where MESHDEFORM_STORAGE_URL and MESHDEFORM_DATA_DIR point; what was being written "
                "is removed, what was there before is whole. Then try again.",
            ) from error
        raise UnavailableError(f"The object store does not answer ({error.strerror}).") from error
