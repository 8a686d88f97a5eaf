"""`.ndf` files: what is written is read, and what is damaged is refused."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import torch

import meshdeform.fields.reader
from meshdeform.fields.container import encode_base, write_field
from meshdeform.fields.gluing import glue, topology
from meshdeform.fields.network import FieldNetwork
from meshdeform.fields.reader import read_field
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import grid, icosphere, join, torus


def field_of(mesh: TriangleMesh) -> tuple[bytes, FieldNetwork]:
    verts = mesh.verts.numpy() / mesh.verts.abs().max().item()
    base = encode_base(verts, mesh.faces.numpy())
    network = FieldNetwork.random(len(base.verts), 6, 3, 16, 2, 0)
    # What the file can hold exactly.
    network = FieldNetwork(
        network.features.half().float(), [(w.half().float(), b.half().float()) for w, b in network.layers], 3
    )
    return write_field(base, network, centre=np.array([1.0, 2.0, 3.0]), scale=2.0), network


def test_a_base_of_any_topology_comes_back_within_half_a_step() -> None:
    for mesh in (icosphere(1), torus(n=9, m=5), grid(3), join(grid(2), torus(n=6, m=4), icosphere(0))):
        data, _ = field_of(mesh)
        found = read_field(data)
        verts, faces = mesh.verts.numpy() / mesh.verts.abs().max().item(), mesh.faces.numpy()
        assert topology(found.faces, glue(found.verts, found.faces)) == topology(faces, glue(verts, faces))

        def centres(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
            middle = points[corners].mean(1)
            return middle[np.lexsort(middle.round(2).T)]

        assert np.abs(centres(found.verts, found.faces) - centres(verts, faces)).max() < 1 / 4095


def test_the_reader_computes_what_the_network_does() -> None:
    data, network = field_of(torus(n=8, m=5))
    found = read_field(data)
    random = np.random.default_rng(0)
    corners = found.faces[random.integers(0, len(found.faces), 50)]
    weights = random.dirichlet([1, 1, 1], 50)
    points = torch.from_numpy(np.einsum("pk,pkc->pc", weights, found.verts[corners])).float()
    features = torch.from_numpy(np.einsum("pk,pkd->pd", weights, network.features.numpy()[corners])).float()
    wanted = np.array([1.0, 2.0, 3.0]) + 2.0 * network(points, features).double().numpy()
    assert np.abs(found.evaluate(corners, weights) - wanted).max() < 1e-5


def test_every_damaged_byte_is_noticed() -> None:
    data, _ = field_of(icosphere(0))
    for at in range(0, len(data), 37):
        damaged = bytearray(data)
        damaged[at] ^= 1
        with pytest.raises(ValueError, match=r"not a \.ndf|version|damaged"):
            read_field(bytes(damaged))
    for length in (0, 3, 4, 11, len(data) // 2):
        with pytest.raises(ValueError, match=r"not a \.ndf|damaged"):
            read_field(data[:length])


def test_a_section_that_unpacks_to_more_than_stated_is_refused() -> None:
    data, _ = field_of(icosphere(0))
    length = struct.unpack("<I", data[4:8])[0]
    header = json.loads(data[8 : 8 + length])
    header["sections"][0][1] -= 2
    text = json.dumps(header).encode()
    body = data[:4] + struct.pack("<I", len(text)) + text + data[8 + length : -4]
    with pytest.raises(ValueError, match="another size"):
        read_field(body + struct.pack("<I", zlib.crc32(body)))


def test_the_reader_is_short() -> None:
    source = Path(meshdeform.fields.reader.__file__).read_text(encoding="utf-8")
    assert len(source.splitlines()) <= 150
    assert "torch" not in source
