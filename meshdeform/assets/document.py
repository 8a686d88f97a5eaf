"""Hold a glTF document in memory: JSON that keeps its order and values, and buffers that are never changed.

New data is only appended to the binary chunk, so that the original chunk remains an exact prefix of the new one. Old
accessors are not changed, since other primitives, morph bases and instances may share them.

What refers to accessors, buffer views and bytes of a document is listed here as well.

Accessors are read as arrays, including strided, sparse, quantized and normalized ones; `inspect.check_storage` has
already checked every length against the file.

Source: glTF 2.0 specification, sections 3.6 to 3.11; KHR_mesh_quantization; KHR_draco_mesh_compression,
EXT_mesh_gpu_instancing and EXT_meshopt_compression.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self
from urllib.parse import unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.container import Json, clone, dump_json, glb_layout, pack_glb, padded, parse_json
from meshdeform.assets.inspect import (
    BYTE,
    DRACO,
    FLOAT,
    GPU_INSTANCING,
    MESHOPT_EXTENSIONS,
    SHORT,
    TRIANGLE_FAN,
    TRIANGLE_STRIP,
    TRIANGLES,
    TYPE_COMPONENTS,
    UNSIGNED_BYTE,
    UNSIGNED_INT,
    UNSIGNED_SHORT,
    is_placeholder,
)
from meshdeform.assets.limits import Limits
from meshdeform.assets.references import MANIFOLD
from meshdeform.assets.unchecked import member_of, objects_in
from meshdeform.errors import AssetError, AssetTruncatedError

ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_Slot = tuple[Json, str]
"""An object and the name of its member that holds an index."""
_WITHOUT_REFERENCES = (
    *(DRACO, GPU_INSTANCING, MANIFOLD, *MESHOPT_EXTENSIONS, "KHR_mesh_quantization", "KHR_animation_pointer"),
    *("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_xmp", "KHR_node_", "EXT_texture_", "MSFT_texture_"),
)
"""Extensions whose integers are no indices of accessors or views, or whose indices are listed here."""
DTYPES = {BYTE: "<i1", UNSIGNED_BYTE: "<u1", SHORT: "<i2", UNSIGNED_SHORT: "<u2", UNSIGNED_INT: "<u4", FLOAT: "<f4"}


class Document:
    """A glTF document. `fork` returns an independent copy to edit; `to_bytes` writes a GLB."""

    def __init__(self, root: Json, binary: memoryview | None, rest: bytes) -> None:
        self.root = root
        self._binary = binary
        self._rest = rest
        self._appended: dict[int, bytes] = {}  # offset in the binary chunk -> data
        self._end = 0 if binary is None else len(binary)
        self._decoded: dict[int, memoryview] = {}

    @classmethod
    def parse(cls, data: bytes, limits: Limits, *, glb: bool) -> Self:
        """Read a GLB, or a glTF JSON with embedded buffers; the caller checks the JSON's content."""
        if not glb:
            text = data
            binary, rest = None, b""
        else:
            layout = glb_layout(data, limits)
            text, rest = data[layout.json], data[layout.rest]
            binary = None if layout.binary is None else memoryview(data)[layout.binary]
        return cls(parse_json(text, limits), binary, rest)

    @property
    def binary_length(self) -> int | None:
        """Length of the binary chunk as read, or None if there was none."""
        return None if self._binary is None else len(self._binary)

    def fork(self) -> Document:
        """Return a copy that can be edited without changing this document; the buffers' bytes are shared."""
        fork = Document(clone(self.root), self._binary, self._rest)
        fork._appended, fork._end = dict(self._appended), self._end
        fork._decoded = self._decoded
        return fork

    def items(self, key: str) -> list[Any]:
        """Return a top-level array, creating it if absent."""
        items: list[Any] = self.root.setdefault(key, [])
        return items

    def add(self, key: str, item: Any) -> int:
        """Append to a top-level array, and return the index."""
        self.items(key).append(item)
        return len(self.root[key]) - 1

    def buffer_bytes(self, buffer: int) -> memoryview:
        """Return the data of a buffer that is embedded in the file."""
        description = self.root["buffers"][buffer]
        if "uri" not in description:
            if buffer != 0 or self._binary is None:
                raise AssetTruncatedError(f"buffers[{buffer}] has no data.")
            return self._binary
        if buffer not in self._decoded:
            self._decoded[buffer] = memoryview(decode_data_uri(description["uri"], f"buffers[{buffer}]"))
        if len(self._decoded[buffer]) < description["byteLength"]:
            raise AssetTruncatedError(f"buffers[{buffer}] holds less than its byteLength.")
        return self._decoded[buffer]

    def attach_buffer(self, buffer: int, data: bytes) -> None:
        """Set the data of a buffer whose `uri` names another file."""
        self._decoded[buffer] = memoryview(data)

    def buffer_holders(self) -> list[Json]:
        """Return every object that refers to a buffer: buffer views and their compression extensions."""
        views = list(self.root.get("bufferViews", []))
        bodies = [
            view["extensions"][name]
            for view in views
            for name in MESHOPT_EXTENSIONS
            if name in view.get("extensions", {})
        ]
        return views + bodies

    def remove_buffers(self, removed: set[int]) -> None:
        """Remove unreferenced buffers and renumber the others."""
        if not removed:
            return
        kept = [i for i in range(len(self.root["buffers"])) if i not in removed]
        number = {old: new for new, old in enumerate(kept)}
        self.root["buffers"] = [self.root["buffers"][i] for i in kept]
        for holder in self.buffer_holders():
            holder["buffer"] = number[holder["buffer"]]
        self._decoded = {number[old]: data for old, data in self._decoded.items() if old in number}

    def view_bytes(self, view: int) -> memoryview:
        """Return the bytes of a buffer view."""
        description = self.root["bufferViews"][view]
        start = description.get("byteOffset", 0)
        if description["buffer"] == 0 and start in self._appended:
            return memoryview(self._appended[start])
        return self.buffer_bytes(description["buffer"])[start : start + description["byteLength"]]

    def append_bytes(self, data: bytes) -> int:
        """Append to the binary chunk and return the offset, a multiple of four."""
        if not self._appended:
            self._own_buffer_zero()
        offset = padded(self._end)
        self._appended[offset] = data
        self._end = offset + len(data)
        self.root["buffers"][0]["byteLength"] = self._end
        return offset

    def _own_buffer_zero(self) -> None:
        """Make buffer 0 the binary chunk; an embedded buffer 0 moves there with its bytes unchanged."""
        # It replaces a binary chunk beside it, which no buffer refers to.
        buffers = self.items("buffers")
        if not buffers:
            buffers.append({"byteLength": 0})
        if self._binary is None or "uri" in buffers[0]:
            self._binary = self.buffer_bytes(0) if "uri" in buffers[0] else memoryview(b"")
            buffers[0].pop("uri", None)
            self._end = len(self._binary)

    def append_view(self, data: bytes, target: int | None = None) -> int:
        """Append a buffer view and return its index."""
        offset = self.append_bytes(data)
        view: Json = {"buffer": 0, "byteOffset": offset, "byteLength": len(data)}
        if target is not None:
            view["target"] = target
        return self.add("bufferViews", view)

    def append_accessor(
        self, values: NDArray[np.float32], *, like: Json | None = None, bounds: bool = False, vertex: bool = True
    ) -> int:
        """Append an accessor of floats and return its index.

        `values`, (N,), (N, 1..4) or (N, 16) float32: the elements; `like`: the accessor to replace, whose name, extras
        and extensions are copied; `bounds`: whether to write `min` and `max`, of what is finite, else 0; `vertex`:
        whether the accessor holds vertex attributes.
        """
        rows = np.ascontiguousarray(values, dtype="<f4").reshape(len(values), -1)
        kept = {key: clone(value) for key, value in (like or {}).items() if key in {"name", "extras", "extensions"}}
        accessor: Json = {
            "bufferView": self.append_view(rows.tobytes(), ARRAY_BUFFER if vertex else None),
            "componentType": FLOAT,
            "count": len(rows),
            "type": _TYPES[rows.shape[1]],
        }
        if bounds:
            accessor |= _bounds(rows)
        return self.add("accessors", {**kept, **accessor})

    def append_stored(self, values: NDArray[Any], like: Json) -> int:
        """Append an accessor of vertex attributes as they are stored, and return its index.

        `values`, (N, C) of any type: the elements, each of which gets a multiple of four bytes; `like`: an accessor of
        the same type, of which everything but its data and its count is copied.
        """
        packed = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
        rows = np.zeros((len(values), packed.shape[1] + -packed.shape[1] % 4), np.uint8)
        rows[:, : packed.shape[1]] = packed
        view = self.append_view(rows.tobytes(), ARRAY_BUFFER)
        self.root["bufferViews"][view]["byteStride"] = rows.shape[1]
        kept = {name: clone(value) for name, value in like.items() if name not in ("byteOffset", "sparse")}
        return self.add("accessors", {**kept, "bufferView": view, "count": len(values)})

    def append_triangles(self, triangles: NDArray[np.integer], vertices: int, like: Json | None = None) -> int:
        """Append an accessor of the corners of triangles (T, 3), and return its index.

        `vertices`: how many there are; `like`: an accessor whose name and extras are copied.
        """
        small = vertices < 2**16  # 65535 itself is not a valid 16-bit index
        view = self.append_view(triangles.astype("<u2" if small else "<u4").tobytes(), ELEMENT_ARRAY_BUFFER)
        kept = {name: clone(value) for name, value in (like or {}).items() if name in ("name", "extras")}
        component = UNSIGNED_SHORT if small else UNSIGNED_INT
        item = {"bufferView": view, "componentType": component, "count": triangles.size, "type": "SCALAR"}
        return self.add("accessors", {**kept, **item})

    def append_zeros(self, count: int) -> int:
        """Append an accessor of `count` zero vectors; glTF defines an accessor without data as zeros."""
        bounds = {"min": [0.0, 0.0, 0.0], "max": [0.0, 0.0, 0.0]}
        return self.add("accessors", {"componentType": FLOAT, "count": count, "type": "VEC3", **bounds})

    def buffer_zero(self) -> bytearray:
        """Return a copy of the binary chunk with everything appended to it."""
        if self.items("buffers") and "uri" in self.root["buffers"][0]:
            self._own_buffer_zero()
        return bytearray(b"".join(self._pieces()))

    def use_buffer_zero(self, data: bytes) -> None:
        """Replace the binary chunk; the caller has adapted the buffer views."""
        self._binary, self._appended, self._end = memoryview(data), {}, len(data)
        self.root["buffers"][0]["byteLength"] = len(data)

    def to_bytes(self) -> bytes:
        """Write the document as a GLB."""
        return pack_glb(dump_json(self.root), self._pieces(), self._rest)

    def _pieces(self) -> list[bytes | memoryview]:
        """Return the binary chunk and what was appended to it, in order."""
        pieces: list[bytes | memoryview] = [] if self._binary is None else [self._binary]
        end = 0 if self._binary is None else len(self._binary)
        for offset, data in self._appended.items():
            pieces += [b"\0" * (offset - end), data]
            end = offset + len(data)
        return pieces


def decode_data_uri(uri: str, where: str) -> bytes:
    """Decode a data URI, base64 or percent-encoded."""
    header, comma, payload = uri.partition(",")
    if not comma:
        raise AssetError(f"{where} has a data URI without data.")
    if not header.lower().endswith(";base64"):
        return unquote_to_bytes(payload)
    try:
        return base64.b64decode(payload, validate=True)
    except (binascii.Error, ValueError) as error:
        raise AssetError(f"{where} has a data URI that is not base64: {error}.") from error


@dataclass(frozen=True)
class Usage:
    """The entries and bytes that a document uses."""

    # Indices that something of the core format or of a known extension refers to
    accessors: frozenset[int]
    views: frozenset[int]
    accessor_count: int
    view_count: int
    ranges: tuple[tuple[int, int], ...]  # start and end of every stretch of buffer 0 that a buffer view describes
    end: int  # length of buffer 0

    @classmethod
    def of(cls, root: Json, binary_length: int | None) -> Usage:
        """Return the entries and bytes that a document uses; `binary_length` is that of its binary chunk, if any."""
        stored = bool(root.get("buffers")) and not is_placeholder(root, 0, binary_length)
        return cls(
            frozenset(holder[key] for holder, key in accessor_slots(root)),
            frozenset(holder[key] for holder, key in view_slots(root)),
            len(root.get("accessors", [])),
            len(root.get("bufferViews", [])),
            tuple((start, end) for _, start, end in buffer_ranges(root)) if stored else (),
            root["buffers"][0]["byteLength"] if stored else 0,
        )


def accessor_slots(root: Json) -> Iterator[_Slot]:
    """Yield every member that holds an accessor's index."""
    for mesh in objects_in(root.get("meshes")):
        for primitive in objects_in(mesh.get("primitives")):
            yield from _indices(primitive, "indices")
            for attributes in [primitive.get("attributes"), *objects_in(primitive.get("targets"))]:
                yield from _indices(attributes)
        manifold = member_of(mesh, "extensions", MANIFOLD)
        yield from _indices(manifold, "mergeIndices", "mergeValues")
        solid = manifold.get("manifoldPrimitive")
        if isinstance(solid, dict):
            yield from _indices(solid, "indices")
            yield from _indices(solid.get("attributes"))
    for skin in objects_in(root.get("skins")):
        yield from _indices(skin, "inverseBindMatrices")
    for animation in objects_in(root.get("animations")):
        for sampler in objects_in(animation.get("samplers")):
            yield from _indices(sampler, "input", "output")
    for node in objects_in(root.get("nodes")):
        yield from _indices(member_of(node, "extensions", GPU_INSTANCING).get("attributes"))


def view_slots(root: Json) -> Iterator[_Slot]:
    """Yield every member that holds a buffer view's index."""
    for accessor in objects_in(root.get("accessors")):
        yield from _indices(accessor, "bufferView")
        sparse = accessor.get("sparse", {})
        for member in ("indices", "values"):
            yield from _indices(sparse.get(member), "bufferView")
    for image in objects_in(root.get("images")):
        yield from _indices(image, "bufferView")
    for mesh in objects_in(root.get("meshes")):
        for primitive in objects_in(mesh.get("primitives")):
            yield from _indices(member_of(primitive, "extensions", DRACO), "bufferView")


def buffer_ranges(root: Json) -> Iterator[tuple[Json, int, int]]:
    """Yield each buffer view and compressed view in buffer 0 with its start and end."""
    for view in objects_in(root.get("bufferViews")):
        for holder in (view, *(member_of(view, "extensions", name) for name in MESHOPT_EXTENSIONS)):
            if holder.get("buffer") == 0:
                start = holder.get("byteOffset", 0)
                yield holder, start, start + holder["byteLength"]


def possible_references(root: Json) -> set[int]:
    """Return every integer in extras and in extensions that Meshdeform does not know: any may be an index."""
    numbers: set[int] = set()
    _search(root, numbers, opaque=False)
    return numbers


def _search(value: Any, numbers: set[int], *, opaque: bool) -> None:
    if isinstance(value, list):
        for item in value:
            _search(item, numbers, opaque=opaque)
    elif isinstance(value, dict):
        for key, item in value.items():
            if key == "extensions" and isinstance(item, dict):
                for name, body in item.items():
                    _search(body, numbers, opaque=opaque or not name.startswith(_WITHOUT_REFERENCES))
            else:
                _search(item, numbers, opaque=opaque or key == "extras")
    elif opaque and isinstance(value, int) and not isinstance(value, bool):
        numbers.add(value)


def _indices(holder: Any, *keys: str) -> Iterator[_Slot]:
    if isinstance(holder, dict):
        for key in keys or tuple(holder):
            if isinstance(holder.get(key), int) and not isinstance(holder[key], bool):
                yield holder, key


def triangle_list(corners: NDArray[np.int64], mode: int, restart: int | None = None) -> NDArray[np.int64]:
    """Return the triangles that a primitive's corners form.

    `corners`, (C,) int64: vertex indices in drawing order; `mode`: 4 triangles, 5 strip, 6 fan; `restart`: the index
    that starts a new strip or fan (glTF forbids it, but some exporters write it). Returns (T, 3) int64. Triangles with
    a repeated corner are removed from strips and fans, where they only join others, but not from lists. Corners past
    the last whole triangle are ignored.
    """
    if mode not in (TRIANGLE_STRIP, TRIANGLE_FAN):
        return np.asarray(corners[: len(corners) // 3 * 3].reshape(-1, 3))
    cuts = np.flatnonzero(corners == restart) if restart is not None else np.empty(0, np.int64)
    make = _strip if mode == TRIANGLE_STRIP else _fan
    triangles = np.concatenate([make(each[each != restart]) for each in np.split(corners, cuts)])
    a, b, c = triangles.T
    return np.asarray(triangles[(a != b) & (b != c) & (c != a)])


def _strip(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    if len(corners) < 3:
        return np.empty((0, 3), np.int64)
    triangles = np.lib.stride_tricks.sliding_window_view(corners, 3).copy()
    triangles[1::2] = triangles[1::2][:, [0, 2, 1]]  # every second triangle has the opposite winding
    return triangles


def _fan(corners: NDArray[np.int64]) -> NDArray[np.int64]:
    if len(corners) < 3:
        return np.empty((0, 3), np.int64)
    hub = np.full(len(corners) - 2, corners[0])
    return np.stack([corners[1:-1], corners[2:], hub], axis=1)


def read_accessor(document: Document, accessor: int) -> NDArray[Any]:
    """Return an accessor's elements as stored.

    Returns (count, components) array of the accessor's component type.
    """
    description = document.root["accessors"][accessor]
    dtype = np.dtype(DTYPES[description["componentType"]])
    shape = (description["count"], TYPE_COMPONENTS[description["type"]])
    stored = "bufferView" in description
    values: NDArray[Any] = _view(document, description, shape, dtype) if stored else np.zeros(shape, dtype)
    if "sparse" in description:
        values = _with_sparse(document, description["sparse"], values.copy(), f"accessors[{accessor}].sparse")
    return values


def _view(document: Document, holder: Json, shape: tuple[int, int], dtype: np.dtype[Any]) -> NDArray[Any]:
    view = document.root["bufferViews"][holder["bufferView"]]
    stride = view.get("byteStride", dtype.itemsize * shape[1])
    data = document.view_bytes(holder["bufferView"])
    return np.ndarray(shape, dtype, data, holder.get("byteOffset", 0), (stride, dtype.itemsize))


def _packed(document: Document, holder: Json, shape: tuple[int, int], dtype: np.dtype[Any]) -> NDArray[Any]:
    return np.ndarray(shape, dtype, document.view_bytes(holder["bufferView"]), holder.get("byteOffset", 0))


def _with_sparse(document: Document, sparse: Json, values: NDArray[Any], where: str) -> NDArray[Any]:
    count = sparse["count"]
    index_type = np.dtype(DTYPES[sparse["indices"]["componentType"]])
    rows = _packed(document, sparse["indices"], (count, 1), index_type)[:, 0]
    if rows.max() >= len(values):
        raise AssetError(f"{where} uses element {rows.max()}, but the accessor has only {len(values)}.")
    values[rows] = _packed(document, sparse["values"], (count, values.shape[1]), values.dtype)
    return values


def refresh_bounds(document: Document, accessor: int) -> None:
    """Recompute an accessor's `min` and `max`, if present, from its data, which lossy decoding has changed."""
    description = document.root["accessors"][accessor]
    if not {"min", "max"} & description.keys():
        return
    description |= {k: bound for k, bound in _bounds(read_accessor(document, accessor)).items() if k in description}


def _bounds(values: NDArray[Any]) -> dict[str, list[float]]:
    """Return the `min` and `max` of what is finite of (N, C) values; 0 where nothing is."""
    finite = np.isfinite(values)
    if not finite.all():
        some = np.where(finite.any(axis=0), values, 0)
        values = np.where(np.isfinite(some), some, np.nan)
        return {"min": np.nanmin(values, axis=0).tolist(), "max": np.nanmax(values, axis=0).tolist()}
    return {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}


def read_floats(document: Document, accessor: int) -> NDArray[np.float32]:
    """Return an accessor's elements as floats; normalized integers become -1..1 or 0..1.

    Returns (count, components) float32, always a new array.
    """
    values = read_accessor(document, accessor)
    floats = values.astype(np.float32)
    if values.dtype.kind != "f" and document.root["accessors"][accessor].get("normalized", False):
        # Divide in float64: values such as 1/127 are not exact in float32.
        floats = np.maximum(values.astype(np.float64) / np.iinfo(values.dtype).max, -1.0).astype(np.float32)
    return floats


def read_indices(document: Document, accessor: int) -> NDArray[np.int64]:
    """Return an index accessor's elements, (count,) int64."""
    return read_accessor(document, accessor)[:, 0].astype(np.int64)


def read_triangles(document: Document, primitive: Json, count: int, where: str) -> NDArray[np.int64]:
    """Return the triangles of a primitive with `count` vertices, (T, 3) int64."""
    mode, restart = primitive.get("mode", TRIANGLES), None
    corners = np.arange(count)
    if "indices" in primitive:
        corners = read_indices(document, primitive["indices"])
        component = document.root["accessors"][primitive["indices"]]["componentType"]
        if mode in (TRIANGLE_STRIP, TRIANGLE_FAN):
            restart = int(np.iinfo(DTYPES[component]).max)
    triangles = triangle_list(corners, mode, restart)
    if len(triangles) and triangles.max() >= count:
        raise AssetError(f"{where} uses vertex {triangles.max()} but has only {count} vertices.")
    return triangles
