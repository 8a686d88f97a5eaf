"""Receive files in parts, and verify them."""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path
from typing import IO

from meshdeform.api.jobs import ArtifactView
from meshdeform.errors import StoredFileError, UnavailableError

AFTERWARDS = ("morph.glb", "map.safetensors", "result.stl")
"""The artifacts that the service can make of a job that has succeeded."""

_BATCH = 2**20
_SHA256 = re.compile(r'(?:W/)?"([0-9a-f]{64})"')


class PartialFile:
    """The received part of a file, and its digest."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file, self.tag, self._resumed = file, "", False
        self._hash, self._count = hashlib.sha256(), 0
        self._waiting, self._waiting_bytes = list[bytes](), 0

    def headers(self) -> dict[str, str]:
        """Return the headers that request the rest."""
        self._resumed = bool(self._count)
        return {"Range": f"bytes={self._count}-", "If-Range": self.tag} if self._count else {}

    def begin(self) -> None:
        """Discard the bytes received so far."""
        self._resumed = False
        self._file.seek(0)
        self._file.truncate()
        self._hash, self._count = hashlib.sha256(), 0
        self._waiting, self._waiting_bytes = [], 0

    def add(self, data: bytes) -> bool:
        """Buffer bytes and return whether there are enough to write."""
        self._waiting.append(data)
        self._waiting_bytes += len(data)
        return self._waiting_bytes >= _BATCH

    def flush(self) -> None:
        """Write the buffered bytes."""
        for data in self._waiting:
            self._file.write(data)
            self._hash.update(data)
        self._count += self._waiting_bytes
        self._waiting, self._waiting_bytes = [], 0

    def verify(self, sha256: str | None) -> None:
        """Compare the whole file with the SHA-256 that the service has sent, and with the artifact's, if known."""
        sent = _SHA256.fullmatch(self.tag)
        for expected in (sent[1] if sent else None, sha256):
            if expected is not None and expected != self._hash.hexdigest():
                if self._resumed:
                    raise StoredFileError("The received bytes differ from what was stored.")
                raise UnavailableError("The received bytes differ from what the service sent.", advice="Try again.")


def to_disk(file: IO[bytes]) -> None:
    """Write a file through to the disk."""
    file.flush()
    os.fsync(file.fileno())


def is_same(path: Path, artifact: ArtifactView) -> bool:
    """Return whether a file is identical to an artifact."""
    try:
        if path.stat().st_size != artifact.size:
            return False
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest() == artifact.sha256
    except OSError:
        return False
