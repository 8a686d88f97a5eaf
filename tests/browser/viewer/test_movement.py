"""What moves in the viewer: the way to a result."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from meshdeform.assets import load_asset
from meshdeform.assets.build import build_glb
from meshdeform.requests.document import MorphPath
from meshdeform.runs.strength import AssetPath, write_morph
from tests.browser.viewer.assets import FACES, NORMALS, VERTS
from tests.browser.viewer.site import ViewerSite

if TYPE_CHECKING:
    from playwright.sync_api import Page


def turned(degrees: float) -> NDArray[np.float64]:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return VERTS.astype(np.float64) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def played(page: Page, times: list[float]) -> dict[str, Any]:
    """Play morph.glb in three.js: the shape at rest and at these times, and what the file names."""
    found: dict[str, Any] = page.evaluate(
        """async (times) => {
          const [{ GLTFLoader }, { AnimationMixer, Vector3 }] = await Promise.all([
            import("/web/vendor/three/addons/loaders/GLTFLoader.js"), import("/web/vendor/three/three.module.js"),
          ]);
          const file = await fetchBytes("/files/morph.glb");
          const { scene: root, animations } = await new GLTFLoader().parseAsync(file, "");
          const mesh = root.getObjectByProperty("isMesh", true);
          const at = () => Array.from({ length: mesh.geometry.attributes.position.count }, (_, i) =>
            mesh.getVertexPosition(i, new Vector3()).toArray());
          const mixer = new AnimationMixer(root);
          const [still, clip] = [at(), animations[0]];
          mixer.clipAction(clip).play();
          const shapes = times.map((time) => { mixer.setTime(time); return at(); });
          const targets = Object.keys(mesh.morphTargetDictionary);
          return { still, shapes, name: clip.name, duration: clip.duration, targets };
        }""",
        times,
    )
    return found


def test_three_plays_a_morph_through_its_frames(page: Page, site: ViewerSite) -> None:
    source = load_asset(build_glb(VERTS, FACES, normals=NORMALS))
    path = AssetPath(source, turned(120))
    site.files["morph.glb"] = write_morph(source, path, path.at(1), MorphPath(frames=8, seconds=2.0, ping_pong=True))
    found = played(page, [0, 0.5, 1, 1.9999, 3])
    assert (found["name"], found["duration"]) == ("deform", pytest.approx(4.0))
    assert found["targets"] == [*(f"deform {k}/8" for k in range(1, 8)), "deform"]
    np.testing.assert_allclose(found["still"], turned(120), atol=1e-5)
    for shape, degrees in zip(found["shapes"], (0, 30, 60, 120, 60), strict=True):
        np.testing.assert_allclose(shape, turned(degrees), atol=1e-3)
