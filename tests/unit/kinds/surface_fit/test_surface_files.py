"""Points, distance grids and networks: what cannot be used is refused with the reason, whatever the file says."""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
from collections.abc import Callable

import numpy as np
import pytest
from safetensors.numpy import save

from meshdeform.errors import (
    AssetEmptyError,
    AssetError,
    AssetFormatError,
    AssetNotFiniteError,
    AssetTooLargeError,
    AssetTruncatedError,
)
from meshdeform.geometry.shapes import icosphere
from meshdeform.kinds.surface_fit.scalar_files import read_scalar_file
from meshdeform.kinds.surface_fit.surface_files import OrientedPoints, read_surface_file
from tests.cases import each_case

BALL = icosphere(2).verts
BOUNDS = "[-2,-2,-2,2,2,2]"
HALVES = np.concatenate([np.eye(3), -np.eye(3)])


def xyz(points: np.ndarray, normals: np.ndarray = BALL) -> bytes:
    file = io.BytesIO()
    np.savetxt(file, np.concatenate([points, normals], 1))
    return file.getvalue()


def ply(*names: str) -> bytes:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(BALL)}\n"
    head += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    return head.encode() + xyz(2 * BALL)


def npz(**arrays: object) -> bytes:
    axis = np.linspace(-1.3, 1.3, 8)
    ball = np.sqrt(sum(part**2 for part in np.meshgrid(axis, axis, axis))) - 1
    file = io.BytesIO()
    np.savez(file, **{"sdf": ball, "origin": np.full(3, -1.3), "spacing": axis[1] - axis[0], **arrays})  # type: ignore[arg-type]
    return file.getvalue()


def stating(shape: tuple[int, ...], name: str) -> bytes:
    """Return an NPZ whose array has another shape than it states."""
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(f"{name}.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", 118) + text.encode() + bytes(64))
    return file.getvalue()


def network(*layers: tuple[np.ndarray, np.ndarray], name: str = "layers", **metadata: str) -> bytes:
    tensors = {}
    for number, (weight, bias) in enumerate(layers or ((HALVES, np.zeros(6)), (np.ones((1, 6)), -np.ones(1)))):
        tensors[f"{name}.{number}.weight"] = weight.astype(np.float32)
        tensors[f"{name}.{number}.bias"] = bias.astype(np.float32)
    return save(tensors, {"activation": "relu", "bounds": BOUNDS, **metadata})


def in_brain_floats() -> bytes:
    described = {
        "__metadata__": {"activation": "relu", "bounds": BOUNDS},
        "layers.0.weight": {"dtype": "BF16", "shape": [1, 3], "data_offsets": [0, 6]},
        "layers.0.bias": {"dtype": "BF16", "shape": [1], "data_offsets": [6, 8]},
    }
    text = json.dumps(described).encode()
    return struct.pack("<Q", len(text)) + text + bytes(8)


LAYER = (np.ones((1, 1)), np.zeros(1))


def one(points: np.ndarray, value: float) -> np.ndarray:
    changed = points.copy()
    changed[3, 0] = value
    return changed


REFUSED: dict[str, list[tuple[Callable[[], bytes], type[AssetError], str]]] = {
    "cloud.xyz": [
        (lambda: b"", AssetEmptyError, "no points"),
        (lambda: b"# nothing\n", AssetEmptyError, "no points"),
        (lambda: b"a b c d e f\n" * 200, AssetFormatError, "not a table"),
        (lambda: xyz(BALL)[:-30], AssetFormatError, "not a table"),
        (lambda: xyz(BALL[:, :0]), AssetError, "3 columns"),
        (lambda: xyz(BALL[:99], BALL[:99]), AssetEmptyError, "99 points"),
        (lambda: xyz(BALL, 0 * BALL), AssetError, "no normals"),
        (lambda: xyz(BALL * [1, 1, 0]), AssetError, "in one plane"),
        (lambda: xyz(0 * BALL), AssetError, "in one plane"),
        (lambda: xyz(one(BALL, 1e6)), AssetError, "far away"),
        (lambda: xyz(one(BALL, np.nan)), AssetNotFiniteError, "not finite"),
        (lambda: xyz(BALL * 1e200), AssetNotFiniteError, "32-bit"),
    ],
    "cloud.ply": [
        (lambda: ply("x", "y", "z", "nx", "ny", "w"), AssetError, "no 'nz': a cloud"),
        (lambda: b"ply\nformat ascii 1.0\nend_header\n", AssetError, "no 'x'"),
    ],
    "grid.npz": [
        (lambda: b"", AssetFormatError, "cannot be read"),
        (lambda: npz()[:-90], AssetFormatError, "cannot be read"),
        (lambda: stating((100_000,) * 3, "sdf"), AssetTooLargeError, "into memory"),
        (lambda: npz(sdf=np.array([{}, 1], object)), AssetFormatError, "cannot be read"),
        (lambda: npz(sdf=np.ones((8, 8))), AssetError, r"\(X, Y, Z\)"),
        (lambda: npz(sdf=np.ones((8, 8, 8))), AssetError, "one sign, as unsigned"),
        (lambda: npz(sdf=-np.pad(-np.ones((4, 4, 4)), 2, constant_values=1)), AssetError, "other way round"),
        (lambda: npz(sdf=np.full((8, 8, 8), np.nan)), AssetNotFiniteError, "not finite"),
        (lambda: npz(sdf=np.full((8, 8, 8), 1e200)), AssetNotFiniteError, "32-bit"),
        (lambda: npz(sdf=np.ones((8, 8, 8), bool)), AssetError, "not bool"),
        (lambda: npz(spacing=0.0), AssetError, "must be positive"),
        (lambda: npz(spacing=1e-200), AssetError, "must be positive"),
        (lambda: npz(spacing=1e200), AssetNotFiniteError, "32-bit"),
        (lambda: npz(spacing="near"), AssetError, "numbers"),
        (lambda: npz(origin=np.ones((2, 2))), AssetError, "numbers"),
    ],
    "net.safetensors": [
        (lambda: network()[:-8], AssetTruncatedError, "damaged"),
        (lambda: b"\xff" * 8 + network()[8:], AssetTruncatedError, "damaged"),
        (lambda: network(name="net"), AssetError, "another architecture"),
        (lambda: network((np.ones((1, 4)), np.zeros(1))), AssetError, "does not fit"),
        (lambda: network((np.ones((2, 3)), np.zeros(2))), AssetError, "another architecture"),
        (lambda: network((np.ones((1, 3)), np.zeros(1)), *[LAYER] * 32), AssetTooLargeError, "32 layers"),
        (lambda: network((np.full((1, 3), np.inf), np.zeros(1))), AssetNotFiniteError, "not finite"),
        (in_brain_floats, AssetError, "BF16"),
        (lambda: network(activation="gelu"), AssetError, "'gelu'"),
        (lambda: network(bounds="[" * 100_000), AssetError, "bounds are missing"),
        (lambda: network(bounds='"123456"'), AssetError, "not a box"),
        (lambda: network(bounds="[-1e400,-2,-2,2,2,2]"), AssetError, "not a box"),
        (lambda: network(bounds="[0,0,99999,1,1,100000]"), AssetError, "from the origin"),
        (lambda: network(omega="nan"), AssetError, "not a box"),
    ],
}


@each_case(("data", "name"), [(xyz(2 * BALL), "a.xyz"), (ply("x", "y", "z", "nx", "ny", "nz"), "a.ply")])
def test_points_and_normals_come_as_they_are_written(data: bytes, name: str) -> None:
    found = read_surface_file(data, name)
    assert isinstance(found, OrientedPoints)
    np.testing.assert_allclose(found.points, 2 * BALL, rtol=1e-6)
    np.testing.assert_allclose(found.normals, BALL, atol=1e-6)


def test_what_cannot_be_used_is_refused_with_what_to_do() -> None:
    for data, name in ((xyz(BALL * 1e-30), "a.xyz"), (npz(), "a.npz"), (network(), "a.safetensors")):
        assert read_surface_file(data, name) is not None
    for name, cases in REFUSED.items():
        for make, kind, said in cases:
            with pytest.raises(kind, match=said) as caught:
                read_surface_file(make(), name)
            assert type(caught.value) is kind, said
            told = caught.value.advice_text
            assert told, said
            assert not re.search("glTF|infinite vertices", told), said
    with pytest.raises(AssetTooLargeError, match="into memory"):
        read_scalar_file(stating((10**15, 3), "points"))
