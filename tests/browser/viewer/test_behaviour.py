"""How the viewer behaves, in a real browser under the page's own policy: steered, resized, freed."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import pytest

from meshdeform.assets import build_glb
from tests.browser.conftest import Watch
from tests.browser.viewer.assets import FACES, VERTS, kind
from tests.browser.viewer.site import ViewerSite

if TYPE_CHECKING:
    from playwright.sync_api import Page


def test_the_keyboard_turns_moves_zooms_and_resets(page: Page) -> None:
    page.evaluate("async () => { window.v = await show('source.glb'); v.home = JSON.stringify(v.rig.state); }")
    viewer = page.get_by_label("source.glb")
    viewer.focus()
    assert viewer.evaluate("(element) => document.getElementById(element.getAttribute('aria-describedby')).textContent")
    state = "JSON.parse(JSON.stringify(v.rig.state))"
    last = page.evaluate(state)
    for key in ["ArrowRight", "ArrowUp", "Shift+ArrowLeft", "Shift+ArrowDown", "+", "-", "-"]:
        before = page.evaluate("() => { window.before = pixels(v); }")
        viewer.press(key)
        now = page.evaluate(state)
        assert now != last, key
        # Each frame may round what it does not move.
        assert (now["target"] != pytest.approx(last["target"], abs=1e-9)) == key.startswith("Shift"), key
        last = now
        assert page.evaluate("async () => { await drawn(); return difference(before, pixels(v)); }") > 20, key
        assert before is None
    viewer.press("0")
    home = page.evaluate("JSON.parse(v.home)")
    assert page.evaluate(state)["position"] == pytest.approx(home["position"])


def test_linked_cameras_move_together(page: Page) -> None:
    found = page.evaluate(
        """async () => {
          const [a, b] = [await show("source.glb"), await show("bent.glb")];
          const far = (x, y) => Math.hypot(...x.rig.state.position.map((value, i) => value - y.rig.state.position[i]));
          const apart = far(a, b);
          linkCameras(a, b);
          const joined = far(a, b);
          const before = pixels(b);
          a.rig.rotate(0.6, 0.2);
          const followed = far(a, b);
          await drawn();
          const changed = difference(before, pixels(b));
          b.rig.zoom(2);
          const back = far(a, b);
          a.resetView();
          const home = [far(a, b), a.rig.touched, b.rig.touched];
          return { apart, joined, followed, changed, back, home };
        }"""
    )
    assert found["apart"] > 0.01  # the bent box is wider
    for moment in ("joined", "followed", "back"):
        assert found[moment] == pytest.approx(0, abs=1e-9), moment
    assert found["home"] == [pytest.approx(0, abs=1e-9), False, False]
    assert found["changed"] > 250


def test_a_drag_turns_and_the_wheel_waits_for_the_focus(page: Page) -> None:
    page.evaluate("async () => { window.v = await show('source.glb'); window.at = () => v.rig.state.position.join(); }")
    frame = page.get_by_label("source.glb").bounding_box()
    assert frame is not None
    x, y = frame["x"] + frame["width"] / 2, frame["y"] + frame["height"] / 2
    start = page.evaluate("at()")
    page.mouse.move(x, y)
    page.mouse.wheel(0, 200)
    page.evaluate("drawn()")
    assert page.evaluate("at()") == start
    page.mouse.down()
    page.mouse.move(x + 60, y, steps=4)
    page.mouse.up()
    page.wait_for_function("(start) => at() !== start", arg=start)
    turned = page.evaluate("Math.hypot(...v.rig.state.position)")
    page.mouse.wheel(0, 400)
    page.wait_for_function("(turned) => Math.hypot(...v.rig.state.position) > 1.05 * turned", arg=turned)


def test_nothing_is_drawn_while_nothing_changes(page: Page) -> None:
    counts = page.evaluate(
        """async () => {
          const viewer = await show("source.glb");
          for (let i = 0; i < 40; i++) await drawn();
          let count = 0;
          const { draw } = SharedRenderer.prototype;
          SharedRenderer.prototype.draw = function (...all) { count++; return draw.apply(this, all); };
          for (let i = 0; i < 10; i++) await drawn();
          const idle = count;
          viewer.setMorph(0.5);
          viewer.setWireframe(true);
          await drawn();
          const once = count;
          SharedRenderer.prototype.draw = draw;
          return [idle, once];
        }"""
    )
    assert counts == [0, 1]


def test_the_ground_lies_under_the_shape_that_is_shown(page: Page, site: ViewerSite) -> None:
    sunken = kind(build_glb(VERTS, FACES))
    site.files["box.glb"], site.files["tall.glb"] = sunken.data, sunken.result
    grounds = page.evaluate(
        """async () => {
          const viewer = await show("box.glb", "glb", "tall.glb");
          const found = [];
          for (const share of [0, 0.5, 1]) {
            viewer.setMorph(share);
            await drawn();
            found.push(viewer.stage.ground.position.y);
          }
          return found;
        }"""
    )
    # The box grows by half about its middle; the ground is a little below it.
    assert grounds == pytest.approx([-0.7, -0.875, -1.05], abs=0.02)


def test_the_wireframe_lies_over_the_mesh_and_follows_the_blend(page: Page) -> None:
    found = page.evaluate(
        """async () => {
          const viewer = await show("source.glb", "glb", "bent.glb");
          const shots = [];
          for (const [lines, t] of [[false, 0], [true, 0], [true, 1], [false, 1]]) {
            viewer.setWireframe(lines);
            viewer.setMorph(t);
            await drawn();
            shots.push(pixels(viewer));
          }
          return [[0, 1], [1, 2], [2, 3]].map(([a, b]) => difference(shots[a], shots[b]));
        }"""
    )
    assert min(found) > 100


def test_a_snapshot_is_a_png_of_the_size_asked_for(page: Page) -> None:
    png = page.evaluate(
        """async () => {
          const viewer = await show("source.glb");
          const picture = await viewer.snapshot({ width: 333, height: 222, background: "rgb(10, 200, 30)" });
          const bitmap = await createImageBitmap(picture);
          const canvas = new OffscreenCanvas(333, 222).getContext("2d");
          canvas.drawImage(bitmap, 0, 0);
          const corner = [...canvas.getImageData(2, 2, 1, 1).data];
          const middle = [...canvas.getImageData(166, 111, 1, 1).data];
          const huge = await failure(viewer.snapshot({ width: 1e6, height: 10 }));
          return { head: [...new Uint8Array(await picture.arrayBuffer())].slice(0, 24), corner, middle, huge };
        }"""
    )
    assert bytes(png["head"][:8]) == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", bytes(png["head"][16:24])) == (333, 222)
    assert png["corner"] == [10, 200, 30, 255]
    assert png["middle"] != png["corner"]
    assert "4096" in png["huge"]["message"]


def test_a_viewer_follows_its_size_and_the_theme(page: Page) -> None:
    found = page.evaluate(
        """async () => {
          const viewer = (window.themed = await show("source.glb"));
          const { container, canvas } = viewer.surface;
          container.style.width = "200px";
          container.style.height = "300px";
          for (let i = 0; i < 5; i++) await drawn();
          return [canvas.width, canvas.height, viewer.rig.camera.aspect, covered(pixels(viewer))];
        }"""
    )
    assert found[:3] == [200, 300, pytest.approx(2 / 3)]
    assert found[3] > 2000
    ground = """() => [themed.surface.dark, getComputedStyle(themed.surface.container).backgroundColor,
        themed.stage.ground.material.opacity]"""
    light = page.evaluate(ground)
    page.emulate_media(color_scheme="dark")
    page.evaluate("drawn()")
    dark = page.evaluate(ground)
    page.emulate_media(color_scheme="light")
    assert (light[0], dark[0]) == (False, True)
    assert light[1] != dark[1]
    assert light[2] < dark[2]


def test_compressed_textures_reach_the_transcoder_under_the_policy(shared: tuple[Page, Watch], page: Page) -> None:
    """A KTX2 whose Basis data is broken: that the transcoder says so proves that it runs without `eval`."""
    shared[1].allow("startTranscoding failed")
    with page.expect_console_message(lambda message: "startTranscoding failed" in message.text):
        page.evaluate(
            """async () => {
          const { KTX2Loader } = await import("/web/vendor/three/addons/loaders/KTX2Loader.js");
          const { gl } = acquireRenderer();
          const loader = new KTX2Loader().setTranscoderPath("/web/vendor/three/addons/libs/basis/").detectSupport(gl);
          const file = new ArrayBuffer(80 + 24 + 44 + 16);
          new Uint8Array(file).set([0xab, 0x4b, 0x54, 0x58, 0x20, 0x32, 0x30, 0xbb, 0x0d, 0x0a, 0x1a, 0x0a]);
          const view = new DataView(file);
          // 4 x 4 pixels of no Vulkan format, one level, ETC1S
          [0, 1, 4, 4, 0, 0, 1, 1, 1, 104, 44, 0, 0].forEach((word, i) => view.setUint32(12 + 4 * i, word, true));
          [148, 0, 16, 0, 16, 0].forEach((word, i) => view.setUint32(80 + 4 * i, word, true));
          const descriptor = [44, 0, 2 | (40 << 16), 163 | (1 << 8) | (1 << 16)];
          descriptor.forEach((word, i) => view.setUint32(104 + 4 * i, word, true));
          await new Promise((resolve) => loader.parse(file, resolve, resolve));
          loader.dispose();
          releaseRenderer();
        }"""
        )
