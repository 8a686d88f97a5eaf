"""What Schemathesis cannot make up: an asset that is a mesh, and a host that may be called. Loaded by its process."""

from __future__ import annotations

import json
import struct
from typing import Any

import schemathesis
from schemathesis.generation.meta import TestPhase


def _tetrahedron() -> str:
    """A GLB whose bytes are all ASCII, so that it is a string, which is what a schema takes a file for."""
    corners = [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.5)]
    positions = b"".join(struct.pack("<3f", *corner) for corner in corners)
    indices = struct.pack("<12H", 0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2)
    binary = positions + indices
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(positions)},
            {"buffer": 0, "byteOffset": len(positions), "byteLength": len(indices)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [0.5] * 3},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
    }
    text = json.dumps(document).encode()
    while True:
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
        glb = struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks
        if glb.isascii():
            return glb.decode("ascii")
        text += b" "


_ASSET = _tetrahedron()
_DOWNLOADS = ("get_artifact", "get_asset", "get_checkpoint_mesh", "get_file", "export_word", "draw_word")


@schemathesis.hook
def before_call(context: Any, case: Any, kwargs: Any) -> None:
    """Let the chains of requests begin: other phases send what they like."""
    del context, kwargs
    if "Prefer" in (case.headers or {}):
        # Nobody is here to wait for.
        del case.headers["Prefer"]
    if case.meta is None or case.meta.phase.name != TestPhase.STATEFUL or case.meta.generation.mode.is_negative:
        return
    if "Idempotency-Key" in (case.headers or {}):
        # The second answer would be the first one again, about a thing that another chain may have deleted since.
        del case.headers["Idempotency-Key"]
    name = case.operation.definition.raw.get("operationId")
    if name == "create_job" and case.media_type == "multipart/form-data":
        case.body = {"asset": _ASSET, "request": {"prompt": "a mushroom", "params": {"preset": "preview"}}}
    elif name == "create_webhook":
        case.body = {"url": "https://127.0.0.1:9/nobody"}
    elif name == "create_upload":
        case.body = {"filename": "tetrahedron.glb", "size": len(_ASSET)}
    elif name == "send_upload":
        case.body = _ASSET
    elif name == "get_artifact":
        case.query = {}


@schemathesis.hook
def after_call(context: Any, case: Any, response: Any) -> None:
    """Give downloads the one media type of the document, which is that for the sake of code generators."""
    del context
    if case.operation.definition.raw.get("operationId") in _DOWNLOADS and response.status_code in (200, 206):
        response.headers["content-type"] = ["application/octet-stream"]
