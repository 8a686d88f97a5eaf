"""The loader of `.ndf` for three.js, laid out as its package has it, in a page with nothing else."""

from __future__ import annotations

import json
import mimetypes
from pathlib import Path

import numpy as np
import pytest
import torch
from playwright.sync_api import Browser, Route

from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.srgb import linear_from_srgb
from meshdeform.kinds.surface_fit.container import encode_base, write_field
from meshdeform.kinds.surface_fit.network import FieldNetwork
from meshdeform.kinds.surface_fit.reader import read_field
from meshdeform.kinds.surface_fit.scalar_fields import ScalarField
from meshdeform.kinds.surface_fit.scalar_sections import colours_at

PAGE = """<!doctype html><canvas width="300" height="300"></canvas>
<script type="importmap">{"imports": {"three": "/three.module.js"}}</script>
<script type="module">
import { PerspectiveCamera, MeshNormalMaterial, Scene, WebGLRenderer } from "three";
import { NDFLoader, NDFMesh } from "/NDFLoader.js";
const geometry = await new NDFLoader().setLevel(1).loadAsync("/surface.ndf");
const missing = await new NDFLoader().loadAsync("/PAGE").then(() => "", (error) => error.message);
const mesh = new NDFMesh(geometry.userData.field, new MeshNormalMaterial());
const camera = new PerspectiveCamera(40, 1, 0.1, 10_000);
const renderer = new WebGLRenderer({ canvas: document.querySelector("canvas") });
const scene = new Scene().add(mesh);
const seen = [3000, 3].map((away) => {
  const { center, radius } = mesh.levels[0].boundingSphere;
  camera.position.set(center.x, center.y, center.z + away * radius);
  renderer.render(scene, camera);
  return mesh.geometry.userData.level;
});
const list = (name) => Array.from(geometry.getAttribute(name).array);
const faces = Array.from(geometry.index.array);
window.found = { seen, missing, faces, places: list("position"), normals: list("normal"), colours: list("color") };
</script>"""


def small_field() -> bytes:
    """Return the field of a base of twenty faces."""
    ball = icosphere(0)
    base = encode_base(ball.verts, ball.faces)
    network = FieldNetwork.random(len(base.verts), features=1, octaves=1, width=4, depth=1, seed=0)
    random = torch.Generator().manual_seed(1)
    tensors = [torch.randn(size, generator=random) for size in ((len(base.verts), 3), (4, 3), (4,), (3, 4), (3,))]
    colour = ScalarField("colour", tensors, np.full(3, 0.5), np.full(3, 0.3))
    return write_field(base, network, centre=np.array([1.0, 2.0, 3.0]), scale=2.0, scalars=[colour])


def test_a_bare_page_loads_a_field_and_takes_the_level_that_it_needs(
    browser: Browser, repository: Path, tmp_path: Path
) -> None:
    web = repository / "service/web"
    files = {path.name: path for path in [*(web / "viewer").glob("ndf*.js"), *(web / "vendor/three").glob("*.js")]}
    files["NDFLoader.js"] = repository / "clients/ndf/NDFLoader.js"
    files["surface.ndf"] = tmp_path / "surface.ndf"
    files["surface.ndf"].write_bytes(small_field())

    def answer(route: Route) -> None:
        path = files.get(route.request.url.rsplit("/", 1)[1])
        body = path.read_bytes() if path else PAGE.encode()
        kind = mimetypes.guess_type(path.name)[0] if path else "text/html"
        route.fulfill(body=body, content_type=kind or "application/octet-stream")

    page = browser.new_page()
    try:
        page.route("**/*", answer)
        page.goto("http://bare.test/")
        page.wait_for_function("window.found")
        found = page.evaluate("window.found")
    finally:
        page.close()
    field = read_field(files["surface.ndf"])
    verts, faces = field.unfold(1)
    seen, wanted = np.reshape(found["colours"], (-1, 3)), linear_from_srgb(colours_at(field, 1) / 255)
    assert np.ptp(wanted, axis=0).min() > 0.1
    assert np.sort(seen.clip(0, 1), 0) == pytest.approx(np.sort(wanted, 0), abs=0.01)
    places, normals = (np.reshape(found[name], (-1, 3)) for name in ("places", "normals"))
    assert places.shape == verts.shape
    assert len(found["faces"]) == faces.size
    # Both number the vertices of a level alike up to those within a face.
    assert np.sort(places, 0) == pytest.approx(np.sort(verts, 0), abs=1e-4 * np.abs(verts).max())
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1, abs=1e-5)
    assert found["missing"] == "The file is not a .ndf."
    far, near = found["seen"]
    assert far == 0 < near
    package = json.loads((repository / "clients/ndf/package.json").read_text())
    assert package["exports"]["./NDFLoader.js"] == "./NDFLoader.js"
