"""The viewer poses an asset by its clips, on its own rig and on that of its result."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image, ImageSequence

from meshdeform.assets import load_asset
from tests.browser.viewer.assets import rigged
from tests.browser.viewer.site import ViewerSite
from tests.unit.assets.playing import Player

if TYPE_CHECKING:
    from playwright.sync_api import Page

NODE = 2  # that of the mesh
_POSED = """
  const { Vector3 } = await import("/web/vendor/three/three.module.js");
  const posed = (viewer, clip, time) => {
    viewer.pose(clip, time);
    const mesh = meshOf(viewer);
    viewer.root.updateMatrixWorld(true);
    const at = (v) => mesh.getVertexPosition(v, new Vector3()).applyMatrix4(mesh.matrixWorld).toArray();
    return Array.from({ length: mesh.geometry.attributes.position.count }, (_, v) => at(v));
  };
"""


@pytest.fixture
def files(site: ViewerSite) -> tuple[bytes, bytes]:
    """A rigged asset and its result, which the site has as well."""
    made = rigged()
    site.files["rigged.glb"], site.files["taller.glb"] = made
    return made


def test_a_result_plays_on_its_own_rig_and_its_source_on_that_of_the_source(
    page: Page, files: tuple[bytes, bytes]
) -> None:
    found: dict[str, Any] = page.evaluate(
        f"""async () => {{
          {_POSED}
          const [both, alone] = [await show("rigged.glb", "glb", "taller.glb"), await show("taller.glb")];
          const found = {{ clips: both.clips }};
          both.setWireframe(true);
          for (const share of [0, 1, 0.5]) {{
            both.setMorph(share);
            found[share] = [posed(both, "Wave", 0.5), posed(both, "Step aside", 0.5), posed(both, null)];
          }}
          found.alone = [posed(alone, "Wave", 0.5), posed(alone, "Step aside", 0.5), posed(alone, null)];
          both.clearDeformed();
          found.cleared = posed(both, "Step aside", 0.5);
          await drawn();
          return found;
        }}"""
    )
    assert found["clips"] == [{"name": "Wave", "seconds": 1}, {"name": "Step aside", "seconds": 1}]
    wave, step, rest = (np.array(moment) for moment in found["alone"])
    np.testing.assert_allclose(np.array(found["1"]), [wave, step, rest], atol=1e-6)
    np.testing.assert_allclose(wave, Player(files[1]).at(0.5, NODE).verts, atol=1e-6)
    source = [Player(files[0], number).at(0.5, NODE).verts for number in (0, 1)]
    np.testing.assert_allclose(found["0"][0], source[0], atol=1e-6)
    assert np.abs(np.array(found["0"][1]) - source[1]).max() > 0.1, "the morph target counts"
    np.testing.assert_allclose(found["cleared"], found["0"][1], atol=1e-6)
    # Where joints only move, halfway of the rigs is halfway of the shapes.
    np.testing.assert_allclose(found["0.5"][2], np.mean([found["0"][2], rest], axis=0), atol=1e-6)


def test_what_is_measured_is_the_rest_and_the_camera_takes_a_clip_as_a_whole(
    page: Page, files: tuple[bytes, bytes]
) -> None:
    moments: list[dict[str, Any]] = page.evaluate(
        """async () => {
          const viewer = await show("rigged.glb", "glb", "taller.glb");
          const moments = [];
          for (const [clip, time] of [[null, 0], ["Step aside", 0], ["Step aside", 0.5]]) {
            viewer.pose(clip, time);
            // As a new shape comes while the clip is on.
            await viewer.setDeformed(await fetchBytes("/files/taller.glb"));
            viewer.setMorph(1);
            await drawn();
            const [{ position, target }, ground] = [viewer.rig.state, viewer.stage.ground.position.y];
            const reach = viewer.ownBox.max.x - viewer.ownBox.min.x;
            moments.push({ ground, reach, camera: [...position, ...target], seen: covered(pixels(viewer)) });
          }
          return moments;
        }"""
    )
    rest, begun, aside = moments
    for moment in (begun, aside):
        assert moment["ground"] == pytest.approx(rest["ground"], abs=1e-6)
        assert moment["reach"] > rest["reach"] + 0.35
    assert aside["camera"] == pytest.approx(begun["camera"], abs=1e-9)
    assert aside["seen"] != begun["seen"]


def test_tints_and_the_pointer_meet_the_pose_and_faces_keep_their_places(
    page: Page, files: tuple[bytes, bytes]
) -> None:
    found = page.evaluate(
        f"""async () => {{
          {_POSED}
          const viewer = await show("rigged.glb");
          const tools = new ControlTools(viewer, {{}});
          viewer.pose("Wave", 0.5);
          tools.setSurface(viewer.atRest(() => numberedSurface(viewer.root)));
          tools.showPart(new Uint8Array(tools.surface.count).fill(1));
          const found = {{ waving: [...tools.surface.shown], atRest: [...tools.surface.rest] }};
          found.posed = posed(viewer, "Wave", 0.5).flat();
          found.aside = posed(viewer, "Step aside", 0.5).flat();
          found.followed = [...tools.surface.shown];
          tools.use("box");
          found.rest = [...tools.surface.shown];
          tools.dispose();
          return found;
        }}"""
    )
    source = load_asset(files[0]).surface.positions
    np.testing.assert_allclose(found["waving"], found["posed"], atol=1e-6)
    np.testing.assert_allclose(found["followed"], found["aside"], atol=1e-6)
    for name in ("atRest", "rest"):
        np.testing.assert_allclose(np.reshape(found[name], (-1, 3)), source, atol=1e-6)


def test_the_way_to_a_shape_is_no_clip(page: Page, site: ViewerSite, files: tuple[bytes, bytes]) -> None:
    asset = load_asset(files[0])
    site.files["morph.glb"] = asset.replace(asset.surface.positions * 2, morph=True)
    names = "async () => (await show('morph.glb')).clips.map(({ name }) => name)"
    assert page.evaluate(names) == ["Wave", "Step aside"]


def test_clips_are_driven_by_keys_and_a_turntable_is_saved_while_one_plays(
    page: Page, files: tuple[bytes, bytes]
) -> None:
    found: dict[str, Any] = page.evaluate(
        """async () => {
          const { mountClips } = await import("/web/viewer/clips.js");
          Object.assign(window, { MediaRecorder: undefined });
          const viewers = [await show("rigged.glb"), await show("rigged.glb", "glb", "taller.glb")];
          const host = document.createElement("div");
          document.body.append(host);
          const saved = new Promise((resolve, reject) => {
            window.moving = mountClips(host, viewers, { save: (...file) => resolve(file), failed: reject });
          });
          const { player } = window.moving;
          const event = (key) => new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true });
          const press = (element, key) => element.dispatchEvent(event(key));
          const now = () => [player.choice.value, Number(player.slider.value), player.button.title];
          const { container } = viewers[0].surface;
          const moments = [now()];
          for (const key of [".", ".", ",", ","]) moments.push((press(container, key), now()));
          for (const key of ["ArrowRight", "ArrowLeft"]) moments.push((press(player.slider, key), now()));
          moments.push((press(container, " "), now()));
          const buttons = [...host.querySelectorAll(".turntable button")];
          buttons[0].click();
          const [file, ending] = await saved;
          moments.push((press(container, " "), now()));
          const text = host.textContent;
          window.moving.dispose();
          press(container, " ");
          const gif = Array.from(new Uint8Array(await file.arrayBuffer()));
          const names = buttons.map((button) => button.textContent);
          return { moments, names, text, ending, gif, left: host.childElementCount };
        }"""
    )
    frame = pytest.approx(1 / 30)
    rest, first, second, back, start, on, again, plays, paused = found["moments"]
    assert (rest, first, back) == (["", 0, "Play"], ["Wave", frame, "Play"], ["Wave", frame, "Play"])
    assert (second, start) == (["Wave", pytest.approx(2 / 30), "Play"], ["Wave", 0, "Play"])
    assert (on, again) == (first, start)
    assert (plays[2], paused[2], found["left"]) == ("Pause", "Play", 0)
    assert (found["names"], found["ending"]) == (["GIF"], "gif")
    assert "This browser records no video." in found["text"]
    with Image.open(io.BytesIO(bytes(found["gif"]))) as turning:
        frames = [np.asarray(each.convert("RGB"), np.int16) for each in ImageSequence.Iterator(turning)]
        assert (len(frames), turning.size, turning.info["loop"], turning.info["duration"]) == (12, (96, 96), 0, 60)
    halves = (np.abs(frames[0] - frames[6]).max(2) > 24).mean()
    assert halves > 0.02, "after half a turn the box would look the same, did the clip not play meanwhile"
