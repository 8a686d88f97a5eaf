"""Read values at points of a surface from an NPZ: scalars, and the pieces that places belong to. numpy only."""

from __future__ import annotations

import io
import re
import zipfile
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.inspect import AssetSummary
from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetFormatError,
    AssetNotFiniteError,
    AssetTooLargeError,
)

_Floats = NDArray[np.float64]

MAX_OUTPUTS = 64
"""Most scalars of one file, each label of pieces counted as one."""
MAX_SAMPLES = 1_000_000
_FEWEST_SAMPLES = 100
_MAX_BYTES = 8 * MAX_SAMPLES * (6 + MAX_OUTPUTS)
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,39}")
_LARGEST = float(np.finfo(np.float32).max)
_FINITE = "Leave out the points whose values are not known."
_FORM = "Store points (P, 3), and with any other names floats (P,) or (P, C), or integers (P,) for pieces."


@dataclass(frozen=True)
class SampledScalars:
    """Values at points near a surface."""

    points: _Floats  # (P, 3) float64
    normals: _Floats  # (P, 3) float64: unit normals, which tell the two sides of a wall apart; zero where unknown
    values: dict[str, _Floats]  # dict of str to (P, C) float64: scalars by name
    labels: dict[str, NDArray[np.int64]]  # dict of str to (P,) int64: numbers of pieces by name


def read_scalar_file(data: bytes) -> SampledScalars:
    """Read an NPZ of values at points."""
    arrays = _arrays(data)
    if "points" not in arrays:
        raise AssetError("The file of scalars has no 'points'.", advice=_FORM)
    points = _rows("points", arrays.pop("points"))
    normals = _rows("normals", arrays.pop("normals")) if "normals" in arrays else np.zeros_like(points)
    if len(points) < _FEWEST_SAMPLES:
        raise AssetEmptyError(f"The scalars are given at {len(points)} points; {_FEWEST_SAMPLES} are needed.")
    if len(points) > MAX_SAMPLES:
        raise AssetTooLargeError(f"The scalars have {len(points)} points; the limit is {MAX_SAMPLES}.")
    if len(normals) != len(points):
        raise AssetError(f"There are {len(normals)} normals for {len(points)} points.", advice=_FORM)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 1e-6)
    values: dict[str, _Floats] = {}
    labels: dict[str, NDArray[np.int64]] = {}
    outputs = 0
    for name, array in arrays.items():
        if not _NAME.fullmatch(name):
            raise AssetError(
                f"The scalars have the name {name[:40]!r}.", advice="Use at most 40 letters, digits, spaces, . _ and -."
            )
        if len(array) != len(points) or array.ndim not in (1, 2) or array.dtype.kind not in "fiub":
            raise AssetError(f"{name!r} is {array.dtype} {array.shape}, for {len(points)} points.", advice=_FORM)
        if array.dtype.kind == "f":
            values[name] = array.reshape(len(points), -1).astype(np.float64)
            outputs += values[name].shape[1]
            if values[name].size and not np.abs(values[name]).max() < _LARGEST:
                raise AssetNotFiniteError(f"{name!r} has values that are not finite 32-bit floats.", advice=_FINITE)
        elif array.ndim == 1:
            labels[name] = array.astype(np.int64)
            outputs += len(np.unique(labels[name]))
        else:
            raise AssetError(f"{name!r} has integers, so it must be (P,): the piece of each point.", advice=_FORM)
    if not outputs:
        raise AssetEmptyError("The file has points, but no scalars.", advice=_FORM)
    if outputs > MAX_OUTPUTS:
        raise AssetTooLargeError(f"The file has {outputs} scalars and pieces; the limit is {MAX_OUTPUTS}.")
    return SampledScalars(points, normals, values, labels)


def summary_of_scalars(scalars: SampledScalars) -> AssetSummary:
    """Return the summary: `vertices` counts the points, `meshes` the names."""
    return AssetSummary("npz", len(scalars.points), 0, meshes=len(scalars.values) + len(scalars.labels))


def _arrays(data: bytes) -> dict[str, NDArray[np.generic]]:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(member.file_size for member in archive.infolist()) > _MAX_BYTES:
                raise AssetTooLargeError("The file of scalars is too large.", advice="Give fewer points.")
        with np.load(io.BytesIO(data), allow_pickle=False) as stored:
            return {name: np.atleast_1d(stored[name]) for name in stored.files}
    except MemoryError as error:  # the header of an array may state any shape
        raise AssetTooLargeError("The scalars do not fit into memory.", advice="Give fewer points.") from error
    except (zipfile.BadZipFile, ValueError, OSError, EOFError, KeyError) as error:
        raise AssetFormatError("The scalars cannot be read.", advice="Write them with numpy.savez.") from error


def _rows(name: str, array: NDArray[np.generic]) -> _Floats:
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        raise AssetError(f"{name!r} must be (P, 3) numbers, not {array.shape}.", advice=_FORM)
    rows = array.astype(np.float64)
    if rows.size and not np.abs(rows).max() < _LARGEST:
        raise AssetNotFiniteError(f"{name!r} has values that are not finite 32-bit floats.", advice=_FINITE)
    return rows
