"""Check the file of a fitted family."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from meshdeform.assets.check import bound_reading
from meshdeform.assets.inspect import AssetSummary
from meshdeform.assets.limits import Limits


def _read_family(path: Path, _filename: str, limits: Limits) -> dict[str, Any]:
    bound_reading(path, limits)
    from meshdeform.kinds.families.family_file import read_family

    family = read_family(path.read_bytes(), limits)
    triangles = sum(len(segments) for segments in family.segments)
    return asdict(AssetSummary("safetensors", 0, triangles, meshes=len(family.names)))


READERS = {"family": _read_family}
