"""Unpack the meshes of a lesson, and read the attributes that their folders name. Torch-free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from meshdeform.assets import Limits
from meshdeform.assets.lesson_archive import MAX_MESHES, open_lesson
from meshdeform.errors import ParameterError
from meshdeform.priors.builtin.teaching.lesson import NewNoun, attributes_of_folder
from meshdeform.priors.builtin.words import Attribute

__all__ = [
    "MAX_MESHES",
    "MeshFile",
    "check_count",
    "labelled",
    "packed_meshes",
]


@dataclass(frozen=True)
class MeshFile:
    """A file to learn from, with the attributes that its folder names."""

    name: str
    data: bytes
    attributes: tuple[Attribute, ...] = ()


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
