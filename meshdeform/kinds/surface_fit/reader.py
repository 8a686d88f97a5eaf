"""Read a `.ndf` file and unfold it at any level, with numpy and the standard library alone.

All numbers are little-endian. The file has

- `NDF` and the version, 2: four bytes
- the length of the header: four bytes
- the header, JSON: `vertices`, `faces`, `bits`, `features`, `octaves`, `widths` of all layers, `steps`, `centre`,
  `scale`, `sections`, and optionally `scalars` and `made`
- the sections, each a raw DEFLATE stream; `sections` has their bytes, packed and unpacked
- CRC-32 (zlib's) of everything before: four bytes

Each section is a list of 16-bit numbers, all low bytes before all high ones. Zigzag integers are 0, -1, 1, -2, 2 ...
for 0, 1, 2, 3, 4 ... The first two sections hold the base as a walk over its faces:

- The walk keeps directed open edges in a queue. Each number of the first section is about the oldest edge, (a, b) of a
  face (a, b, r): 0 is a border, and the edge is closed; otherwise a face (b, a, c) follows, where 1 is a new corner c,
  and n + 1 the n-th last of the new corners. Without an open edge, three numbers begin a part with a face (a, b, c): 0
  for a new corner, or n.
- Of each face (x, y, z), the edges (x, y), (y, z), (z, x) are taken in this order: one whose reverse is open closes
  that; another is put last in the queue.
- New corners are numbered from 0. The second section has three zigzag integers for each: its position less the
  prediction, which is a + b - r; for the corners that begin a part, the position of the last new corner (at first,
  zero), of a, and of b. Positions are integers; frame = integer / (2^(bits - 1) - 1) - 1, and
  world = centre + scale * frame.

The third has the features of vertex 0, of vertex 1, and so on, then for each layer the rows of its matrix (out, in),
and its bias, all as zigzag integers: a value is its integer times a step, 2^(n / 4). `steps` has the n of each channel
of the features, then one for each matrix and each bias. SiLU, x / (1 + exp(-x)), follows every layer but the last.
`widths` begins with the inputs: features, p, then sine and cosine for k = 0, 1 ... up to `octaves` - 1, three numbers
each.

A section for each member of `scalars` follows, likewise: the features of all vertices, then its layers. The member has
its `name`; `widths`, the features of a vertex and the outputs of each layer; `steps`; `offset` and `scale` of each
output, value = offset + scale * output; and for pieces `labels`, the number of each.
"""

from __future__ import annotations

import itertools
import json
import math
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform.kinds.surface_fit.ndf_header import checked_header
from meshdeform.kinds.surface_fit.patches import level_of

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
Layers = list[tuple[NDArray[np.float32], NDArray[np.float32]]]
"""Weight (out, in) and bias (out,) of each layer; SiLU follows every one but the last."""


@dataclass(frozen=True)
class NeuralField:
    """A surface: the image of a base mesh, `verts` (V, 3) in the frame and `faces` (F, 3), under a small network."""

    header: dict[str, Any]
    verts: _Floats
    faces: _Index
    features: NDArray[np.float32]
    layers: Layers
    more: list[NDArray[np.float32]]  # the sections of scalars (`scalar_sections.py`)

    def evaluate(self, corners: _Index, weights: _Floats) -> _Floats:
        """Return points (P, 3) of the surface, in the world, from corners (P, 3) in the base and weights (P, 3)."""
        points = np.einsum("pk,pkc->pc", weights, self.verts[corners])
        features = np.einsum("pk,pkd->pd", weights, self.features[corners])
        waves = [points * (2.0**k * math.pi) for k in range(self.header["octaves"])]
        x = np.concatenate([features, points, *[part for wave in waves for part in (np.sin(wave), np.cos(wave))]], 1)
        moved = points + through(self.layers, x)
        return np.asarray(self.header["centre"] + self.header["scale"] * moved)

    def unfold(self, level: int) -> tuple[_Floats, _Index]:
        """Return the vertices (V', 3) and faces (F 4^level, 3) of a level: each edge in 2^level parts."""
        level_places = level_of(self.faces, len(self.verts), level)
        return self.evaluate(level_places.corners, level_places.weights), level_places.faces


def read_field(data: bytes | Path) -> NeuralField:
    """Read a `.ndf` file.

    Raises
    ------
    ValueError
        The file is damaged, incomplete, or of another version.
    """
    data = data.read_bytes() if isinstance(data, Path) else data
    if data[:3] != b"NDF" or len(data) < 12:
        raise ValueError("The file is not a .ndf.")
    if data[3] != 2:
        raise ValueError(f"The .ndf has version {data[3]}; this reader knows version 2.")
    if zlib.crc32(data[:-4]) != struct.unpack("<I", data[-4:])[0]:
        raise ValueError("The .ndf is damaged or incomplete: its checksum is wrong.")
    try:
        return _read(data)
    except (LookupError, TypeError, StopIteration, RecursionError, zlib.error, json.JSONDecodeError) as error:
        raise ValueError("The .ndf contradicts itself.") from error


def _read(data: bytes) -> NeuralField:
    at = 8 + struct.unpack("<I", data[4:8])[0]
    header = checked_header(json.loads(data[8:at].decode(errors="replace")), len(data) - 4 - at)
    vertices, count = header["vertices"], header["faces"]
    ends = at + np.cumsum([size for size, _ in header["sections"]])
    sections = [_numbers(data[end - size : end], n) for end, (size, n) in zip(ends, header["sections"], strict=True)]
    faces, verts = _base(sections[0], sections[1], vertices, count, header["bits"])
    networks = [header, *header.get("scalars", [])]
    weights, *more = [
        _weights(part, described, vertices) for part, described in zip(sections[2:], networks, strict=True)
    ]
    features, layers = network_of(weights, vertices, header["features"], header["widths"])
    return NeuralField(header, verts, faces, features, layers, more)


def network_of(
    rest: NDArray[np.float32], vertices: int, features: int, widths: list[int]
) -> tuple[NDArray[np.float32], Layers]:
    """Return the features (V, d) and the layers whose numbers follow each other."""
    first, rest = np.split(rest, [vertices * features])
    layers = []
    for before, after in itertools.pairwise(widths):
        weight, bias, rest = np.split(rest, [after * before, after * (before + 1)])
        layers.append((weight.reshape(after, before), bias.reshape(after)))
    if len(rest):
        raise ValueError("A section of the .ndf has more numbers than its network.")
    return first.reshape(vertices, features), layers


def through(layers: Layers, x: _Floats) -> _Floats:
    """Return what the layers make of inputs (P, K)."""
    for weight, bias in layers[:-1]:
        x = x @ weight.T + bias
        x = x / (1 + np.exp(-np.clip(x, -80, 80)))  # SiLU
    return np.asarray(x @ layers[-1][0].T + layers[-1][1])


def _numbers(data: bytes, size: int) -> NDArray[np.uint16]:
    """Unpack a section of 16-bit numbers, whose low bytes come first, then the high ones."""
    out = zlib.decompressobj(-15).decompress(data, size + 1)
    if len(out) != size:
        raise ValueError("A section of the .ndf has another size than stated.")
    return np.frombuffer(np.frombuffer(out, np.uint8).reshape(2, -1).T.tobytes(), "<u2")


def _weights(part: NDArray[Any], described: dict[str, Any], vertices: int) -> NDArray[np.float32]:
    """Return features, weights and biases: whole multiples of steps 2^(n / 4)."""
    counts = [n for before, after in itertools.pairwise(described["widths"]) for n in (after * before, after)]
    channels, others = np.split(2.0 ** (np.array(described["steps"]) / 4), [-len(counts)])
    signed = (part >> 1) ^ -(part & 1).astype(np.int64)  # zigzag
    return np.asarray(signed * np.concatenate([np.tile(channels, vertices), np.repeat(others, counts)]), np.float32)


def _base(codes: NDArray[Any], steps: NDArray[Any], vertices: int, count: int, bits: int) -> tuple[_Index, _Floats]:
    """Decode faces and vertices, in the order in which a walk over the surface meets them."""
    moves = ((steps >> 1) ^ -(steps & 1).astype(np.int64)).reshape(-1, 3)  # zigzag
    symbols = iter(codes.tolist())
    faces, verts, made, done = np.empty((count, 3), np.int64), np.empty((vertices, 3), np.int64), 0, 0
    open_edges: dict[tuple[int, int], int] = {}  # each with the corner of its face that is not on it

    def corner(symbol: int, guess: _Index) -> int:
        nonlocal made
        if symbol == 0:
            verts[made] = guess + moves[made]
            made += 1
            return made - 1
        return made - symbol

    def add(a: int, b: int, c: int) -> None:
        nonlocal done
        faces[done] = a, b, c
        done += 1
        for one, other, rest in ((a, b, c), (b, c, a), (c, a, b)):
            if open_edges.pop((other, one), None) is None:
                open_edges[one, other] = rest

    while done < count:
        if not open_edges:  # the first face of a part
            a = corner(next(symbols), verts[made - 1] if made else np.zeros(3, np.int64))
            b = corner(next(symbols), verts[a])
            add(a, b, corner(next(symbols), verts[b]))
            continue
        edge = next(iter(open_edges))
        rest = open_edges.pop(edge)
        symbol = next(symbols)
        if symbol:  # 0 is a border
            open_edges[edge] = rest  # `add` closes it
            add(edge[1], edge[0], corner(symbol - 1, verts[edge[0]] + verts[edge[1]] - verts[rest]))
    if made < vertices or faces.min() < 0 or (faces == np.roll(faces, 1, 1)).any():
        raise IndexError
    return faces, verts / (2 ** (bits - 1) - 1) - 1
