"""Find the meshes of a lesson: files, and folders whose subfolders are named by attributes. Torch-free."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from meshdeform.assets import Limits
from meshdeform.assets.inspect import FORMATS
from meshdeform.assets.lesson_archive import MAX_MESHES, open_lesson
from meshdeform.errors import AssetError, AssetTooLargeError, ParameterError
from meshdeform.priors.builtin.teaching.lesson import NewNoun, attributes_of_folder
from meshdeform.priors.builtin.words import Attribute

__all__ = [
    "MAX_MESHES",
    "FoundMesh",
    "MeshFile",
    "check_count",
    "find_meshes",
    "labelled",
    "packed_meshes",
    "read_meshes",
]


@dataclass(frozen=True)
class FoundMesh:
    """A file to learn from: its name in reports, where it is, and the attributes that its folder names."""

    name: str
    path: Path
    attributes: tuple[Attribute, ...] = ()


@dataclass(frozen=True)
class MeshFile:
    """A file to learn from, with the attributes that its folder names."""

    name: str
    data: bytes
    attributes: tuple[Attribute, ...] = ()


def find_meshes(paths: Sequence[Path], new: NewNoun) -> list[FoundMesh]:
    """Return the meshes among files and folders, sorted by name within a folder.

    The files that lie in a given folder have no attributes. Those in a subfolder have the attributes that its name
    says: `tall`, `long neck`. Other files, and hidden ones, are left out.

    Parameters
    ----------
    paths : sequence of Path
        Files are taken whatever they are called.
    new : NewNoun

    Raises
    ------
    ParameterError
        There is no mesh, there are more than `MAX_MESHES`, or a subfolder does not name attributes.
    """
    found: dict[Path, FoundMesh] = {}
    for path in paths:
        if not path.is_dir():
            found.setdefault(path.absolute(), FoundMesh(path.name, path))
            continue
        for folder, subfolders, names in os.walk(path):
            subfolders[:] = sorted(name for name in subfolders if not name.startswith("."))
            meshes = [name for name in sorted(names) if _is_mesh(name)]
            below = Path(folder).relative_to(path)
            attributes = attributes_of_folder(" ".join(below.parts), new) if meshes and below.parts else ()
            for name in meshes:
                file = Path(folder) / name
                found.setdefault(file.absolute(), FoundMesh((below / name).as_posix(), file, attributes))
            if len(found) > MAX_MESHES:
                break
    check_count(len(found))
    return list(found.values())


def _is_mesh(name: str) -> bool:
    return not name.startswith(".") and name.lower().rpartition(".")[2] in FORMATS


def check_count(count: int) -> None:
    """Refuse a lesson without meshes or with too many.

    Raises
    ------
    ParameterError
        There are none, or more than `MAX_MESHES`.
    """
    if not count:
        raise ParameterError("There is no mesh to learn from.", advice="Give at least one GLB, OBJ, PLY, STL or ZIP.")
    if count > MAX_MESHES:
        raise ParameterError(
            f"There are more than {MAX_MESHES} meshes, and a lesson takes at most {MAX_MESHES}.",
            advice="Choose those that show the variety: ten good ones are enough for most things.",
        )


def read_meshes(found: Sequence[FoundMesh], limits: Limits) -> list[MeshFile]:
    """Read the meshes; a .gltf or .obj comes with the files that it refers to.

    Raises
    ------
    AssetError
        A file cannot be read.
    AssetTooLargeError
        All files together are larger than an asset may be.
    """
    from meshdeform.assets.bundle import read_with_files  # needs numpy, which the API has no use for

    files: list[MeshFile] = []
    total = 0
    for mesh in found:
        try:
            data = read_with_files(mesh.path, limits)
        except OSError as error:
            raise AssetError(f"{mesh.name} cannot be read: {error.strerror}.") from error
        total += len(data)
        if total > limits.max_bytes:
            raise AssetTooLargeError(
                f"The meshes have more than {limits.max_bytes:,} bytes together (MESHDEFORM_MAX_UPLOAD_BYTES).",
                advice="Give fewer or smaller ones: a model learns from pictures of 64 by 64 pixels.",
            )
        files.append(MeshFile(mesh.name, data, mesh.attributes))
    return files


def packed_meshes(data: bytes, filename: str, new: NewNoun, limits: Limits) -> list[MeshFile]:
    """Unpack the meshes of a lesson: one file, or a ZIP with folders that are named by attributes.

    Raises
    ------
    AssetError
        The ZIP cannot be used; see `open_lesson`.
    ParameterError
        A folder does not name attributes.
    """
    files = open_lesson(data, filename, limits)
    labels = labelled(list(files), new)
    return [MeshFile(name, content, labels[name]) for name, content in files.items()]


def labelled(names: Sequence[str], new: NewNoun) -> dict[str, tuple[Attribute, ...]]:
    """Return the attributes of meshes in a ZIP by name, from the names of their folders.

    A folder that holds everything is usually the one that was packed: unless it names attributes, its name is left out.

    Raises
    ------
    ParameterError
        A folder does not name attributes.
    """
    folders = {name: name.split("/")[:-1] for name in names}
    first = {tuple(folder[:1]) for folder in folders.values()}
    if len(first) == 1 and (outer := first.pop()) and not _is_label(outer[0], new):
        folders = {name: folder[1:] for name, folder in folders.items()}
    return {name: attributes_of_folder(" ".join(folder), new) if folder else () for name, folder in folders.items()}


def _is_label(folder: str, new: NewNoun) -> bool:
    try:
        attributes_of_folder(folder, new)
    except ParameterError:
        return False
    return True
