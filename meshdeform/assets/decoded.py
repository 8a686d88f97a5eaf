"""Restore what lossy decoding loses of attributes for which glTF requires exact sums or lengths.

Source: glTF 2.0 specification, sections 3.7.2.1 (tangents) and 3.7.3.3 (skinned mesh attributes).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.accessors import read_floats
from meshdeform.assets.document import Document
from meshdeform.assets.storage import FLOAT

__all__ = ["normalize_weights", "restore_exactness"]

_WEIGHTS = "WEIGHTS_"


def restore_exactness(rows: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return a primitive's decoded attributes with weights that sum to 1 and unit tangents with a handedness of +-1.

    Parameters
    ----------
    rows : mapping of str to (N, K) array
        Decoded elements by attribute name. Integers are lossless and stay as they are.
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
