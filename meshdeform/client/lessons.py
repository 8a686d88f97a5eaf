"""Post jobs of kind `prior_teach`: pack the meshes of a noun, and submit them."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast

from meshdeform.client.commands import Operation, Work
from meshdeform.client.documents import JobView
from meshdeform.client.retries import Policy
from meshdeform.client.sources import AssetLike
from meshdeform.client.submitting import Files, Order, submitted
from meshdeform.requests.choices import JobKind

__all__ = ["Meshes", "packed_meshes", "taught"]

Meshes = AssetLike | Sequence[str | os.PathLike[str]]
"""One mesh or ZIP as any asset, a folder, or several files and folders."""

_ENDINGS = frozenset({".glb", ".obj", ".ply", ".stl"})


def taught(
    noun: str,
    meshes: Meshes,
    params: Mapping[str, Any],
    metadata: Mapping[str, str] | None,
    key: str | None,
    policy: Policy,
) -> Operation[JobView]:
    """Post a lesson; see `Client.teach`."""
    source, filename = yield Work(partial(packed_meshes, meshes))
    order = Order(params={"noun": noun, **params}, metadata=metadata, kind=JobKind.PRIOR_TEACH.value)
    return (yield from submitted(order, Files.of(None, None, {"meshes": source}, filename, None, key), policy))


def packed_meshes(meshes: Meshes) -> tuple[AssetLike, str | None]:
    """Return what to send as the meshes of a lesson, with its file name if it has none of its own.

    One file is sent as it is. A folder and several files are packed into a ZIP, in which subfolders keep their names.

    Raises
    ------
    ValueError
        There is no mesh, or two files would have one name in the ZIP.
    OSError
        A file cannot be read.
    """
    if isinstance(meshes, str | os.PathLike):
        if not Path(meshes).is_dir():
            return meshes, None
        meshes = [meshes]
    elif isinstance(meshes, bytes) or not isinstance(meshes, Sequence):
        return meshes, None
    files: dict[str, Path] = {}
    for path in [Path(cast("str", each)) for each in meshes]:
        for name, file in _meshes_in(path):
            if name in files:
                raise ValueError(f"Two meshes are called {name}; rename one of them.")
            files[name] = file
    if not files:
        raise ValueError("There is no mesh to learn from: give GLB, OBJ, PLY or STL files, or folders with some.")
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, file in files.items():
            # A fixed time of change, so that the same meshes are the same file.
            archive.writestr(zipfile.ZipInfo(name), file.read_bytes(), zipfile.ZIP_DEFLATED)
    return made.getvalue(), "meshes.zip"


def _meshes_in(path: Path) -> list[tuple[str, Path]]:
    """Return the meshes of a folder by their names in it, or the file itself."""
    if not path.is_dir():
        return [(path.name, path)]
    found = sorted(file for file in path.rglob("*") if file.suffix.lower() in _ENDINGS and file.is_file())
    within = [(file.relative_to(path), file) for file in found]
    return [(name.as_posix(), file) for name, file in within if not any(part.startswith(".") for part in name.parts)]
