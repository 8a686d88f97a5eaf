"""Read a ZIP that holds one asset and the files that it refers to, in memory and within limits. Pure Python.

Nothing is extracted to disk. Names are only compared with each other, so that no path leaves the archive; sizes are
bounded by what the archive declares, and reading stops there.
"""

from __future__ import annotations

import io
import posixpath
import zipfile
import zlib
from dataclasses import dataclass
from functools import cached_property
from urllib.parse import unquote

from meshdeform.assets.container import Data
from meshdeform.assets.limits import Limits
from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetTooLargeError,
    AssetTruncatedError,
    AssetUnsupportedError,
)

__all__ = ["ZIP_MAGIC", "Archive", "inspect_archive", "open_archive"]

ZIP_MAGIC = b"PK\x03\x04"
_ENDINGS = (("glb", "gltf"), ("obj",), ("ply",), ("stl",))
_METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}
_ENCRYPTED = 1
_BROKEN = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, OSError, RuntimeError, ValueError)


@dataclass(frozen=True)
class Archive:
    """The files of a ZIP.

    Attributes
    ----------
    main : str
        Name of the asset among them.
    files : dict of str to bytes
        By normalised name.
    """

    main: str
    files: dict[str, bytes]

    def find(self, link: str, beside: str = "") -> bytes | None:
        """Return the file that a link of the file `beside` means, or None; letter case counts only if it decides."""
        folder = posixpath.dirname(beside or self.main)
        for text in (link, unquote(link)):
            name = posixpath.normpath(posixpath.join(folder, text.replace("\\", "/")))
            if name in self.files:
                return self.files[name]
            same = self._spellings.get(name.lower(), [])
            if len(same) == 1:
                return self.files[same[0]]
        return None

    @cached_property
    def _spellings(self) -> dict[str, list[str]]:
        """The names of the files by themselves in lower case: a hostile file may have a hundred thousand links."""
        found: dict[str, list[str]] = {}
        for name in self.files:
            found.setdefault(name.lower(), []).append(name)
        return found


def open_archive(data: Data, limits: Limits) -> Archive:
    """Read every file of a ZIP into memory.

    Raises
    ------
    AssetTooLargeError
        It has too many files, or they are too large when unpacked.
    AssetUnsupportedError
        It is encrypted, or compressed by another method than Deflate.
    AssetEmptyError
        It holds no asset.
    AssetError
        It is broken, holds several assets, or names files outside itself.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(bytes(data))) as archive:
            entries = _entries(archive, limits)
            main = _main(list(entries))
            return Archive(main, {name: _content(archive, entry) for name, entry in entries.items()})
    except _BROKEN as error:
        reason = str(error)[:200] or type(error).__name__
        raise AssetTruncatedError(
            f"The ZIP cannot be read: {reason}.", advice="Pack it again, or send the whole file."
        ) from error


def _content(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    """Unpack as many bytes as the entry declares, and no more; its checksum then fails if there were more."""
    with archive.open(entry) as file:
        data = file.read(entry.file_size)
    if len(data) < entry.file_size:
        raise zipfile.BadZipFile(f"{entry.filename[:100]!r} is shorter than declared")
    return data


def inspect_archive(data: Data, limits: Limits) -> str:
    """Check a ZIP's directory without unpacking anything, and return the name of its asset."""
    try:
        with zipfile.ZipFile(io.BytesIO(bytes(data))) as archive:
            return _main(list(_entries(archive, limits)))
    except _BROKEN as error:
        raise AssetTruncatedError(
            f"The ZIP cannot be read: {str(error)[:200]}.", advice="Pack it again, or send the whole file."
        ) from error


def _entries(archive: zipfile.ZipFile, limits: Limits) -> dict[str, zipfile.ZipInfo]:
    """Return the entries to read by normalised name, after checking names, methods and sizes."""
    entries = archive.infolist()
    if len(entries) > limits.max_archive_files:
        raise AssetTooLargeError(
            f"The ZIP has {len(entries)} entries; the limit is {limits.max_archive_files}.",
            advice="Pack only the asset and the files that it needs.",
        )
    total = sum(entry.file_size for entry in entries)
    if total > limits.max_bytes:
        raise AssetTooLargeError(
            f"The ZIP unpacks to {total} bytes; the limit is {limits.max_bytes} (MESHDEFORM_MAX_UPLOAD_BYTES)."
        )
    found: dict[str, zipfile.ZipInfo] = {}
    for entry in entries:
        name = entry.filename.replace("\\", "/")
        if entry.is_dir() or name.startswith("__MACOSX/"):
            continue
        if name.startswith("/") or ":" in name.split("/")[0] or ".." in name.split("/"):
            raise AssetError(f"The ZIP names a file outside itself: {name[:100]!r}.", advice="Pack it again.")
        if any(ord(letter) < 32 or 127 <= ord(letter) < 160 for letter in name):  # a terminal would obey them
            raise AssetError(
                f"The ZIP has a name with control characters: {name[:100]!r}.",
                advice="Rename the file, and pack it again.",
            )
        if entry.flag_bits & _ENCRYPTED:
            raise AssetUnsupportedError("The ZIP is encrypted.", advice="Pack it without a password.")
        if entry.compress_type not in _METHODS:
            raise AssetUnsupportedError(
                f"The ZIP compresses {name[:100]!r} by a method other than Deflate.", advice="Pack it with Deflate."
            )
        name = posixpath.normpath(name)
        if name in found:
            raise AssetError(
                f"The ZIP holds two files named {name[:100]!r}.",
                advice="Give each a name of its own, and pack them again.",
            )
        found[name] = entry
    return found


def _main(names: list[str]) -> str:
    """Return the name of the archive's only asset; of several kinds, the one that holds the most."""
    for endings in _ENDINGS:
        found = [name for name in names if name.lower().rpartition(".")[2] in endings]
        if len(found) > 1:
            listed = ", ".join(sorted(found)[:5]) + (" ..." if len(found) > 5 else "")
            raise AssetError(f"The ZIP holds {len(found)} assets: {listed}.", advice="Send one asset per ZIP.")
        if found:
            return found[0]
    raise AssetEmptyError(
        "The ZIP holds no asset.", advice="Pack a .gltf, .glb, .obj, .ply or .stl with the files that it refers to."
    )
