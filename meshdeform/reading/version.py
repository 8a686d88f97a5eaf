"""Tell readings apart that different code has made.

The version is a digest of the sources of whatever a reading comes from, so that nobody has to remember to change it.
A change of words alone changes it as well, and costs that assets are read once more.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from importlib.resources import files
from importlib.resources.abc import Traversable

__all__ = ["MEMBERS_VERSION", "SOURCES", "VERSION"]

_OF_MEMBERS = ("nouns", "vocabulary", "words")
SOURCES = ("reading", *_OF_MEMBERS)
"""Folders and modules of the package on which readings depend."""


def _texts(place: Traversable, name: str) -> dict[str, bytes]:
    """Return the sources below a folder, or that of a module, by their names."""
    if place.is_file():
        return {name: place.read_bytes()} if name.endswith((".py", ".txt", ".npz")) else {}
    return {path: text for inner in place.iterdir() for path, text in _texts(inner, f"{name}/{inner.name}").items()}


def _version(sources: Iterable[str]) -> str:
    root, digest = files("meshdeform"), hashlib.sha256()
    texts = {path: text for name in sources for path, text in _texts(root.joinpath(name), name).items()}
    for path in sorted(texts):
        digest.update(f"{path}\n".encode() + texts[path].replace(b"\r\n", b"\n") + b"\0")
    return digest.hexdigest()[:16]


VERSION: str = _version(SOURCES)
"""Changes whenever the same asset may be read otherwise: 16 hexadecimal digits."""
MEMBERS_VERSION: str = _version(("reading/banks.py", "reading/samples.py", *_OF_MEMBERS))
"""Changes whenever the samples of a noun's members may be others."""
