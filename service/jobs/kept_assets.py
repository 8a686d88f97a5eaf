"""Keep the assets of previews for their owners, by hash, so that each next prompt need not send the file again."""

from __future__ import annotations

import os
import secrets
import threading
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path

from meshdeform.errors import AssetNotKeptError
from service.http.forms import ReceivedFile

_MOST_BYTES, _MOST_BYTES_PER_OWNER = 2 * 2**30, 256 * 2**20


class KeptAssets:
    """Files in a folder of this process, which belong to the owners that sent them. Thread-safe.

    Those that were used least recently go: of the owner's own where these take too much, else of all.
    """

    def __init__(
        self, folder: Path, *, most_bytes: int = _MOST_BYTES, most_bytes_per_owner: int = _MOST_BYTES_PER_OWNER
    ) -> None:
        self._folder, self._most_bytes, self._most_bytes_per_owner = folder, most_bytes, most_bytes_per_owner
        self._files: OrderedDict[tuple[str, str], ReceivedFile] = OrderedDict()
        self._lock = threading.Lock()

    def keep(self, owner_id: str, file: ReceivedFile) -> bool:
        """Keep a file, which stays where it is as well; return whether it is kept: one may be too large."""
        key = (owner_id, file.sha256)
        with self._lock:
            if key in self._files:
                self._files.move_to_end(key)
                return True
            if file.size > min(self._most_bytes_per_owner, self._most_bytes):
                return False
            self._folder.mkdir(exist_ok=True)
            path = self._folder / secrets.token_hex(16)
            os.link(file.path, path)
            self._files[key] = replace(file, path=path)
            self._make_room(owner_id)
            return True

    def fetch(self, owner_id: str, sha256: str, path: Path) -> ReceivedFile:
        """Put a kept file of an owner at a path, where it stays whatever goes; AssetNotKeptError: there is none."""
        with self._lock:
            file = self._files.get((owner_id, sha256))
            if file is None:
                raise AssetNotKeptError("No asset of that hash is kept for you.")
            self._files.move_to_end((owner_id, sha256))
            os.link(file.path, path)
            return replace(file, path=path)

    def _make_room(self, owner_id: str) -> None:
        own = [key for key in self._files if key[0] == owner_id]
        while sum(self._files[key].size for key in own) > self._most_bytes_per_owner:
            self._remove(own.pop(0))
        while sum(file.size for file in self._files.values()) > self._most_bytes:
            self._remove(next(iter(self._files)))

    def _remove(self, key: tuple[str, str]) -> None:
        self._files.pop(key).path.unlink(missing_ok=True)
