"""Decode Draco-compressed primitives (KHR_draco_mesh_compression) into plain accessors.

Source: the extension's specification (Khronos, ratified), sections "Conformance" and "Restrictions on geometry type".
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import DTYPES, refresh_bounds
from meshdeform.assets.decoded import restore_exactness
from meshdeform.assets.document import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Document
from meshdeform.assets.json_text import Json
from meshdeform.assets.scenegraph import DRACO, TRIANGLE_STRIP, TRIANGLES, instances_of
from meshdeform.assets.storage import TYPE_COMPONENTS, UNSIGNED_INT
from meshdeform.errors import AssetError, AssetUnsupportedError, DependencyError

__all__ = ["decode_draco", "drop_extension"]

_ADVICE = "Decompress it: gltf-transform copy in.glb out.glb"


def decode_draco(document: Document) -> None:
    """Replace the Draco streams of the default scene's triangle primitives with plain data, in place.

    Accessors keep their indices and counts and gain the decoded data; bounds are recomputed. The extension is removed
    from these primitives, and from the document once no primitive uses it.

    Raises
    ------
    AssetError
        A stream is broken or does not match its accessors.
    DependencyError
        DracoPy is not installed.
    """
    meshes = document.root.get("meshes", [])
    for mesh in sorted({instance.mesh for instance in instances_of(document.root)}):
        for p, primitive in enumerate(meshes[mesh].get("primitives", [])):
            if DRACO in primitive.get("extensions", {}) and primitive.get("mode", TRIANGLES) >= TRIANGLES:
                _decode_primitive(document, primitive, f"meshes[{mesh}].primitives[{p}]")
    left = any(DRACO in primitive.get("extensions", {}) for mesh in meshes for primitive in mesh.get("primitives", []))
    if not left:
        drop_extension(document.root, DRACO)


def drop_extension(root: Json, name: str) -> None:
    """Remove a name from `extensionsUsed` and `extensionsRequired`, and remove a list that becomes empty."""
    for key in ("extensionsUsed", "extensionsRequired"):
        if name in root.get(key, []):
            root[key] = [other for other in root[key] if other != name]
            if not root[key]:
                del root[key]


def _decode_primitive(document: Document, primitive: Json, where: str) -> None:
    draco = primitive["extensions"].pop(DRACO)
    if not primitive["extensions"]:
        del primitive["extensions"]
    accessors, attributes = document.root["accessors"], primitive.get("attributes", {})
    needed = [attributes[name] for name in draco.get("attributes", {}) if name in attributes]
    if "indices" in primitive:
        needed.append(primitive["indices"])
    if "indices" in primitive and all("bufferView" in accessors[at] for at in needed):
        return  # the file also contains the plain data
    stream = _decode_stream(bytes(document.view_bytes(draco["bufferView"])), where)
    rows = {
        name: _attribute_rows(stream, unique_id, accessors[attributes[name]], f"{where}: {name}")
        for name, unique_id in draco.get("attributes", {}).items()
        if name in attributes
    }
    for name, values in restore_exactness(rows).items():
        at = _fillable(document, attributes[name])
        accessors[at]["bufferView"] = _append_vertex_rows(document, values, accessors[at])
        refresh_bounds(document, at)
        attributes[name] = at
    _write_indices(document, primitive, np.asarray(stream.faces).reshape(-1), where)


def _decode_stream(data: bytes, where: str) -> Any:
    try:
        import DracoPy
    except ImportError as error:
        raise DependencyError("The asset is compressed with Draco, and DracoPy is not installed.") from error
    try:
        stream = DracoPy.decode(data)
    except Exception as error:  # DracoPy raises ValueError, and classes that derive directly from Exception
        raise AssetError(f"{where}: the Draco stream cannot be decoded: {error}.") from error
    if getattr(stream, "faces", None) is None:
        raise AssetError(f"{where}: the Draco stream holds no triangles.")
    return stream


def _fillable(document: Document, accessor: int) -> int:
    """Return the accessor itself if it has no data yet, else a copy of it without data."""
    accessors = document.root["accessors"]
    if not {"bufferView", "sparse"} & accessors[accessor].keys():
        return accessor
    accessors.append({key: value for key, value in accessors[accessor].items() if key not in _DATA_KEYS})
    return len(accessors) - 1


_DATA_KEYS = {"bufferView", "byteOffset", "sparse"}


def _attribute_rows(stream: Any, unique_id: int, accessor: Json, where: str) -> NDArray[Any]:
    found = next((item for item in stream.attributes if item["unique_id"] == unique_id), None)
    if found is None or not isinstance(found.get("data"), np.ndarray):
        raise AssetUnsupportedError(f"{where}: the Draco stream has no attribute {unique_id}.", advice=_ADVICE)
    rows = found["data"]
    dtype = np.dtype(DTYPES[accessor["componentType"]])
    if rows.shape != (accessor["count"], TYPE_COMPONENTS[accessor["type"]]):
        raise AssetError(
            f"{where}: the Draco stream holds {rows.shape}, but the accessor {accessor['count']} {accessor['type']}."
        )
    if (rows.dtype.kind == "f") != (dtype.kind == "f"):
        raise AssetUnsupportedError(f"{where}: the Draco stream holds {rows.dtype}, not {dtype}.", advice=_ADVICE)
    return np.asarray(rows.astype(dtype))


def _append_vertex_rows(document: Document, rows: NDArray[Any], accessor: Json) -> int:
    """Append vertex data, with rows padded to four bytes as glTF requires of vertex attributes."""
    size = rows.dtype.itemsize * rows.shape[1]
    padded = np.zeros((len(rows), size + -size % 4), np.uint8)
    padded[:, :size] = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), size)
    view = document.append_view(padded.tobytes(), ARRAY_BUFFER)
    accessor.pop("byteOffset", None)
    if size % 4:
        document.root["bufferViews"][view]["byteStride"] = padded.shape[1]
    return view


def _write_indices(document: Document, primitive: Json, corners: NDArray[Any], where: str) -> None:
    accessors = document.root["accessors"]
    count = accessors[primitive["attributes"]["POSITION"]]["count"] if "POSITION" in primitive["attributes"] else 0
    if len(corners) and corners.max() >= max(count, 1):
        raise AssetError(f"{where}: the Draco stream uses vertex {corners.max()}, but there are only {count}.")
    strip = primitive.get("mode", TRIANGLES) == TRIANGLE_STRIP
    if "indices" in primitive and not strip:
        at = _fillable(document, primitive["indices"])
        if accessors[at]["count"] != len(corners):
            raise AssetError(f"{where}: the Draco stream has {len(corners)} indices, not {accessors[at]['count']}.")
    else:  # the stream always holds a triangle list, even for a strip
        accessors.append({"componentType": UNSIGNED_INT, "count": len(corners), "type": "SCALAR"})
        at = len(accessors) - 1
        primitive["mode"] = TRIANGLES
    dtype = DTYPES[accessors[at]["componentType"]]
    accessors[at]["bufferView"] = document.append_view(corners.astype(dtype).tobytes(), ELEMENT_ARRAY_BUFFER)
    refresh_bounds(document, at)  # encoders may reorder or remove vertices and leave the old maximum
    primitive["indices"] = at
