"""The reader in JavaScript: the same base, the same surface and the same refusals as the one in Python."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from meshdeform.fields.container import encode_base, write_field
from meshdeform.fields.network import FieldNetwork
from meshdeform.fields.reader import read_field
from meshdeform.fields.scalar_fields import learn_scalars
from meshdeform.fields.scalar_sections import read_scalars
from meshdeform.geometry.shapes import grid, icosphere, join, torus

VERSION_1 = Path(__file__).with_name("version_1.ndf")
MODULE = Path(__file__).parents[3] / "service" / "web" / "viewer" / "ndf.js"
SCRIPT = """
const { readField, scalarsAt, unfold } = await import(process.argv[1]);
const apart = (a, b) => Math.max(...a.map((value, i) => Math.abs(value - b[i])));
const { readFileSync } = await import("node:fs");
const data = new Uint8Array(readFileSync(process.argv[2]));
const field = await readField(data);
const { positions, indices, corners: of, weights } = unfold(field, 2);
const scalars = [[0, 0], [0, 1], [1, 0]]
  .map(([i, output]) => Array.from(scalarsAt(field.scalars[i], of, weights, output)));
const simple = apart(scalars[1], scalarsAt(field.scalars[0], of, weights, 1, false));
const plain = apart(positions, unfold(field, 2, false).positions);
data[data.length - 20] ^= 1;
const refused = await readField(data).then(() => "", (error) => error.message);
const old = Array.from(unfold(await readField(new Uint8Array(readFileSync(process.argv[3]))), 1).positions);
const [faces, places, corners] = [field.faces, positions, indices].map((list) => Array.from(list));
const [at, shares] = [of, weights].map((list) => Array.from(list));
const named = field.scalars.map(({ name, labels }) => [name, labels]);
console.log(JSON.stringify({ faces, places, corners, plain, refused, scalars, simple, named, at, shares, old }));
"""


def test_it_unfolds_what_the_reader_in_python_does(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    mesh = join(grid(2), torus(n=7, m=5), icosphere(0))
    verts = mesh.verts.numpy() / mesh.verts.abs().max().item()
    base = encode_base(verts, mesh.faces.numpy())
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
    run = [node, "--input-type=module", "-e", SCRIPT, MODULE.as_uri(), str(file), str(VERSION_1)]
    found = json.loads(subprocess.run(run, capture_output=True, check=True, timeout=120).stdout)
    field = read_field(file)
    wanted_verts, wanted_faces = field.unfold(2)
    places, corners = np.reshape(found["places"], (-1, 3)), np.reshape(found["corners"], (-1, 3))
    assert (np.reshape(found["faces"], (-1, 3)) == field.faces).all()
    assert places.shape == wanted_verts.shape

    def centres(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
        middle = points[faces].mean(1)
        return middle[np.lexsort(middle.round(4).T)]

    assert np.abs(centres(places, corners) - centres(wanted_verts, wanted_faces)).max() < 1e-4
    assert found["plain"] < 1e-5, "with WebAssembly and without"
    assert "checksum" in found["refused"]
    old = read_field(VERSION_1).unfold(1)[0]
    assert np.reshape(found["old"], (-1, 3)).sum(0) == pytest.approx(old.sum(0), abs=1e-3)

    of, shares = (np.reshape(found[name], (-1, 3)) for name in ("at", "shares"))
    two, pieces = read_scalars(field)
    assert found["named"] == [["two", []], ["scalars", list(range(7))]]
    assert np.abs(np.transpose(found["scalars"][:2]) - two.values(of, shares)).max() < 1e-3
    wanted = pieces.pieces(of, shares)
    assert len(np.unique(wanted)) > 2
    assert (np.array(found["scalars"][2]) == wanted).mean() > 0.999
    assert found["simple"] < 1e-4
