"""The reader in JavaScript: the same base, the same surface and the same refusals as the one in Python."""

from __future__ import annotations

import copy
import json
import shutil
import struct
import subprocess
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from meshdeform.geometry.shapes import icosphere, join
from meshdeform.kinds.surface_fit.container import encode_base, write_field
from meshdeform.kinds.surface_fit.network import FieldNetwork
from meshdeform.kinds.surface_fit.reader import read_field
from meshdeform.kinds.surface_fit.scalar_fields import learn_scalars
from meshdeform.kinds.surface_fit.scalar_sections import read_scalars
from training.shapes import grid, torus

REFUSE = """
const { readField } = await import(process.argv[1]);
const { readFileSync } = await import("node:fs");
const said = [];
for (const file of process.argv.slice(2))
  said.push(await readField(new Uint8Array(readFileSync(file))).then(() => "read", (error) => error.message));
console.log(JSON.stringify(said));
"""
MODULE = Path(__file__).parents[4] / "service" / "web" / "viewer" / "ndf.js"
SCRIPT = """
const { readField, scalarsAt, unfold } = await import(process.argv[1]);
const { readFileSync } = await import("node:fs");
const data = new Uint8Array(readFileSync(process.argv[2]));
const field = await readField(data);
const { positions, indices, corners: of, weights } = unfold(field, 2);
const scalars = [[0, 0], [0, 1], [1, 0]]
  .map(([i, output]) => Array.from(scalarsAt(field.scalars[i], of, weights, output)));
data[data.length - 20] ^= 1;
const refused = await readField(data).then(() => "", (error) => error.message);
const [faces, places, corners] = [field.faces, positions, indices].map((list) => Array.from(list));
const [at, shares] = [of, weights].map((list) => Array.from(list));
const named = field.scalars.map(({ name, labels }) => [name, labels]);
console.log(JSON.stringify({ faces, places, corners, refused, scalars, named, at, shares }));
"""


def test_it_unfolds_what_the_reader_in_python_does(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    mesh = join(grid(2), torus(n=7, m=5), icosphere(0))
    verts = mesh.verts / np.abs(mesh.verts).max()
    base = encode_base(verts, mesh.faces)
    network = FieldNetwork.random(len(base.verts), 5, 3, 12, 2, 1)
    file = tmp_path / "surface.ndf"
    random = np.random.default_rng(0)
    corners, weights = base.faces[random.integers(0, len(base.faces), 200)], random.dirichlet([1, 1, 1], 200)
    known = random.normal(size=(200, 2))
    scalars = [
        learn_scalars(base.verts, corners, weights, known * 3 + 5, name="two", steps=3),
        learn_scalars(base.verts, corners, weights, np.eye(7)[random.integers(0, 7, 200)], labels=range(7), steps=30),
    ]
    place = {"centre": np.array([1.0, -2.0, 3.0]), "scale": 2.5}
    file.write_bytes(write_field(base, network, **place, scalars=scalars))
    run = [node, "--input-type=module", "-e", SCRIPT, MODULE.as_uri(), str(file)]
    found = json.loads(subprocess.run(run, capture_output=True, check=True, timeout=240).stdout)
    field = read_field(file)
    wanted_verts, wanted_faces = field.unfold(2)
    places, corners = np.reshape(found["places"], (-1, 3)), np.reshape(found["corners"], (-1, 3))
    assert (np.reshape(found["faces"], (-1, 3)) == field.faces).all()
    assert places.shape == wanted_verts.shape

    def centres(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
        middle = points[faces].mean(1)
        return middle[np.lexsort(middle.round(4).T)]

    assert np.abs(centres(places, corners) - centres(wanted_verts, wanted_faces)).max() < 1e-4
    assert "checksum" in found["refused"]

    of, shares = (np.reshape(found[name], (-1, 3)) for name in ("at", "shares"))
    two, pieces = read_scalars(field)
    assert found["named"] == [["two", []], ["scalars", list(range(7))]]
    assert np.abs(np.transpose(found["scalars"][:2]) - two.values(of, shares)).max() < 1e-3
    wanted = pieces.pieces(of, shares)
    assert len(np.unique(wanted)) > 2
    assert (np.array(found["scalars"][2]) == wanted).mean() > 0.999


def sealed(data: bytes, header: bytes, sections: bytes | None = None) -> bytes:
    """Return a file with another header, or other sections too, and the checksum of that."""
    end = 8 + struct.unpack("<I", data[4:8])[0]
    body = data[:4] + struct.pack("<I", len(header)) + header + (data[end:-4] if sections is None else sections)
    return body + struct.pack("<I", zlib.crc32(body))


def deflated(data: bytes) -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    return packer.compress(data) + packer.flush()


def test_both_readers_refuse_a_file_that_lies_below_a_good_checksum(tmp_path: Path) -> None:
    node = shutil.which("node")
    mesh = icosphere(0)
    base = encode_base(mesh.verts / 2, mesh.faces)
    places = np.zeros((9, 3), np.int64), np.full((9, 3), 1 / 3)
    scalars = [learn_scalars(base.verts, *places, np.zeros((9, 2)), name="two", steps=1)]
    network = FieldNetwork.random(len(base.verts), 2, 1, 4, 1, 0)
    good = write_field(base, network, centre=np.zeros(3), scale=1.0, scalars=scalars)
    end = 8 + struct.unpack("<I", good[4:8])[0]
    known = json.loads(good[8:end])
    changes: list[Callable[[dict[str, Any]], object]] = [
        lambda h: h.update(faces=10**9, vertices=10**9),
        lambda h: h.update(faces=-1),
        lambda h: h.update(vertices=11),
        lambda h: h.update(vertices=12.5),
        lambda h: h.update(vertices="12"),
        lambda h: h.update(bits=10**9),
        lambda h: h.update(octaves=10**9),
        lambda h: h.update(features=10**12),
        lambda h: h.update(widths=[11, 10**9, 3]),
        lambda h: h.update(widths=[11, 4, 4]),
        lambda h: h.update(widths=[11]),
        lambda h: h["steps"].append(0),
        lambda h: h.pop("steps"),
        lambda h: h["steps"].__setitem__(0, 10**6),
        lambda h: h.update(centre=[0, 0]),
        lambda h: h.update(centre=[0, 0, None]),
        lambda h: h.update(scale="1"),
        lambda h: h.update(sections=h["sections"][:2]),
        lambda h: h.update(sections=5),
        lambda h: h["sections"][0].__setitem__(0, -5),
        lambda h: h["sections"][0].__setitem__(1, 2**40),
        lambda h: h["sections"][2].__setitem__(1, 2**40),
        lambda h: h["sections"][3].__setitem__(0, h["sections"][3][0] - 1),
        lambda h: h.update(scalars=h["scalars"] * 100),
        lambda h: h.update(scalars=[{}]),
        lambda h: h["scalars"][0].update(offset=[0]),
        lambda h: h["scalars"][0].update(labels=[1]),
        lambda h: h["scalars"][0].update(widths=[8, 10**9, 2]),
        lambda h: h.pop("sections"),
    ]
    files = {"a header of nothing": sealed(good, b"{}"), "deep": sealed(good, b"[" * 100_000)}
    files |= {"no JSON": sealed(good, b"\xff\xfe"), "a list": sealed(good, b"[]"), "null": sealed(good, b"null")}
    for number, change in enumerate(changes):
        header = copy.deepcopy(known)
        change(header)
        files[f"change {number}"] = sealed(good, json.dumps(header).encode())
    # A walk that names corners which are not there, and one that ends too soon.
    parts = np.cumsum([0, *[packed for packed, _ in known["sections"]]]) + end
    for name, symbols in (("corners", np.full(20, 999, "<u2")), ("end", np.zeros(20, "<u2"))):
        walk = deflated(np.frombuffer(symbols.tobytes(), np.uint8).reshape(-1, 2).T.tobytes())
        header = copy.deepcopy(known)
        header["sections"][0] = [len(walk), 40]
        files[name] = sealed(good, json.dumps(header).encode(), walk + good[parts[1] : -4])
    # What unpacks to gigabytes is stopped at the size that the header may state.
    bomb = deflated(bytes(40_000_000))
    header = copy.deepcopy(known)
    header["sections"][0] = [len(bomb), 40]
    files["bomb"] = sealed(good, json.dumps(header).encode(), bomb + good[parts[1] : -4])
    assert read_field(sealed(good, json.dumps(known).encode())).header == known
    for name, data in files.items():
        with pytest.raises(ValueError, match=r"contradicts itself|impossible counts|another size"):
            pytest.fail(f"{name} was read: {read_field(data)}")
    if node is None:
        pytest.skip("node is not installed")
    paths = [tmp_path / f"{number}.ndf" for number in range(len(files) + 1)]
    for path, data in zip(paths, [*files.values(), good], strict=True):
        path.write_bytes(data)
    run = [node, "--input-type=module", "-e", REFUSE, MODULE.as_uri(), *map(str, paths)]
    *said, last = json.loads(subprocess.run(run, capture_output=True, check=True, timeout=240).stdout)
    assert last == "read"
    for name, words in zip(files, said, strict=True):
        assert any(part in words for part in ("contradicts itself", "impossible counts", "another size")), (name, words)
