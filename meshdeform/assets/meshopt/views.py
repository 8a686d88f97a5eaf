"""Decode the buffer views of a document that exist only in compressed form.

A view whose buffer has real data is read directly, as core glTF specifies. Views into a placeholder buffer are decoded
and appended; the placeholders and the extension are removed.
"""

from __future__ import annotations

from meshdeform.assets.accessors import refresh_bounds
from meshdeform.assets.decoded import normalize_weights
from meshdeform.assets.document import Document
from meshdeform.assets.draco import drop_extension
from meshdeform.assets.embed import remove_buffers
from meshdeform.assets.json_text import Json
from meshdeform.assets.meshopt.attributes import decode_attributes
from meshdeform.assets.meshopt.filters import apply_filter
from meshdeform.assets.meshopt.indices import decode_indices, decode_triangles
from meshdeform.assets.storage import MESHOPT_EXTENSIONS, CompressedView, compressed_view, is_placeholder
from meshdeform.errors import AssetError

__all__ = ["decode_meshopt", "decode_view"]


def decode_view(data: bytes, view: CompressedView) -> bytes:
    """Decode one compressed view.

    Raises
    ------
    AssetError
        The stream is not valid.
    """
    if view.mode == "ATTRIBUTES":
        return apply_filter(view.filter, decode_attributes(data, view.count, view.stride)).tobytes()
    decode = decode_triangles if view.mode == "TRIANGLES" else decode_indices
    return decode(data, view.count).astype("<u2" if view.stride == 2 else "<u4").tobytes()


def decode_meshopt(document: Document) -> None:
    """Decode in place every view that has no uncompressed data."""
    root = document.root
    if not any(name in root.get("extensionsUsed", []) for name in MESHOPT_EXTENSIONS) and not _mentions(root):
        return
    placeholders = {i for i in range(len(root.get("buffers", []))) if is_placeholder(root, i, document.binary_length)}
    filtered = set()
    for i, view in enumerate(root.get("bufferViews", [])):
        if view["buffer"] in placeholders and _decode_in_place(document, i, view) != "NONE":
            filtered.add(i)
    for i, accessor in enumerate(root.get("accessors", [])):
        if accessor.get("bufferView") in filtered:
            refresh_bounds(document, i)
    normalize_weights(document, filtered)
    for buffer in placeholders:
        _drop(root["buffers"][buffer])
    remove_buffers(document, placeholders - {0})
    for name in MESHOPT_EXTENSIONS:
        if not any(name in item.get("extensions", {}) for item in root.get("bufferViews", [])):
            drop_extension(root, name)


def _mentions(root: Json) -> bool:
    return any(
        name in view.get("extensions", {}) for view in root.get("bufferViews", []) for name in MESHOPT_EXTENSIONS
    )


def _decode_in_place(document: Document, i: int, view: Json) -> str:
    """Decode one view in place and return the name of its filter, which is lossy."""
    found = compressed_view(document.root, i)
    assert found is not None  # checked before: every view into a placeholder is compressed
    name, compressed = found
    start = compressed.offset
    data = bytes(document.buffer_bytes(compressed.buffer)[start : start + compressed.length])
    try:
        plain = decode_view(data, compressed)
    except AssetError as error:
        raise AssetError(f"bufferViews[{i}]: {error.detail}", advice=error.advice_text) from error
    view["buffer"], view["byteOffset"] = 0, document.append_bytes(plain)
    _drop(view, name)
    return compressed.filter


def _drop(holder: Json, *names: str) -> None:
    extensions = holder.get("extensions")
    for name in names or MESHOPT_EXTENSIONS:
        if isinstance(extensions, dict) and name in extensions:
            del extensions[name]
    if extensions == {}:
        del holder["extensions"]
