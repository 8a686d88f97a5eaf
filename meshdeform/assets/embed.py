"""Move data URIs into the binary chunk of the GLB that is written, where viewers expect them.

glTF JSON keeps buffers and images as base64 text. In a GLB that costs a third more bytes, and validators warn about it.
"""

from __future__ import annotations

from meshdeform.assets.document import Document, decode_data_uri
from meshdeform.assets.json_text import Json
from meshdeform.assets.materials import image_type
from meshdeform.assets.storage import MESHOPT_EXTENSIONS
from meshdeform.errors import AssetError

__all__ = ["embed_data_uris", "remove_buffers"]


def embed_data_uris(document: Document) -> None:
    """Store the buffers and images with data URIs in the binary chunk, in place; broken or unknown images stay."""
    for image in document.root.get("images", []):
        _embed_image(document, image)
    buffers = document.root.get("buffers", [])
    moved = {
        i: document.append_bytes(bytes(document.buffer_bytes(i)[: buffer["byteLength"]]))
        for i, buffer in enumerate(buffers)
        if "uri" in buffer and i > 0 and not any(name in buffer.get("extensions", {}) for name in MESHOPT_EXTENSIONS)
    }
    if buffers and "uri" in buffers[0]:
        document.append_bytes(b"")  # makes buffer 0 the binary chunk
    for holder in _holders(document.root):
        if holder["buffer"] in moved:
            holder["byteOffset"] = holder.get("byteOffset", 0) + moved[holder["buffer"]]
            holder["buffer"] = 0
    remove_buffers(document, set(moved))


def _embed_image(document: Document, image: Json) -> None:
    uri = image.get("uri", "")
    if uri[:5].lower() != "data:":
        return
    try:
        data = decode_data_uri(uri, "an image")
    except AssetError:
        return
    kind = image_type(data) or uri[5:].partition(",")[0].partition(";")[0].lower()
    if kind.startswith("image/") and data:
        del image["uri"]
        image |= {"bufferView": document.append_view(data), "mimeType": kind}


def remove_buffers(document: Document, gone: set[int]) -> None:
    """Remove unreferenced buffers and renumber the others."""
    if not gone:
        return
    root = document.root
    kept = [i for i in range(len(root["buffers"])) if i not in gone]
    number = {old: new for new, old in enumerate(kept)}
    root["buffers"] = [root["buffers"][i] for i in kept]
    for holder in _holders(root):
        holder["buffer"] = number[holder["buffer"]]
    document.renumber_buffers(number)


def _holders(root: Json) -> list[Json]:
    """Return every object that refers to a buffer: buffer views and their compression extensions."""
    views = list(root.get("bufferViews", []))
    extensions = [
        view["extensions"][name] for view in views for name in MESHOPT_EXTENSIONS if name in view.get("extensions", {})
    ]
    return views + extensions
