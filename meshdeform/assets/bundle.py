"""Pack an asset and the files beside it into one GLB, or a local asset with its files into one ZIP."""

from __future__ import annotations

import io
import json
import os
import posixpath
import zipfile
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from meshdeform.assets import ply_reader
from meshdeform.assets.archive import Archive, FileNames
from meshdeform.assets.codes import MESHOPT_EXTENSIONS
from meshdeform.assets.container import GLB_MAGIC, Json, extension, index, integer, objects, text
from meshdeform.assets.document import Document
from meshdeform.assets.limits import Limits
from meshdeform.assets.materials import image_type
from meshdeform.assets.mtl_reader import linked_pictures
from meshdeform.assets.obj_reader import linked_libraries
from meshdeform.assets.writer import embed_data_uris
from meshdeform.errors import AssetExternalError, AssetTooLargeError, AssetTruncatedError

_DATE = (1980, 1, 1, 0, 0, 0)
_DEPTH, _MOST_NAMES = 3, 5_000
"""How deep below an asset files are looked for that lie elsewhere than it says, and among how many."""


def pack_gltf(archive: Archive, limits: Limits) -> bytes:
    """Return the archive's glTF asset as a GLB that contains its buffers, and those of its images that are there."""
    data = archive.files[archive.main]
    document = Document.parse(data, limits, glb=data.startswith(GLB_MAGIC))
    _check_references(document.root)
    for i, buffer in enumerate(objects(document.root, "buffers")):
        uri = buffer.get("uri")
        if uri is None or _is_data(uri):
            continue
        content = archive.find(uri)
        if content is None:
            raise AssetExternalError(
                f"buffers[{i}] refers to a file that the ZIP does not hold: {uri[:80]!r}.", advice="Add it to the ZIP."
            )
        if len(content) < buffer["byteLength"]:
            raise AssetTruncatedError(
                f"buffers[{i}] has {buffer['byteLength']} bytes, but {uri[:80]!r} {len(content)}."
            )
        document.attach_buffer(i, content)
    for image in objects(document.root, "images"):
        uri = image.get("uri", "data:")
        pixels = None if _is_data(uri) else archive.find(uri)
        kind = image_type(pixels) if pixels else ""
        if pixels and kind:
            del image["uri"]
            image.setdefault("name", posixpath.splitext(posixpath.basename(unquote(uri)))[0])
            image |= {"bufferView": document.append_view(pixels), "mimeType": kind}
    embed_data_uris(document)
    return document.to_bytes()


def _is_data(uri: str) -> bool:
    return uri[:5].lower() == "data:"


def _check_references(root: Json) -> None:
    """Check the members of an otherwise unchecked document that packing reads."""
    buffers = objects(root, "buffers")
    for i, buffer in enumerate(buffers):
        integer(buffer, "byteLength", f"buffers[{i}]", minimum=1)
        text(buffer, "uri", f"buffers[{i}]")
        extension(buffer, MESHOPT_EXTENSIONS[0], f"buffers[{i}]")
    for i, view in enumerate(objects(root, "bufferViews")):
        holders = [view, *(extension(view, name, f"bufferViews[{i}]") for name in MESHOPT_EXTENSIONS)]
        for holder in filter(None, holders):
            if index(holder, "buffer", len(buffers), f"bufferViews[{i}]") is None:
                raise AssetTruncatedError(f"bufferViews[{i}].buffer is missing.")
            integer(holder, "byteOffset", f"bufferViews[{i}]", default=0)
    for i, image in enumerate(objects(root, "images")):
        text(image, "uri", f"images[{i}]")


def read_with_files(path: Path, limits: Limits) -> bytes:
    """Read a local file; a .gltf, .obj or .ply comes as a ZIP with the files beside it that it refers to.

    Files outside its folder are left out: an asset from elsewhere must not carry off other files.
    """
    data = _read(path, limits.max_bytes)
    links = {".gltf": _gltf_links, ".obj": linked_libraries, ".ply": ply_reader.linked_pictures}
    folder = _Folder(path.parent, limits.max_bytes)
    for link in links[path.suffix.lower()](data) if path.suffix.lower() in links else []:
        name = folder.add(link)
        if name and name.lower().endswith(".mtl"):
            for picture in linked_pictures(folder.files[name]):
                folder.add(picture, posixpath.dirname(name))
    if not folder.files:
        return data
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in {path.name: data, **folder.files}.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), content)
    return packed.getvalue()


class _Folder:
    """Reads files in and below a folder that an asset links to, and keeps them by their path from it."""

    def __init__(self, folder: Path, max_bytes: int) -> None:
        self._folder, self._left = folder, max_bytes
        self.files: dict[str, bytes] = {}

    def add(self, link: str, beside: str = "") -> str | None:
        """Read the file that a link in the folder `beside` means, and return its name; None if there is none."""
        name = posixpath.normpath(posixpath.join(beside, link))
        if not self._is_inside(name):
            entry = self._names.find(link, beside)
            if entry is None or not self._is_inside(entry[0]):
                return None
            name = entry[0]
        if name not in self.files:
            self.files[name] = _read(self._folder / name, self._left)
            self._left -= len(self.files[name])
        return name

    def _is_inside(self, name: str) -> bool:
        path = self._folder / name
        return path.is_file() and path.resolve().is_relative_to(self._folder.resolve())

    @cached_property
    def _names(self) -> FileNames:
        """The files of the folder and, unless there are too many, of those below it."""
        names: list[str] = []
        own = 0
        for root, folders, files in os.walk(self._folder):
            above = Path(root).relative_to(self._folder)
            folders[:] = [] if len(above.parts) >= _DEPTH else [name for name in folders if not name.startswith(".")]
            names += [(above / name).as_posix() for name in files]
            own = own or len(names)
            if len(names) > _MOST_NAMES:
                return FileNames(names[:own])
        return FileNames(names)


def _read(path: Path, limit: int) -> bytes:
    if path.stat().st_size > limit:
        raise AssetTooLargeError.more_than(limit, f"{path.name} has")
    return path.read_bytes()


def _gltf_links(data: bytes) -> list[str]:
    try:
        root: Any = json.loads(data)
        items = [item for key in ("buffers", "images") for item in root.get(key, [])]
        uris = [item["uri"] for item in items if isinstance(item.get("uri"), str)]
    except (ValueError, AttributeError, TypeError, RecursionError):
        return []  # refused later, with the reason
    return [unquote(uri) for uri in uris if not _is_data(uri) and "://" not in uri]
