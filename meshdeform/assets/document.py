"""Hold a glTF document in memory: JSON that keeps its order and values, and buffers that are never changed.

New data is only appended to the binary chunk, so that the original chunk remains an exact prefix of the new one. Old
accessors are not changed, since other primitives, morph bases and instances may share them.
"""

from __future__ import annotations

import base64
import binascii
from typing import Any, Self
from urllib.parse import unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.container import glb_layout, pack_glb, padded
from meshdeform.assets.json_text import Json, clone, dump_json, parse_json
from meshdeform.assets.limits import Limits
from meshdeform.assets.storage import FLOAT, MESHOPT_EXTENSIONS
from meshdeform.errors import AssetError, AssetTruncatedError

__all__ = ["ARRAY_BUFFER", "ELEMENT_ARRAY_BUFFER", "Document"]

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

    def remove_buffers(self, gone: set[int]) -> None:
        """Remove unreferenced buffers and renumber the others."""
        if not gone:
            return
        kept = [i for i in range(len(self.root["buffers"])) if i not in gone]
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
        """Make buffer 0 the binary chunk; an embedded buffer 0 moves there with its bytes unchanged.

        It replaces a binary chunk beside it, which no buffer refers to.
        """
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
        views = self.items("bufferViews")
        views.append(view)
        return len(views) - 1

    def append_accessor(
        self, values: NDArray[np.float32], *, like: Json | None = None, bounds: bool = False, vertex: bool = True
    ) -> int:
        """Append an accessor of floats and return its index.

        Parameters
        ----------
        values : (N,), (N, 1..4) or (N, 16) float32
            The elements.
        like : dict, optional
            The accessor to replace, whose name, extras and extensions are copied.
        bounds : bool
            Whether to write `min` and `max`.
        vertex : bool
            Whether the accessor holds vertex attributes.
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
            accessor["min"] = [float(value) for value in rows.min(axis=0)]
            accessor["max"] = [float(value) for value in rows.max(axis=0)]
        accessors = self.items("accessors")
        accessors.append({**kept, **accessor})
        return len(accessors) - 1

    def append_zeros(self, count: int) -> int:
        """Append an accessor of `count` zero vectors; glTF defines an accessor without data as zeros."""
        accessors = self.items("accessors")
        zero = [0.0, 0.0, 0.0]
        accessors.append({"componentType": FLOAT, "count": count, "type": "VEC3", "min": zero, "max": list(zero)})
        return len(accessors) - 1

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
