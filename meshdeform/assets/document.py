"""Hold a glTF document in memory: JSON that keeps its order and values, and buffers that are never changed.

New data is only appended to the binary chunk, so that the original chunk remains an exact prefix of the new one. Old
accessors are not changed, since other primitives, morph bases and instances may share them.

Source: glTF 2.0 specification, sections 3.6 to 3.11.
"""

from __future__ import annotations

import base64
import binascii
from typing import Any, Self
from urllib.parse import unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.codes import FLOAT, MESHOPT_EXTENSIONS, UNSIGNED_INT, UNSIGNED_SHORT
from meshdeform.assets.container import Json, clone, dump_json, glb_layout, pack_glb, padded, parse_json
from meshdeform.assets.limits import Limits
from meshdeform.errors import AssetError, AssetTruncatedError

ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


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
            accessor |= bounds_of(rows)
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


def bounds_of(values: NDArray[Any]) -> dict[str, list[float]]:
    """Return the `min` and `max` of what is finite of (N, C) values; 0 where nothing is."""
    finite = np.isfinite(values)
    if not finite.all():
        some = np.where(finite.any(axis=0), values, 0)
        values = np.where(np.isfinite(some), some, np.nan)
        return {"min": np.nanmin(values, axis=0).tolist(), "max": np.nanmax(values, axis=0).tolist()}
    return {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
