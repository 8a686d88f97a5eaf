"""Read the JSON of the files that scripts/test-blender made."""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import Any

FOLDER = Path(os.environ.get("MESHDEFORM_RESULTS", ""))


def document(path: Path) -> dict[str, Any]:
    """Return the JSON of a GLB."""
    data = path.read_bytes()
    (size,) = struct.unpack_from("<I", data, 12)
    return dict(json.loads(data[20 : 20 + size]))


def triangles(root: dict[str, Any]) -> int:
    """Count the triangles of all nodes of a document."""

    def of(mesh: int) -> int:
        return sum(root["accessors"][p["indices"]]["count"] // 3 for p in root["meshes"][mesh]["primitives"])

    return sum(of(node["mesh"]) for node in root["nodes"] if "mesh" in node)
