"""Write the `.ndf` container (docs/surface_fit.md): a base and weights, both rounded and entropy-coded.

The faces are stored in the order of a walk from face to face over their open edges. A face that a walk meets brings one
new corner or names one that is already there; a new corner is stored as its difference from the parallelogram over the
edge.

Source: Touma and Gotsman 1998, Triangle Mesh Compression (the prediction); Gumhold and Straßer 1998 (the walk).
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from meshdeform.kinds.surface_fit.network import FieldNetwork, steps_of, whole
from meshdeform.kinds.surface_fit.scalar_fields import ScalarField

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
BITS = 10


@dataclass(frozen=True)
class EncodedBase:
    """A base as its file holds it."""

    verts: _Floats  # (V, 3) float64: quantised, in the frame, in the order of the file
    faces: _Index  # (F, 3) int64: in the order of the file
    # The walk and the differences
    codes: bytes
    steps: bytes


def encode_base(verts: _Floats, faces: _Index) -> EncodedBase:
    """Encode a base.

    Parameters
    ----------
    verts : (V, 3) float64
        In the frame, in [-1, 1]; every vertex is used.
    faces : (F, 3) int64
        A manifold with at most two faces at an edge, in opposite directions.
    """
    most = 2 ** (BITS - 1) - 1
    places = np.rint((verts + 1) * most).astype(np.int64)
    of_edge = {(f[k], f[(k + 1) % 3]): i for i, f in enumerate(faces.tolist()) for k in range(3)}
    corners = faces.tolist()
    codes: list[int] = []
    done = np.zeros(len(faces), bool)
    written = _Written(places)
    for seed in range(len(faces)):
        if done[seed]:
            continue
        done[seed] = True
        a, b, c = corners[seed]
        codes.append(written.corner(a, places[written.order[-1]] if written.order else np.zeros(3, np.int64)))
        codes.append(written.corner(b, places[a]))
        codes.append(written.corner(c, places[b]))
        written.add(a, b, c)
        while written.open_edges:
            (a, b), rest = next(iter(written.open_edges.items()))
            face = of_edge.get((b, a))
            if face is None:
                del written.open_edges[a, b]
                codes.append(0)
                continue
            done[face] = True
            k = corners[face].index(b)
            c = corners[face][(k + 2) % 3]
            codes.append(written.corner(c, places[a] + places[b] - places[rest]) + 1)
            written.add(b, a, c)
    return EncodedBase(
        places[written.order] / most - 1,
        np.array(written.faces, np.int64),
        _planes(np.array(codes, "<u2").tobytes(), 2),
        _zigzag(np.array(written.moves)),
    )


class _Written:
    """The vertices and faces of a base that are written so far, and the edges at which it goes on."""

    def __init__(self, places: _Index) -> None:
        self._places = places
        self._number: dict[int, int] = {}
        self.order: list[int] = []
        self.moves: list[_Index] = []
        self.faces: list[tuple[int, int, int]] = []
        self.open_edges: dict[tuple[int, int], int] = {}

    def corner(self, vertex: int, guess: _Index) -> int:
        """Return the symbol of a corner, and store it if it is new."""
        if vertex in self._number:
            return len(self.order) - self._number[vertex]
        self._number[vertex] = len(self.order)
        self.order.append(vertex)
        self.moves.append(self._places[vertex] - guess)
        return 0

    def add(self, a: int, b: int, c: int) -> None:
        """Store a face of three vertices that are."""
        self.faces.append((self._number[a], self._number[b], self._number[c]))
        for one, other, rest in ((a, b, c), (b, c, a), (c, a, b)):
            if self.open_edges.pop((other, one), None) is None:
                self.open_edges[one, other] = rest


def write_field(
    base: EncodedBase,
    field: FieldNetwork,
    *,
    centre: _Floats,
    scale: float,
    provenance: dict[str, Any] | None = None,
    rounding: Sequence[int] | None = None,
    scalars: Sequence[ScalarField] = (),
) -> bytes:
    """Write a `.ndf` file.

    Parameters
    ----------
    field : FieldNetwork
        With features in the order of `base.verts`.
    centre : (3,) float64
    scale : float
        The frame: world = centre + scale frame.
    provenance : dict, optional
        JSON to store as `made`.
    rounding : sequence of int, optional
        The steps to which the field was rounded while it was fitted (`network.rounded`).
    scalars : sequence of ScalarField, optional
        With features in the same order.
    """
    networks = [(field.tensors, rounding), *[(each.tensors, each.rounding) for each in scalars]]
    steps = [steps_given if steps_given is not None else steps_of(tensors) for tensors, steps_given in networks]
    weights = [_numbers(tensors, each) for (tensors, _), each in zip(networks, steps, strict=True)]
    raw = [base.codes, base.steps, *weights]
    packed = [_deflated(part) for part in raw]
    kept = [{**each.header, "steps": own} for each, own in zip(scalars, steps[1:], strict=True)]
    header = {
        "vertices": len(base.verts),
        "faces": len(base.faces),
        "bits": BITS,
        "features": field.features.shape[1],
        "octaves": field.octaves,
        "widths": [field.layers[0][0].shape[1], *[len(bias) for _, bias in field.layers]],
        "steps": steps[0],
        # To a billionth of the surface's size; more digits would be noise.
        "centre": [round(float(x), 9 - math.ceil(math.log10(scale))) for x in centre],
        "scale": float(f"{scale:.9g}"),
        "sections": [[len(small), len(large)] for small, large in zip(packed, raw, strict=True)],
        **({"scalars": kept} if kept else {}),
        **({"made": provenance} if provenance else {}),
    }
    text = json.dumps(header, separators=(",", ":")).encode()
    body = b"NDF\x02" + struct.pack("<I", len(text)) + text + b"".join(packed)
    return body + struct.pack("<I", zlib.crc32(body))


def _numbers(tensors: Sequence[Tensor], steps: Sequence[int]) -> bytes:
    return _zigzag(torch.cat([part.ravel() for part in whole(tensors, steps)]).numpy())


def _zigzag(numbers: _Index) -> bytes:
    """Store whole numbers as 0, -1, 1, -2, 2, ..., so that those of both signs are small."""
    return _planes(((numbers << 1) ^ (numbers >> 63)).astype("<u2").tobytes(), 2)


def _deflated(data: bytes) -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, -15, 9)
    return packer.compress(data) + packer.flush()


def _planes(data: bytes, width: int) -> bytes:
    """Store the bytes of numbers apart, all low ones first: those of small numbers are then mostly zeros."""
    return np.frombuffer(data, np.uint8).reshape(-1, width).T.tobytes()
