"""Tell results apart that different code has made, by digests of the sources, so that nobody has to number them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable

from meshdeform import __version__

__all__ = ["build", "digest_of"]


def digest_of(sources: Iterable[str]) -> str:
    """Return a digest of folders and modules of the package, and of the data beside them: 16 hexadecimal digits."""
    root, digest = files("meshdeform"), hashlib.sha256()
    texts = {path: text for name in sources for path, text in _texts(root.joinpath(name), name).items()}
    for path in sorted(texts):
        digest.update(f"{path}\n".encode() + texts[path].replace(b"\r\n", b"\n") + b"\0")
    return digest.hexdigest()[:16]


@cache
def build() -> str:
    """Return the version with the first digits of a digest of the whole package, as PEP 440 writes a local version."""
    return f"{__version__}+{digest_of([''])[:8]}"


def _texts(node: Traversable, name: str) -> dict[str, bytes]:
    """Return the sources below a folder, or that of a module, by their names."""
    if node.is_file():
        return {name: node.read_bytes()} if name.endswith((".py", ".txt", ".npz")) else {}
    return {path: text for inner in node.iterdir() for path, text in _texts(inner, f"{name}/{inner.name}").items()}
