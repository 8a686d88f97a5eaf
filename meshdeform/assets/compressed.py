"""Decode compressed data into plain accessors: Draco's primitives and meshopt's buffer views.

A view of meshopt whose buffer has real data is read directly, as core glTF specifies. Views into a placeholder buffer
are decoded and appended; the placeholders and the extension are removed. Lossy decoding loses exact sums and lengths
that glTF requires of attributes; they are restored.

Sources: the specification of KHR_draco_mesh_compression (Khronos, ratified), sections "Conformance" and "Restrictions
on geometry type"; glTF 2.0, sections 3.7.2.1 (tangents) and 3.7.3.3 (skinned mesh attributes).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import DTYPES, read_floats, refresh_bounds
from meshdeform.assets.codes import (
    DRACO,
    FLOAT,
    MESHOPT_EXTENSIONS,
    TRIANGLE_STRIP,
    TRIANGLES,
    TYPE_COMPONENTS,
    UNSIGNED_INT,
)
from meshdeform.assets.container import Json
from meshdeform.assets.document import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Document
from meshdeform.assets.meshopt import apply_filter, decode_attributes, decode_indices, decode_triangles
from meshdeform.assets.scene_checks import instances_of
from meshdeform.assets.storage_checks import CompressedView, compressed_view, is_placeholder
from meshdeform.errors import AssetError, AssetUnsupportedError, DependencyError

_INTEGERS = range(1, 9)
"""Draco's `DataType` of integers: DT_INT8 to DT_UINT64."""
_ADVICE = "Decompress it: gltf-transform copy in.glb out.glb"
_DATA_KEYS = {"bufferView", "byteOffset", "sparse"}
_WEIGHTS = "WEIGHTS_"


def decode_draco(document: Document) -> None:
    """Replace the Draco streams of the default scene's triangle primitives with plain data, in place.

    Accessors keep their indices and counts and gain the decoded data; bounds are recomputed. The extension is removed
    from these primitives, and from the document once no primitive uses it.
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
    return document.add(
        "accessors", {key: value for key, value in accessors[accessor].items() if key not in _DATA_KEYS}
    )


def _attribute_rows(stream: Any, unique_id: int, accessor: Json, where: str) -> NDArray[Any]:
    attribute = next((item for item in stream.attributes if item["unique_id"] == unique_id), None)
    if attribute is None or not isinstance(attribute.get("data"), np.ndarray):
        raise AssetUnsupportedError(f"{where}: the Draco stream has no attribute {unique_id}.", advice=_ADVICE)
    rows = attribute["data"]
    dtype = np.dtype(DTYPES[accessor["componentType"]])
    if rows.shape != (accessor["count"], TYPE_COMPONENTS[accessor["type"]]):
        raise AssetError(
            f"{where}: the Draco stream holds {rows.shape}, but the accessor {accessor['count']} {accessor['type']}."
        )
    # DracoPy returns integers of some attributes as floats.
    fits = rows.dtype.kind == "f" if dtype.kind == "f" else attribute["data_type"] in _INTEGERS
    if not fits:
        raise AssetUnsupportedError(f"{where}: the Draco stream holds {rows.dtype}, not {dtype}.", advice=_ADVICE)
    if dtype.kind != "f" and rows.size:
        low, high = np.iinfo(dtype).min, np.iinfo(dtype).max
        least, most = int(rows.min()), int(rows.max())
        if least < low or most > high:
            raise AssetError(f"{where}: the Draco stream holds {least} to {most}, but {dtype} {low} to {high}.")
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
        at = document.add("accessors", {"componentType": UNSIGNED_INT, "count": len(corners), "type": "SCALAR"})
        primitive["mode"] = TRIANGLES
    dtype = DTYPES[accessors[at]["componentType"]]
    accessors[at]["bufferView"] = document.append_view(corners.astype(dtype).tobytes(), ELEMENT_ARRAY_BUFFER)
    refresh_bounds(document, at)  # encoders may reorder or remove vertices and leave the old maximum
    primitive["indices"] = at


def decode_view(data: bytes, view: CompressedView) -> bytes:
    """Decode one compressed view."""
    if view.mode == "ATTRIBUTES":
        return apply_filter(view.filter, decode_attributes(data, view.count, view.stride)).tobytes()
    decode = decode_triangles if view.mode == "TRIANGLES" else decode_indices
    return decode(data, view.count).astype("<u2" if view.stride == 2 else "<u4").tobytes()


def decode_meshopt(document: Document) -> None:
    """Decode in place every view that has no uncompressed data."""
    root = document.root
    views = root.get("bufferViews", [])
    used = {*root.get("extensionsUsed", []), *(name for view in views for name in view.get("extensions", {}))}
    if used.isdisjoint(MESHOPT_EXTENSIONS):
        return
    placeholders = {i for i in range(len(root.get("buffers", []))) if is_placeholder(root, i, document.binary_length)}
    filtered = set()
    for i, view in enumerate(views):
        if view["buffer"] in placeholders and _decode_in_place(document, i, view) != "NONE":
            filtered.add(i)
    for i, accessor in enumerate(root.get("accessors", [])):
        if accessor.get("bufferView") in filtered:
            refresh_bounds(document, i)
    normalize_weights(document, filtered)
    for buffer in placeholders:
        _drop(root["buffers"][buffer])
    document.remove_buffers(placeholders - {0})
    for name in MESHOPT_EXTENSIONS:
        if not any(name in item.get("extensions", {}) for item in root.get("bufferViews", [])):
            drop_extension(root, name)


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


def restore_exactness(rows: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return a primitive's decoded attributes with weights that sum to 1 and unit tangents with a handedness of +-1.

    `rows`, mapping of str to (N, K) array: decoded elements by attribute name. Integers are lossless and stay as they
    are.
    """
    fixed = dict(rows)
    weights = [name for name, values in rows.items() if name.startswith(_WEIGHTS) and values.dtype.kind == "f"]
    if weights:
        total = _sum_to_one([rows[name] for name in weights])
        fixed |= {name: (rows[name] / total).astype(np.float32) for name in weights}
    tangents = rows.get("TANGENT")
    if tangents is not None and tangents.dtype.kind == "f":
        length = np.linalg.norm(tangents[:, :3], axis=1, keepdims=True)
        unit = tangents[:, :3] / np.where(length > 0.0, length, 1.0)
        fixed["TANGENT"] = np.column_stack([unit, np.where(tangents[:, 3] < 0.0, -1.0, 1.0)]).astype(np.float32)
    return fixed


def _sum_to_one(sets: list[NDArray[Any]]) -> NDArray[np.float64]:
    """Return the divisors (N, 1) that make each vertex's weights sum to 1; vertices without weights keep theirs."""
    total = np.sum([values.astype(np.float64).sum(axis=1) for values in sets], axis=0)[:, None]
    return np.asarray(np.where(np.isfinite(total) & (total > 0.0), total, 1.0))


def normalize_weights(document: Document, views: set[int]) -> None:
    """Replace the float weights that are stored in these lossily decoded views by weights that sum to 1, in place."""
    accessors = document.root.get("accessors", [])
    replaced: dict[tuple[int, ...], list[int]] = {}
    for mesh in document.root.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            attributes = primitive.get("attributes", {})
            names = sorted(name for name in attributes if name.startswith(_WEIGHTS))
            sets = tuple(attributes[name] for name in names)
            if not any(accessors[at].get("bufferView") in views for at in sets):
                continue
            if any(accessors[at]["componentType"] != FLOAT for at in sets):
                continue
            if len({accessors[at]["count"] for at in sets}) != 1:
                continue
            if sets not in replaced:
                rows = restore_exactness({n: read_floats(document, at) for n, at in zip(names, sets, strict=True)})
                replaced[sets] = [
                    document.append_accessor(rows[n], like=accessors[at]) for n, at in zip(names, sets, strict=True)
                ]
            attributes |= dict(zip(names, replaced[sets], strict=True))
