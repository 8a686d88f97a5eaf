"""A decoder written from the text of docs/surface_fit.md ("The file") alone makes the same points as the reader."""

from __future__ import annotations

import json
import struct
import zlib

import numpy as np
import pytest
import torch

from meshdeform.geometry.shapes import icosphere, join
from meshdeform.kinds.surface_fit.container import encode_base, write_field
from meshdeform.kinds.surface_fit.network import FieldNetwork
from meshdeform.kinds.surface_fit.reader import read_field
from training.shapes import grid, torus


def zigzag(n: int) -> int:
    return -(n + 1) // 2 if n % 2 else n // 2


class Decoder:
    """Nothing here is from the product."""

    def __init__(self, data: bytes) -> None:
        assert data[:4] == b"NDF\x02"
        (length,) = struct.unpack("<I", data[4:8])
        assert struct.unpack("<I", data[-4:]) == (zlib.crc32(data[:-4]),)
        self.header = json.loads(data[8 : 8 + length])
        sections, at = [], 8 + length
        for packed, unpacked in self.header["sections"]:
            raw = zlib.decompress(data[at : at + packed], -15)
            assert len(raw) == unpacked
            half = unpacked // 2
            sections.append([raw[i] + 256 * raw[half + i] for i in range(half)])
            at += packed
        self._base(sections[0], [zigzag(n) for n in sections[1]])
        self._network([zigzag(n) for n in sections[2]])

    def _base(self, walk: list[int], moves: list[int]) -> None:
        numbers, queue = iter(walk), {}
        self.faces: list[tuple[int, int, int]] = []
        places: list[list[int]] = []

        def corner(n: int, guess: list[int]) -> int:
            if n:
                return len(places) - n
            places.append([g + moves[3 * len(places) + axis] for axis, g in enumerate(guess)])
            return len(places) - 1

        def face(x: int, y: int, z: int) -> None:
            self.faces.append((x, y, z))
            for one, other, third in ((x, y, z), (y, z, x), (z, x, y)):
                if (other, one) in queue:
                    del queue[other, one]
                else:
                    queue[one, other] = third

        while len(self.faces) < self.header["faces"]:
            if not queue:
                a = corner(next(numbers), places[-1] if places else [0, 0, 0])
                b = corner(next(numbers), places[a])
                face(a, b, corner(next(numbers), places[b]))
                continue
            (a, b), r = next(iter(queue.items()))
            n = next(numbers)
            if n == 0:
                del queue[a, b]
            else:
                face(b, a, corner(n - 1, [places[a][i] + places[b][i] - places[r][i] for i in range(3)]))
        self.frame = np.array(places) / (2 ** (self.header["bits"] - 1) - 1) - 1

    def _network(self, values: list[int]) -> None:
        vertices, each = self.header["vertices"], self.header["features"]
        steps = [2 ** (n / 4) for n in self.header["steps"]]
        self.features = np.array(values[: vertices * each]).reshape(vertices, each) * steps[:each]
        rest, steps, self.layers = values[vertices * each :], steps[each:], []
        for inputs, outputs in zip(self.header["widths"], self.header["widths"][1:], strict=False):
            matrix = np.array(rest[: inputs * outputs]).reshape(outputs, inputs) * steps[0]
            bias = np.array(rest[inputs * outputs : (inputs + 1) * outputs]) * steps[1]
            rest, steps = rest[(inputs + 1) * outputs :], steps[2:]
            self.layers.append((matrix, bias))

    def point(self, face: int, weights: list[float]) -> np.ndarray:
        corners = list(self.faces[face])
        p, z = np.array(weights) @ self.frame[corners], np.array(weights) @ self.features[corners]
        x = np.concatenate(
            [z, p, *[f(2**k * np.pi * p) for k in range(self.header["octaves"]) for f in (np.sin, np.cos)]]
        )
        for matrix, bias in self.layers[:-1]:
            x = matrix @ x + bias
            x = x / (1 + np.exp(-x))
        matrix, bias = self.layers[-1]
        return np.array(self.header["centre"]) + self.header["scale"] * (p + matrix @ x + bias)


def test_a_decoder_made_from_the_page_agrees_with_the_reader() -> None:
    """Closed, with a handle and open, in one file."""
    mesh = join(join(icosphere(1), torus(n=8, m=6)), grid(3))
    verts = mesh.verts.numpy()
    base = encode_base(verts / np.abs(verts).max(), mesh.faces.numpy())
    field = FieldNetwork.random(len(base.verts), features=4, octaves=3, width=8, depth=2, seed=0)
    for tensor in field.tensors:
        tensor.copy_(torch.randn(tensor.shape, generator=torch.Generator().manual_seed(tensor.numel())))
    data = write_field(base, field, centre=np.array([1.0, -2.0, 3.0]), scale=2.5)
    ours, theirs = Decoder(data), read_field(data)
    assert ours.faces == [tuple(face) for face in theirs.faces.tolist()]
    weights = [0.5, 0.3, 0.2]
    found = np.array([ours.point(face, weights) for face in range(len(ours.faces))])
    wanted = theirs.evaluate(theirs.faces, np.tile(weights, (len(ours.faces), 1)))
    assert found == pytest.approx(wanted, abs=1e-6 * np.abs(wanted).max())
