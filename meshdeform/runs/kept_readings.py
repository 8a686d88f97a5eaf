"""Keep readings of assets, so that none is made twice: keys, and the folder of a machine. Torch-free, numpy-free.

A key holds the asset's bytes and all of a request that a reading depends on, but not the version that made it: what
another version made is replaced. Corrections of parts are laid over a reading, and are no part of the key.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from meshdeform.requests.choices import UpAxis
from meshdeform.requests.document import ResolvedParams
from meshdeform.vocabulary.lookup import noun_of

__all__ = [
    "MOST_BYTES",
    "FolderReadings",
    "Readings",
    "Several",
    "Unkept",
    "given_front",
    "given_noun",
    "key_of",
    "samples_in",
]

MOST_BYTES = 64 * 2**20
"""Largest reading that is kept."""
_MOST_IN_FOLDER, _BYTES_IN_FOLDER = 1000, 256 * 2**20
_SUFFIX = ".reading"

_log = logging.getLogger(__name__)


def samples_in(cache: Path) -> Path:
    """Return the folder of samples in the folder of what can be made again."""
    return cache / "nouns"


class Readings(Protocol):
    """Where readings are kept. Neither method raises: what is not kept is read anew."""

    @property
    def samples(self) -> Path | None:
        """Folder of this machine for samples of nouns (`meshdeform.reading.banks`), if there is one."""

    def get(self, key: str) -> bytes | None:
        """Return what was kept under a key; None if there is nothing."""

    def put(self, key: str, data: bytes) -> None:
        """Keep bytes under a key, in place of what was there."""


class Unkept:
    """Keeps nothing, or only samples of nouns, in a folder."""

    def __init__(self, samples: Path | None = None) -> None:
        self.samples = samples

    def get(self, key: str) -> bytes | None:
        """Return None."""

    def put(self, key: str, data: bytes) -> None:
        """Do nothing."""


class Several:
    """Several of these: the first that has a reading counts, and all get what is new."""

    def __init__(self, *stores: Readings) -> None:
        self._stores = stores

    @property
    def samples(self) -> Path | None:
        """The folder of the first that has one."""
        return next((store.samples for store in self._stores if store.samples is not None), None)

    def get(self, key: str) -> bytes | None:
        """Return what the first has that has it, and keep it in those before."""
        for number, store in enumerate(self._stores):
            if (data := store.get(key)) is not None:
                for before in self._stores[:number]:
                    before.put(key, data)
                return data
        return None

    def put(self, key: str, data: bytes) -> None:
        """Keep bytes in all of them."""
        for store in self._stores:
            store.put(key, data)


class FolderReadings:
    """A folder of readings, which any number of processes may share; those that were used least recently go.

    `cache`: where this folder, and that of samples, are made when there is something to keep. `most` and `most_bytes`
    bound what stays.
    """

    def __init__(self, cache: Path, most: int = _MOST_IN_FOLDER, most_bytes: int = _BYTES_IN_FOLDER) -> None:
        self._folder, self._most, self._most_bytes = cache / "readings", most, most_bytes
        self.samples: Path | None = samples_in(cache)

    def get(self, key: str) -> bytes | None:
        """Return what was kept, which is the last to go now."""
        path = self._path(key)
        try:
            data = path.read_bytes()
        except OSError:
            return None
        with suppress(OSError):
            os.utime(path)
        return data

    def put(self, key: str, data: bytes) -> None:
        """Keep bytes: complete and on the disk, or not at all."""
        if len(data) > min(MOST_BYTES, self._most_bytes):
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            handle, beside = tempfile.mkstemp(dir=self._folder, prefix=".", suffix=_SUFFIX)
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(data)
                    file.flush()
                    os.fsync(file.fileno())
                Path(beside).replace(self._path(key))
            finally:
                Path(beside).unlink(missing_ok=True)
            self._make_room()
        except OSError as error:
            _log.info("a reading is not kept: %s", error)

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}{_SUFFIX}"

    def _make_room(self) -> None:
        """Remove what was used least recently, as long as there is too much; what a process left half written, too."""
        files = []
        for path in self._folder.glob(f"*{_SUFFIX}"):
            with suppress(OSError):
                state = path.stat()
                files.append((state.st_mtime_ns, state.st_size, path))
        files.sort(key=lambda file: -file[0])
        kept_bytes = 0
        for number, (_, size, path) in enumerate(files):
            kept_bytes += size
            if number >= self._most or kept_bytes > self._most_bytes:
                path.unlink(missing_ok=True)


def given_noun(params: ResolvedParams) -> str | None:
    """Return the noun that a request gives, if it is one with shapes that it stands for."""
    return None if params.source_noun is None else noun_of(params.source_noun.strip().lower())


def given_front(params: ResolvedParams) -> float | None:
    """Return the front that a request gives, in degrees from +Z toward +X; None if it is to be found.

    `keep`, the default for models that have no front, says nothing of the asset.
    """
    return float(params.orientation) if isinstance(params.orientation, int | float) else None


def key_of(digest: str, suffix: str, params: ResolvedParams, *, subdivided: bool = False) -> str:
    """Return the key of a reading: 64 hexadecimal digits.

    `digest`: SHA-256 of the asset's bytes; `suffix`: that of its name, which may decide its format; `subdivided`:
    whether its long edges were split before.
    """
    front = given_front(params)
    parts: Sequence[object] = [
        digest,
        suffix.lower(),
        list(params.exclude),
        params.backdrop,
        given_noun(params),
        None if front is None else front % 360.0,
        subdivided,
        *([sorted(params.words.items())] if params.words else []),
        *([params.up] if params.up is not UpAxis.AUTO else []),
    ]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()
