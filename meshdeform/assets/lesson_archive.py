"""Read the meshes of a lesson: one asset, or a ZIP of many in folders, in memory and within limits. No numpy.

Each mesh in a ZIP is one file that needs no others: a GLB, or an OBJ, PLY or STL. Nothing is extracted to disk.
"""

from __future__ import annotations

import io
import posixpath
import zipfile

from meshdeform.assets.archive import _BROKEN, ZIP_MAGIC, _content, _entries
from meshdeform.assets.container import Data
from meshdeform.assets.inspect import AssetSummary, inspect_asset
from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetEmptyError, AssetError, AssetTooLargeError, AssetTruncatedError

MAX_MESHES = 200
"""Most meshes of a lesson."""
MIN_FACES = 4
"""Fewest faces of a shape to learn from."""
_ENDINGS = ("glb", "obj", "ply", "stl")
_ADVICE = f"Pack 1 to {MAX_MESHES} files of the types {', '.join(_ENDINGS)}, each whole by itself."


def is_archive(data: Data) -> bool:
    """Return whether a file is a ZIP; any other file is one mesh."""
    return bytes(data[: len(ZIP_MAGIC)]) == ZIP_MAGIC or bytes(data[:4]) == b"PK\x05\x06"


def open_lesson(data: Data, filename: str, limits: Limits) -> dict[str, bytes]:
    """Return the meshes by name in the ZIP, sorted; a file that is no ZIP is the only one, by its own name."""
    if not is_archive(data):
        return {posixpath.basename(filename.replace("\\", "/")) or "mesh": bytes(data)}
    try:
        with zipfile.ZipFile(io.BytesIO(bytes(data))) as archive:
            entries = _entries(archive, limits)
            return {name: _content(archive, entries[name]) for name in _meshes_of(list(entries))}
    except _BROKEN as error:
        raise AssetTruncatedError(
            f"The ZIP cannot be read: {str(error)[:200]}.", advice="Pack it again, or send the whole file."
        ) from error


def inspect_lesson(data: Data, limits: Limits) -> AssetSummary:
    """Check a ZIP of meshes and the structure of each; the summary's `meshes` counts them, `mesh_names` names them."""
    vertices = triangles = 0
    files = open_lesson(data, "", limits)
    for name, content in files.items():
        try:
            summary = inspect_asset(content, name, limits)
        except AssetError as error:
            raise type(error)(f"{name}: {error.detail}", advice=error.advice_text, **error.extra) from error
        # Polygons of other formats count as one here; the run counts their triangles.
        if summary.triangles < (MIN_FACES if summary.format == "glb" else 2):
            raise AssetEmptyError(
                f"{name}: {summary.triangles} faces are too few; a shape to learn from has at least {MIN_FACES}.",
                advice="Export the whole object as a mesh.",
            )
        vertices, triangles = vertices + summary.vertices, triangles + summary.triangles
    names = tuple({"index": index, "name": name} for index, name in enumerate(files))
    return AssetSummary("zip", vertices, triangles, meshes=len(files), mesh_names=names)


def _meshes_of(names: list[str]) -> list[str]:
    meshes = sorted(
        name
        for name in names
        if name.lower().rpartition(".")[2] in _ENDINGS and not any(part.startswith(".") for part in name.split("/"))
    )
    if not meshes:
        raise AssetEmptyError("The ZIP holds no mesh.", advice=_ADVICE)
    if len(meshes) > MAX_MESHES:
        raise AssetTooLargeError(
            f"The ZIP holds {len(meshes)} meshes; a lesson takes at most {MAX_MESHES}.", advice=_ADVICE
        )
    return meshes
