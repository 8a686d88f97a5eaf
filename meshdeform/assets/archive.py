"""Read a ZIP that holds one asset and the files that it refers to, in memory and within limits. Pure Python.

Nothing is extracted to disk. Names are only compared with each other, so that no path leaves the archive; sizes are
bounded by what the archive declares, and reading stops there.
"""

from __future__ import annotations

import io
import posixpath
import unicodedata
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
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

ZIP_MAGIC = b"PK\x03\x04"
MODEL_3MF = "3d/3dmodel.model"
"""What the name of the main file of a 3MF ends with, in lower case."""
_ENDINGS = (("glb", "gltf"), ("obj",), ("ply",), ("stl",))
_METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}
_ENCRYPTED, _UTF8 = 0x1, 0x800
_BROKEN = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, OSError, RuntimeError, ValueError)


class FileNames:
    """Names of files, found by links that programs and systems spell differently.

    `names`: normalised paths with forward slashes, relative to the folder of the asset's archive.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._names = dict.fromkeys(names)
        self._alike: dict[str, list[str]] = {}
        self._last: dict[str, list[str]] = {}
        for name in self._names:
            key = _key(name)
            self._alike.setdefault(key, []).append(name)
            self._last.setdefault(posixpath.basename(key), []).append(name)

    def find(self, link: str, folder: str = "") -> tuple[str, bool] | None:
        """Return the file that a link in a folder means, and whether it lies elsewhere and only its name fits.

        Letter case, composed and decomposed letters, percent signs and backslashes make no difference, unless two
        files differ in nothing else. A file elsewhere is meant if no other one has its name.
        """
        spellings = [text.replace("\\", "/") for text in dict.fromkeys((link, unquote(link)))]
        for text in spellings:
            name = posixpath.normpath(posixpath.join(folder, text))
            if name in self._names:
                return name, False
            same = self._alike.get(_key(name), [])
            if len(same) == 1:
                return same[0], False
        for text in spellings:
            same = self._last.get(posixpath.basename(_key(text)), [])
            if len(same) == 1:
                return same[0], True
        return None


def _key(name: str) -> str:
    """Return the form that all spellings of a name share."""
    return unicodedata.normalize("NFC", name).casefold()


@dataclass(frozen=True)
class Archive:
    """The files of a ZIP."""

    main: str  # name of the asset among them
    files: dict[str, bytes]  # by normalised name
    guessed: dict[str, str] = field(default_factory=dict)
    """The file that was taken for each link that leads nowhere."""

    def find(self, link: str, beside: str = "") -> bytes | None:
        """Return the file that a link of the file `beside` means, or None; see `FileNames.find`."""
        entry = self._names.find(link, posixpath.dirname(beside or self.main))
        if entry is None:
            return None
        name, elsewhere = entry
        if elsewhere:
            self.guessed[link] = name
        return self.files[name]

    def notices(self) -> tuple[str, ...]:
        """Return a sentence about links that lead nowhere."""
        if not self.guessed:
            return ()
        guesses = [f"{name} for {link[:60]!r}" for link, name in list(self.guessed.items())[:3]]
        more = " ..." if len(self.guessed) > 3 else ""
        return (f"Links lead nowhere, so files of the same name elsewhere were taken: {', '.join(guesses)}{more}.",)

    @cached_property
    def _names(self) -> FileNames:
        """Built once: a hostile file may have a hundred thousand links."""
        return FileNames(self.files)


def not_readable(names: Sequence[str]) -> str:
    """Return a sentence about pictures that cannot be read."""
    return f"Textures cannot be read, and were left out: {listed(names)}. Send PNG or JPEG."


def listed(names: Sequence[str], most: int = 3) -> str:
    """Return the first names of a sequence, with their first 60 letters, for a sentence."""
    return ", ".join(name[:60] for name in names[:most]) + (" ..." if len(names) > most else "")


def not_found(what: str, names: Sequence[str]) -> str:
    """Return a sentence about files that an asset names, and that did not come with it."""
    return f"{what} not found, and left out: {listed(names)}. Send the asset with the files that it names as one ZIP."


@contextmanager
def opened_zip(data: Data) -> Iterator[zipfile.ZipFile]:
    """Open a ZIP; AssetTruncatedError: it cannot be read."""
    try:
        with zipfile.ZipFile(io.BytesIO(bytes(data))) as archive:
            yield archive
    except _BROKEN as error:
        reason = str(error)[:200] or type(error).__name__
        raise AssetTruncatedError(
            f"The ZIP cannot be read: {reason}.", advice="Pack it again, or send the whole file."
        ) from error


def open_archive(data: Data, limits: Limits) -> Archive:
    """Read every file of a ZIP into memory."""
    with opened_zip(data) as archive:
        entries = entries_of(archive, limits)
        main = _main(list(entries))
        return Archive(main, {name: content_of(archive, entry) for name, entry in entries.items()})


def content_of(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    """Unpack as many bytes as the entry declares, and no more; its checksum then fails if there were more."""
    with archive.open(entry) as file:
        data = file.read(entry.file_size)
    if len(data) < entry.file_size:
        raise zipfile.BadZipFile(f"{entry.filename[:100]!r} is shorter than declared")
    return data


def inspect_archive(data: Data, limits: Limits) -> None:
    """Check a ZIP's directory, which has one asset, without unpacking anything."""
    with opened_zip(data) as archive:
        _main(list(entries_of(archive, limits)))


def entries_of(archive: zipfile.ZipFile, limits: Limits) -> dict[str, zipfile.ZipInfo]:
    """Return the entries to read by normalised name, after checking names, methods and sizes."""
    entries = archive.infolist()
    if len(entries) > limits.max_archive_files:
        raise AssetTooLargeError(
            f"The ZIP has {len(entries)} entries; the limit is {limits.max_archive_files}.",
            advice="Pack only the asset and the files that it needs.",
        )
    limits.check_bytes(sum(entry.file_size for entry in entries), "The ZIP unpacks to")
    by_name: dict[str, zipfile.ZipInfo] = {}
    for entry in entries:
        name = _decoded(entry).replace("\\", "/")
        if not name or name.endswith("/") or name.startswith("__MACOSX/"):
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
        if name in by_name:
            raise AssetError(
                f"The ZIP holds two files named {name[:100]!r}.",
                advice="Give each a name of its own, and pack them again.",
            )
        by_name[name] = entry
    return by_name


def _decoded(entry: zipfile.ZipInfo) -> str:
    """Return the name of an entry; Info-ZIP and macOS write UTF-8 without the flag that says so (APPNOTE, 4.4.4)."""
    if entry.flag_bits & _UTF8 or entry.filename.isascii():
        return entry.filename
    try:
        return entry.filename.encode("cp437").decode("utf-8")
    except UnicodeError:
        return entry.filename


def _main(names: list[str]) -> str:
    """Return the name of the archive's only asset; of several kinds, the one that holds the most."""
    model = next((name for name in names if name.lower().endswith(MODEL_3MF)), None)
    if model is not None:
        return model
    for endings in _ENDINGS:
        candidates = [name for name in names if name.lower().rpartition(".")[2] in endings]
        if len(candidates) > 1:
            found = listed(sorted(candidates), 5)
            raise AssetError(f"The ZIP holds {len(candidates)} assets: {found}.", advice="Send one asset per ZIP.")
        if candidates:
            return candidates[0]
    raise AssetEmptyError(
        "The ZIP holds no asset.", advice="Pack a .gltf, .glb, .obj, .ply or .stl with the files that it refers to."
    )
