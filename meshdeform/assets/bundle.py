"""Pack an asset and the files beside it into one GLB, or a local asset with its files into one ZIP."""

from __future__ import annotations

import io
import json
import posixpath
import zipfile
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from meshdeform.assets.archive import Archive
from meshdeform.assets.container import GLB_MAGIC, Json, extension, index, integer, objects, text
from meshdeform.assets.document import Document
from meshdeform.assets.limits import Limits
from meshdeform.assets.materials import image_type
from meshdeform.assets.obj_reader import linked_libraries, linked_pictures
from meshdeform.assets.storage import MESHOPT_EXTENSIONS
from meshdeform.assets.writer import embed_data_uris
from meshdeform.errors import AssetExternalError, AssetTooLargeError, AssetTruncatedError

__all__ = ["pack_gltf", "read_with_files"]

_DATE = (1980, 1, 1, 0, 0, 0)


def pack_gltf(archive: Archive, limits: Limits) -> bytes:
    """Return the archive's glTF asset as a GLB that contains its buffers, and those of its images that are there.

    Raises
    ------
    AssetExternalError
        A buffer is not in the archive.
    AssetError
        The document is not valid.
    """
    data = archive.files[archive.main]
    document = Document.parse(data, limits, glb=data.startswith(GLB_MAGIC))
    _check_references(document.root)
    for i, buffer in enumerate(objects(document.root, "buffers")):
        uri = buffer.get("uri")
        if uri is None or _is_data(uri):
            continue
        found = archive.find(uri)
        if found is None:
            raise AssetExternalError(
                f"buffers[{i}] refers to a file that the ZIP does not hold: {uri[:80]!r}.", advice="Add it to the ZIP."
            )
        if len(found) < buffer["byteLength"]:
            raise AssetTruncatedError(f"buffers[{i}] has {buffer['byteLength']} bytes, but {uri[:80]!r} {len(found)}.")
        document.attach_buffer(i, found)
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
    """Check what packing reads of a document that is otherwise unchecked."""
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
    """Read a local file; a .gltf or .obj comes as a ZIP with the files beside it that it refers to.

    Files outside its folder are left out: an asset from elsewhere must not carry off other files.

    Raises
    ------
    AssetTooLargeError
        The files are larger than an asset may be.
    OSError
        The file cannot be read.
    """
    data = _read(path, limits.max_bytes)
    links = {".gltf": _gltf_links, ".obj": linked_libraries}.get(path.suffix.lower())
    files: dict[str, bytes] = {}
    for link in links(data) if links else []:
        _add(files, path.parent, link, limits)
        if link.lower().endswith(".mtl") and link in files:
            for picture in linked_pictures(files[link]):
                _add(files, path.parent, posixpath.join(posixpath.dirname(link), picture), limits)
    if not files:
        return data
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in {path.name: data, **files}.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), content)
    return packed.getvalue()


def _read(path: Path, limit: int) -> bytes:
    size = path.stat().st_size
    if size > limit:
        raise AssetTooLargeError(
            f"{path.name} has {size} bytes; the limit is {limit}.",
            advice="Raise MESHDEFORM_MAX_UPLOAD_BYTES, or use a smaller file.",
        )
    return path.read_bytes()


def _add(files: dict[str, bytes], folder: Path, link: str, limits: Limits) -> None:
    name = posixpath.normpath(link)
    path = folder / name
    if path.is_file() and path.resolve().is_relative_to(folder.resolve()):
        files[name] = _read(path, limits.max_bytes - sum(map(len, files.values())))


def _gltf_links(data: bytes) -> list[str]:
    try:
        root: Any = json.loads(data)
        items = [item for key in ("buffers", "images") for item in root.get(key, [])]
        uris = [item["uri"] for item in items if isinstance(item.get("uri"), str)]
    except (ValueError, AttributeError, TypeError, RecursionError):
        return []  # refused later, with the reason
    return [unquote(uri) for uri in uris if not _is_data(uri) and "://" not in uri]
