"""Paint examples/vase.glb: the page's textured example. CC0: the pattern is drawn here.

python -m bench.painted_vase        writes service/web/examples/vase.glb
"""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "examples" / "vase.glb"
PAINTED = ROOT / "service" / "web" / "examples" / "vase.glb"
_SIZE = 512
_CLAY, _DARK, _CREAM = (188, 96, 58), (44, 34, 32), (240, 222, 190)


def pattern() -> bytes:
    """Return a PNG with bands, waves and zigzags that meet at the seam; the rows follow the vase's profile."""
    u, v = np.meshgrid(np.arange(_SIZE) / _SIZE, np.arange(_SIZE) / _SIZE)
    picture = np.empty((_SIZE, _SIZE, 3), np.uint8)
    picture[:] = _CLAY
    for low, high in ((0.30, 0.33), (0.50, 0.53), (0.60, 0.62), (0.74, 0.78)):
        picture[(v >= low) & (v < high)] = _DARK
    zigzag = 0.415 + 0.055 * np.abs(((12 * u) % 1) * 2 - 1) * 2 - 0.055
    picture[np.abs(v - zigzag) < 0.016] = _CREAM
    wave = 0.565 + 0.014 * np.sin(2 * np.pi * 16 * u)
    picture[np.abs(v - wave) < 0.007] = _CREAM
    rays = (v > 0.64) & (v < 0.73) & (np.abs(((20 * u) % 1) - 0.5) < 0.42 * (v - 0.64) / 0.09)
    picture[rays] = _DARK
    buffer = io.BytesIO()
    Image.fromarray(picture).quantize(8).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def painted(data: bytes, png: bytes) -> bytes:
    """Return a GLB with the picture as the base colour of its first material.

    Parameters
    ----------
    data : bytes
        A GLB of one buffer.
    png : bytes
    """
    (length,) = struct.unpack_from("<I", data, 12)
    document: dict[str, Any] = json.loads(data[20 : 20 + length])
    buffer = _padded(data[28 + length :], b"\0")
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(buffer), "byteLength": len(png)})
    document["images"] = [{"bufferView": len(document["bufferViews"]) - 1, "mimeType": "image/png"}]
    document["samplers"] = [{"wrapS": 10497, "wrapT": 10497}]
    document["textures"] = [{"source": 0, "sampler": 0}]
    material = document["materials"][0]
    material["name"] = "painted clay"
    material["pbrMetallicRoughness"] |= {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 1, 1]}
    buffer = _padded(buffer + png, b"\0")
    document["buffers"][0]["byteLength"] = len(buffer)
    text = _padded(json.dumps(document, separators=(",", ":")).encode(), b" ")
    chunks = [struct.pack("<I", len(text)) + b"JSON" + text, struct.pack("<I", len(buffer)) + b"BIN\0" + buffer]
    body = b"".join(chunks)
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def _padded(data: bytes, filler: bytes) -> bytes:
    return data + filler * (-len(data) % 4)


def main() -> None:
    """Write the painted vase."""
    data = painted(SOURCE.read_bytes(), pattern())
    PAINTED.write_bytes(data)
    print(f"{PAINTED.relative_to(ROOT)}: {len(data):,} bytes")


if __name__ == "__main__":
    main()
