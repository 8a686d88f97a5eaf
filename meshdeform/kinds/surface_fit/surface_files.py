"""Read files that describe a surface without triangles: oriented points, a signed distance grid, a small network.

numpy only: the service checks these files in a child process as it does meshes.
"""

from __future__ import annotations

import io
import itertools
import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.inspect import AssetSummary, surface_format
from meshdeform.assets.limits import Limits
from meshdeform.assets.ply_reader import PlyElement, read_elements
from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetFormatError,
    AssetNotFiniteError,
    AssetTooLargeError,
    AssetTruncatedError,
)

_Floats = NDArray[np.float64]
_ACTIVATIONS = ("relu", "silu", "sine", "softplus", "tanh")
_MAX_POINTS = 1_000_000
_MAX_GRID_VALUES = 256**3
_MAX_NETWORK_WEIGHTS = 1_000_000
_MAX_NETWORK_LAYERS = 32
_FEWEST_POINTS = 100
_FEWEST_CELLS = 4
_NEAREST = 1e-4
"""Least size of a network's box, as a share of its distance from the origin."""
_LARGEST, _SMALLEST = float(np.finfo(np.float32).max), float(np.finfo(np.float32).tiny)
_UNSIGNED = (
    "The values are all of one sign, as unsigned distances are. The gradient of an unsigned distance jumps at the "
    "surface, so no point can be projected to it."
)
_FINITE = "Write numbers in the place of NaN and infinity."
_GRID = "Store sdf (X, Y, Z), origin (3,) and spacing (1,) or (3,)."
_COARSER = "Make it coarser."
_NEGATE = "The values are negative at the sides, where the outside is: the sign is the other way round."
_CELLS = 192
"""Most cells along the longest side of the grid from which a first mesh is made."""
_DEPTH = 1.25
"""A place is thin if nothing around it is deeper, and it is less deep than this many cells: a tube of four cells
across always has a value deeper than that, wherever the grid lies."""
_SHARE = 0.01
"""Thin places per value just inside the surface from which on they are no noise."""


@dataclass(frozen=True)
class OrientedPoints:
    """A point cloud with normals."""

    # (P, 3) float64: unit normals, to the outside
    points: _Floats
    normals: _Floats


@dataclass(frozen=True)
class DistanceGrid:
    """Signed distances on a grid, negative inside."""

    values: _Floats  # (X, Y, Z) float64
    # (3,) float64: place of the first value, and distances between neighbours
    origin: _Floats
    spacing: _Floats


@dataclass(frozen=True)
class ImplicitNetwork:
    """Fully connected layers from a point to a value that is negative inside."""

    layers: list[tuple[_Floats, _Floats]]
    activation: str  # after every layer but the last: `relu`, `silu`, `sine`, `softplus` or `tanh`
    omega: float  # factor before a sine
    bounds: tuple[_Floats, _Floats]  # ((3,), (3,)) float64: the box that contains the surface

    @staticmethod
    def check_values(values: _Floats) -> None:
        """Refuse values (X, Y, Z) on a grid over the bounds that do not have the surface inside."""
        _check_signs(values)


def read_surface_file(
    data: bytes, filename: str, limits: Limits | None = None
) -> OrientedPoints | DistanceGrid | ImplicitNetwork | None:
    """Read a file without triangles; None if it is a mesh."""
    limits = limits or Limits()
    kind = surface_format(data[:65_536], filename)
    if kind is None:
        return None
    limits.check_bytes(len(data))
    if kind == "points":
        return _points(*(_ply(data) if data.startswith(b"ply") else _xyz(data)))
    return _grid(data) if kind == "grid" else _network(data)


def summary_of(source: OrientedPoints | DistanceGrid | ImplicitNetwork, filename: str) -> AssetSummary:
    """Return the summary of a surface without triangles: `vertices` counts its points, if it has any."""
    ending = filename.lower().rpartition(".")[2] if "." in filename else "ply"
    count = len(source.points) if isinstance(source, OrientedPoints) else 0
    return AssetSummary(ending, count, 0, warnings=warnings_about(source))


def warnings_about(source: object) -> tuple[str, ...]:
    """Return sentences about what limits a surface, if it is a grid; of others nothing is known before a fit."""
    return thin_warnings(source.values, source.spacing) if isinstance(source, DistanceGrid) else ()


def _points(points: _Floats, normals: _Floats) -> OrientedPoints:
    if len(points) < _FEWEST_POINTS:
        raise AssetEmptyError(
            f"The file has {len(points)} points; a surface needs {_FEWEST_POINTS}.", advice="Send a denser cloud."
        )
    if len(points) > _MAX_POINTS:
        raise AssetTooLargeError(
            f"The file has {len(points)} points; the limit is {_MAX_POINTS}.", advice="Thin it out."
        )
    if not (np.isfinite(points).all() and np.isfinite(normals).all() and np.abs(points).max() < _LARGEST):
        raise AssetNotFiniteError(
            "The file has points or normals that are not finite 32-bit floats.", advice="Remove those points."
        )
    lengths = np.linalg.norm(normals, axis=1)
    if (lengths < 1e-6).mean() > 0.01:
        raise AssetError(
            "The points have no normals.", advice="Estimate normals that face the outside, for example in MeshLab."
        )
    kept = lengths >= 1e-6
    points, normals = points[kept], normals[kept] / lengths[kept, None]
    size = float(np.ptp(points, axis=0).max())
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(points.T / max(size, _SMALLEST))), 0.0))
    if not spread[0] > 1e-4 * spread[2]:
        raise AssetError(
            "All points lie in one plane, which encloses nothing, or some lie far away from all the others.",
            advice="Send the points of a solid, without strays.",
        )
    return OrientedPoints(points, normals)


def _ply(data: bytes) -> tuple[_Floats, _Floats]:
    vertex = read_elements(data).get("vertex", PlyElement(0))
    if missing := [name for name in ("x", "y", "z", "nx", "ny", "nz") if name not in vertex.columns]:
        raise AssetError(
            f"The points have no {missing[0]!r}: a cloud needs x, y, z, nx, ny and nz.",
            advice="Estimate normals that face the outside, for example in MeshLab, and save them in the file.",
        )
    columns = [vertex.columns[name].astype(np.float64) for name in ("x", "y", "z", "nx", "ny", "nz")]
    return np.stack(columns[:3], 1), np.stack(columns[3:], 1)


def _xyz(data: bytes) -> tuple[_Floats, _Floats]:
    if not any(line.partition(b"#")[0].strip() for line in io.BytesIO(data)):
        raise AssetEmptyError("The file has no points.", advice="Write x y z nx ny nz in each line.")
    try:
        rows = np.loadtxt(io.BytesIO(data), dtype=np.float64, comments="#", ndmin=2, max_rows=_MAX_POINTS + 1)
    except ValueError as error:
        raise AssetFormatError(
            "The XYZ file is not a table of numbers.", advice="Write x y z nx ny nz in each line."
        ) from error
    if rows.shape[1] < 6:
        raise AssetError(
            f"The XYZ file has {rows.shape[1]} columns; a cloud needs six: x y z nx ny nz.",
            advice="Estimate normals that face the outside, for example in MeshLab.",
        )
    return rows[:, :3], rows[:, 3:6]


def _grid(data: bytes) -> DistanceGrid:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(member.file_size for member in archive.infolist()) > 8 * _MAX_GRID_VALUES + 4096:
                raise AssetTooLargeError(f"The grid has more than {_MAX_GRID_VALUES} values.", advice=_COARSER)
        with np.load(io.BytesIO(data), allow_pickle=False) as stored:
            arrays = {name: np.asarray(stored[name]) for name in stored.files}
    except MemoryError as error:  # the header of an array may state any shape
        raise AssetTooLargeError("The arrays of the NPZ file do not fit into memory.", advice=_COARSER) from error
    except (zipfile.BadZipFile, ValueError, OSError, EOFError, KeyError) as error:
        raise AssetFormatError("The NPZ file cannot be read.", advice="Write it with numpy.savez.") from error
    missing = [name for name in ("sdf", "origin", "spacing") if name not in arrays]
    if missing:
        raise AssetError(f"The grid has no {missing[0]!r}.", advice=_GRID)
    values = arrays["sdf"]
    if values.ndim != 3 or min(values.shape) < _FEWEST_CELLS or values.dtype.kind not in "fiu":
        raise AssetError(
            f"sdf must be (X, Y, Z) numbers, at least {_FEWEST_CELLS} each way, not {values.dtype} {values.shape}.",
            advice=_GRID,
        )
    if values.size > _MAX_GRID_VALUES:
        raise AssetTooLargeError(
            f"The grid has {values.size} values; the limit is {_MAX_GRID_VALUES}.", advice=_COARSER
        )
    try:
        origin = np.broadcast_to(arrays["origin"].astype(np.float64).reshape(-1), 3).copy()
        spacing = np.broadcast_to(arrays["spacing"].astype(np.float64).reshape(-1), 3).copy()
    except ValueError as error:
        raise AssetError("origin must be (3,) and spacing (1,) or (3,) numbers.", advice=_GRID) from error
    return _checked(values.astype(np.float64), origin, spacing)


def _checked(values: _Floats, origin: _Floats, spacing: _Floats) -> DistanceGrid:
    far = np.abs(origin) + np.abs(spacing) * values.shape
    if not (np.abs(values).max() < _LARGEST and (far < _LARGEST).all()):
        raise AssetNotFiniteError("The grid has values that are not finite 32-bit floats.", advice=_FINITE)
    if not (spacing > _SMALLEST).all():
        raise AssetError("The spacing of the grid must be positive.", advice="Store the distance between neighbours.")
    _check_signs(values)
    return DistanceGrid(values, origin, spacing)


def _check_signs(values: _Floats) -> None:
    if not (values < 0).any() or not (values > 0).any():
        raise AssetError(_UNSIGNED, advice="Send signed values, negative inside, that enclose the surface.")
    sides = [values[[0, -1]], values[:, [0, -1]], values[:, :, [0, -1]]]
    negative = sum(int((side < 0).sum()) for side in sides) / sum(side.size for side in sides)
    if negative > 0.5:
        raise AssetError(_NEGATE, advice="Multiply the values by -1.")
    if negative > 0:
        raise AssetError(
            "The surface reaches the sides of the grid, so it would have a hole there.",
            advice="Send a larger box that contains the whole surface.",
        )


def _network(data: bytes) -> ImplicitNetwork:
    tensors, metadata = _tensors(data)
    layers = _layers(tensors)
    activation = metadata.get("activation", "")
    if activation not in _ACTIVATIONS:
        raise AssetError(
            f"The network's activation is {activation[:40]!r}.",
            advice=f"Set the file's metadata `activation` to one of: {', '.join(_ACTIVATIONS)}.",
        )
    omega, low, high = _scale_and_box(metadata)
    return ImplicitNetwork(layers, activation, omega, (low, high))


def _tensors(data: bytes) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Return the tensors of a safetensors file by name, and its metadata."""
    try:
        from safetensors.numpy import load

        length = int.from_bytes(data[:8], "little")
        described = json.loads(data[8 : 8 + length])
        metadata = described.pop("__metadata__", None) or {}
        others = {str(each["dtype"]) for each in described.values()} - {"F16", "F32", "F64"}
        tensors = {} if others else load(data)
    except MemoryError:
        raise
    except Exception as error:
        raise AssetTruncatedError("The safetensors file is damaged or incomplete.") from error
    if others:
        raise AssetError(f"The network's numbers are {min(others)[:20]}.", advice="Store them as float32.")
    return tensors, metadata


def _layers(tensors: Mapping[str, NDArray[Any]]) -> list[tuple[_Floats, _Floats]]:
    """Return weights and biases of the layers in order."""
    form = "Store layers.0.weight (H, 3), layers.0.bias, ..., the last layer with one output (docs/surface_fit.md)."
    layers: list[tuple[_Floats, _Floats]] = []
    width = 3
    while (weight := tensors.get(f"layers.{len(layers)}.weight")) is not None:
        bias = tensors.get(f"layers.{len(layers)}.bias")
        if bias is None or weight.ndim != 2 or weight.shape[1] != width or bias.shape != (weight.shape[0],):
            raise AssetError(f"Layer {len(layers)} of the network does not fit the one before it.", advice=form)
        layers.append((weight.astype(np.float64), bias.astype(np.float64)))
        width = weight.shape[0]
        if len(layers) > _MAX_NETWORK_LAYERS:
            raise AssetTooLargeError(
                f"The network has more than {_MAX_NETWORK_LAYERS} layers.", advice="Train a smaller one."
            )
    if not layers or width != 1 or len(tensors) != 2 * len(layers):
        raise AssetError("The network has another architecture.", advice=form)
    if sum(weight.size for weight, _ in layers) > _MAX_NETWORK_WEIGHTS:
        raise AssetTooLargeError(
            f"The network has more than {_MAX_NETWORK_WEIGHTS} weights.", advice="Train a smaller one."
        )
    if not all(np.isfinite(array).all() for layer in layers for array in layer):
        raise AssetNotFiniteError("The network has weights that are not finite.", advice="Train it again.")
    return layers


def _scale_and_box(metadata: Mapping[str, str]) -> tuple[float, _Floats, _Floats]:
    """Return the scale of the first layer's sines, and the corners (3,) of the box of the surface."""
    try:
        omega, bounds = float(metadata.get("omega", "1")), json.loads(metadata.get("bounds", ""))
        box = [float(x) for x in bounds]
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise AssetError(
            "The network's bounds are missing.", advice="Set `bounds`, such as [-1,-1,-1,1,1,1]."
        ) from error
    if (
        not isinstance(bounds, list)
        or len(box) != 6
        or not all(map(math.isfinite, [*box, omega]))
        or any(box[i] >= box[i + 3] for i in range(3))
    ):
        raise AssetError("The network's bounds are not a box.", advice="Set `bounds`, such as [-1,-1,-1,1,1,1].")
    if max(box[i + 3] - box[i] for i in range(3)) < _NEAREST * max(map(abs, box)):  # it computes with 32-bit floats
        raise AssetError(
            f"The network's surface lies more than {1 / _NEAREST:,.0f} times its size from the origin.",
            advice="Train it near the origin.",
        )
    return omega, np.array(box[:3]), np.array(box[3:])


def coarsening(shape: tuple[int, ...]) -> int:
    """Return how many values apart are those from which a first mesh is made."""
    return max(1, math.ceil(max(shape) / _CELLS))


def thin_warnings(values: _Floats, spacing: _Floats) -> tuple[str, ...]:
    """Return a sentence about parts of a grid (X, Y, Z) that are too thin for its cells, if there are any.

    Along the middle of a thin wall or tube no neighbour is deeper, and the depth is half of what is there. Where a
    surface only bends, there is a deeper neighbour.
    """
    step = coarsening(values.shape)
    values, cell = values[::step, ::step, ::step], float(spacing.max()) * step
    inside = np.argwhere(values < 0)
    inside = inside[((inside > 0) & (inside < np.array(values.shape) - 1)).all(1)]
    own = values[tuple(inside.T)]
    around = [d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)]
    outer, flat = np.zeros(len(inside), np.bool_), own <= 0.999 * values.min()
    for d in around:
        there = values[tuple((inside + d).T)]
        flat &= there == own
        if sum(map(abs, d)) == 1:
            outer |= there >= 0
    # The constant beyond the band of a level set says nothing about how deep it is there.
    low = 0.999 * values.min() if flat.any() else -np.inf
    thin = own > max(low, -_DEPTH * cell)
    for d in around:
        rows = np.flatnonzero(thin)
        thin[rows] = values[tuple((inside[rows] + d).T)] >= own[rows] - 1e-6 * cell
    if thin.sum() <= _SHARE * outer.sum():
        return ()
    across = 2 * float(np.median(-own[thin])) / cell
    words = f"Parts of the surface are only about {across:.1f} cells thick and may come out torn; four are needed."
    if step == 1:
        return (f"{words} Send a finer grid.",)
    return (f"{words} A cell here is {step} of the grid's, which has more than {_CELLS}. Send a mesh, or points.",)
