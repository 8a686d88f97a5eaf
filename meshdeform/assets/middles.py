"""Compute the vertex attributes in the middle of edges, of any type that glTF allows.

Source: glTF 2.0 specification, sections 3.7.2 (Meshes) and 3.7.3.3 (Skinned mesh attributes).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_Rows = NDArray[Any]
_Index = NDArray[np.int64]


def middles(columns: Mapping[str, _Rows], a: _Index, b: _Index) -> dict[str, _Rows]:
    """Return the attributes of new vertices between vertices `a` (M,) and `b` (M,).

    Parameters
    ----------
    columns : mapping of str to (N, K) array
        Stored elements by attribute name; those of a morph target as `target/NAME`, with any prefix before the slash.

    Returns
    -------
    An array (M, K) of the same type for each. Normals and tangents have unit length. Skin weights are the mean of both
    ends, limited to the number of joints that a vertex has in the file, and sum to 1. Integers of the application's own
    attributes and feature ids, which may be numbers of something, are those of `a`; other integers are rounded.
    """
    found = {name: _middle(name, values, a, b) for name, values in columns.items()}
    sets = [name[8:] for name in columns if name.startswith("WEIGHTS_") and f"JOINTS_{name[8:]}" in columns]
    if sets:
        joints = np.concatenate([columns[f"JOINTS_{n}"] for n in sets], axis=1)
        weights = np.concatenate([columns[f"WEIGHTS_{n}"] for n in sets], axis=1)
        mixed = _mixed_weights(joints, weights, a, b)
        for k, n in enumerate(sets):
            found[f"JOINTS_{n}"], found[f"WEIGHTS_{n}"] = (rows[:, 4 * k : 4 * k + 4] for rows in mixed)
    return found


def _middle(name: str, values: _Rows, a: _Index, b: _Index) -> _Rows:
    first, second = values[a].astype(np.float64), values[b].astype(np.float64)
    own = name.startswith("_") and (values.dtype.kind != "f" or name.startswith("_FEATURE_ID"))
    if own or name.startswith(("JOINTS_", "WEIGHTS_")):
        return values[a]
    mean = (first + second) / 2
    if name in ("NORMAL", "TANGENT"):
        mean = np.column_stack([_unit(mean[:, :3], first[:, :3]), first[:, 3:]])
    return (mean if values.dtype.kind == "f" else np.rint(mean)).astype(values.dtype)


def _unit(vectors: NDArray[np.float64], otherwise: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.where(length > 1e-6, vectors / np.maximum(length, 1e-6), otherwise))


def _mixed_weights(joints: _Rows, weights: _Rows, a: _Index, b: _Index) -> tuple[_Rows, _Rows]:
    """Return joints and weights (M, K) of the middles: the K largest of the mean, in falling order."""
    count, width = len(a), joints.shape[1]
    both = np.concatenate([joints[a], joints[b]], axis=1).astype(np.int64)
    shares = np.concatenate([_shares(weights[a]), _shares(weights[b])], axis=1)
    base = int(joints.max(initial=0)) + 1
    keys, place = np.unique((np.arange(count)[:, None] * base + both).reshape(-1), return_inverse=True)
    total = np.bincount(place.reshape(-1), shares.reshape(-1), len(keys))
    keys, total = keys[total > 0], total[total > 0]
    row, joint = keys // base, keys % base
    order = np.lexsort((joint, -total, row))
    row, joint, total = row[order], joint[order], total[order]
    rank = np.arange(len(row)) - np.searchsorted(row, row)
    kept = rank < width
    made, share = np.zeros((count, width), joints.dtype), np.zeros((count, width))
    made[row[kept], rank[kept]], share[row[kept], rank[kept]] = joint[kept], total[kept]
    return made, _stored(_shares(share), weights.dtype)


def _shares(weights: _Rows) -> NDArray[np.float64]:
    """Return weights (M, K) that sum to 1; rows without weights stay zero."""
    values = np.nan_to_num(weights.astype(np.float64), posinf=0.0)
    total = values.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(values, total, out=np.zeros_like(values), where=total > 0))


def _stored(shares: NDArray[np.float64], dtype: np.dtype[Any]) -> _Rows:
    """Return shares as floats, or as normalized integers whose sum is exactly that of 1."""
    if dtype.kind == "f":
        return shares.astype(dtype)
    exact = shares * np.iinfo(dtype).max
    floor = np.floor(exact)
    missing = np.rint(exact.sum(axis=1) - floor.sum(axis=1))[:, None]
    rank = np.argsort(np.argsort(floor - exact, axis=1, kind="stable"), axis=1)
    return np.asarray(floor + (rank < missing), dtype)
