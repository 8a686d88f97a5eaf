"""Read accessors as arrays, including strided, sparse, quantized and normalized ones.

`storage_checks.check_storage` has already checked every length against the file.

Source: glTF 2.0 specification, sections 3.6.2 (Accessors) and 3.7.2 (Meshes); KHR_mesh_quantization.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.codes import (
    BYTE,
    FLOAT,
    SHORT,
    TRIANGLE_FAN,
    TRIANGLE_STRIP,
    TRIANGLES,
    TYPE_COMPONENTS,
    UNSIGNED_BYTE,
    UNSIGNED_INT,
    UNSIGNED_SHORT,
)
from meshdeform.assets.container import Json
from meshdeform.assets.document import Document, bounds_of
from meshdeform.errors import AssetError

DTYPES = {BYTE: "<i1", UNSIGNED_BYTE: "<u1", SHORT: "<i2", UNSIGNED_SHORT: "<u2", UNSIGNED_INT: "<u4", FLOAT: "<f4"}


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
    description |= {k: bound for k, bound in bounds_of(read_accessor(document, accessor)).items() if k in description}


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
