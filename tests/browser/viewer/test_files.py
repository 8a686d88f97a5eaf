"""What the viewer shows, in a real browser under the page's own policy: every kind of file, blended and measured."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.browser.viewer.assets import FACES, KINDS, VERTS
from tests.browser.viewer.site import ViewerSite
from tests.cases import each_case
from tests.unit.rendering.test_shading import encoded, textured

if TYPE_CHECKING:
    from playwright.sync_api import Page


def test_textured_hard_edged_tiny_and_huge_assets_look_alike_also_blended(page: Page, site: ViewerSite) -> None:
    corners = VERTS[FACES].reshape(-1, 3)  # every face by itself: hard edges
    stripes = np.kron(np.indices((8, 8)).sum(axis=0) % 2, np.ones((8, 8)))[..., None] * [200, 90, 40] + 30
    shared: dict[str, Any] = {
        "image": encoded(stripes),
        "uvs": np.tile(np.array([[0, 0], [1, 0], [0, 1]], np.float32), (len(FACES), 1)),
        "faces": np.arange(len(corners), dtype=np.uint32).reshape(-1, 3),
        "material": {"extensions": {}},
    }
    sizes = (1.0, 1e-5, 1e5)
    site.files |= {f"{size:g}.glb": textured(verts=(corners * size).astype(np.float32), **shared) for size in sizes}
    found: list[dict[str, int]] = page.evaluate(
        """async (names) => {
          const all = [];
          let first = null;
          for (const name of names) {
            const viewer = await show(name);
            const ours = pixels(viewer);
            first ??= ours;
            await viewer.setDeformed(await fetchBytes(`/files/${name}`));
            viewer.setMorph(1);
            await drawn();
            const [blended, scaled] = [difference(ours, pixels(viewer)), difference(first, ours)];
            all.push({ covered: covered(ours), blended, scaled });
            viewer.dispose();
          }
          return all;
        }""",
        [f"{size:g}.glb" for size in sizes],
    )
    for each in found:
        assert each["covered"] > 1000
        assert each["blended"] == 0
        assert each["scaled"] < 0.02 * each["covered"], each


@each_case("name", KINDS)
def test_every_kind_of_file_is_drawn_and_meets_its_result(page: Page, site: ViewerSite, name: str) -> None:
    made = KINDS[name]()
    site.files |= {name: made.data, f"{name}.result": made.result}
    found: dict[str, Any] = page.evaluate(
        """async ([name, format]) => {
          const viewer = await show(name, format);
          const drawnPixels = covered(pixels(viewer));
          const before = pixels(viewer);
          await viewer.setDeformed(await fetchBytes(`/files/${name}.result`));
          viewer.setMorph(1);
          await drawn();
          const moved = difference(before, pixels(viewer));
          const [went, { facts }] = [farthest(viewer), viewer];
          closeAll();
          return { facts, drawnPixels, moved, went };
        }""",
        [name, made.format],
    )
    assert found["facts"]["triangles"] == made.triangles
    assert found["drawnPixels"] > 500
    assert found["moved"] > 100
    assert found["went"] == pytest.approx(made.displacement, rel=2e-4)
    if made.format != "glb":
        assert found["facts"]["vertices"] <= len(VERTS)


def test_the_ends_of_the_blend_are_the_files_and_the_middle_lies_between(page: Page) -> None:
    positions = page.evaluate(
        """async () => {
          const viewer = await show("source.glb", "glb", "bent.glb");
          const at = (t) => { viewer.setMorph(t); return highest(viewer); };
          const highest = (v) => {
            const { array } = meshOf(v).geometry.attributes.position;
            let most = -Infinity;
            for (let i = 0; i < array.length; i += 3) most = Math.max(most, array[i]);
            return most;
          };
          const start = pixels(viewer);
          const values = [0, 0.5, 1, 7, 0].map(at);
          await drawn();
          const back = difference(start, pixels(viewer));
          viewer.setMorph(1);
          await drawn();
          return { values, back, changed: difference(start, pixels(viewer)) };
        }"""
    )
    assert positions["values"] == pytest.approx([0.5, 0.7, 0.9, 1.1, 0.5])
    assert positions["back"] == 0
    assert positions["changed"] > 250


def test_another_topology_is_refused_and_what_was_shown_stays(page: Page, site: ViewerSite) -> None:
    site.files["other.glb"] = KINDS["instanced"]().result
    site.files["finer.glb"] = KINDS["unindexed"]().result
    found = page.evaluate(
        """async () => {
          const viewer = await show("source.glb");
          const before = pixels(viewer);
          const failures = [];
          for (const name of ["other.glb", "finer.glb"]) {
            failures.push(await failure(viewer.setDeformed(await fetchBytes(`/files/${name}`))));
          }
          await drawn();
          return { failures, changed: difference(before, pixels(viewer)) };
        }"""
    )
    assert [failure["code"] for failure in found["failures"]] == ["topology", "topology"]
    assert "3, the source 1" in found["failures"][0]["message"].replace("meshes", "").replace("  ", " ").replace(
        " ,", ","
    )
    assert "side by side" in found["failures"][1]["message"]
    assert found["changed"] == 0


@each_case(
    "data, form, message",
    [
        (b"", "glb", "empty"),
        (b"solid nothing", "glb", "not a glTF file"),
        (b"v 0 0 0\nv 1 0 0\n", "obj", "no triangles"),
        (b'{"asset": {"version": "2.0"}, "buffers": [{"uri": "far.bin", "byteLength": 4}]}', "gltf", "far.bin"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n0\n", "ply", "no triangles"),
    ],
)
def test_what_cannot_be_shown_is_told_in_words(
    page: Page, site: ViewerSite, data: bytes, form: str, message: str
) -> None:
    site.files["bad"] = data
    found = page.evaluate(
        """async (format) => {
          const told = await failure(open("bad").load(await fetchBytes("/files/bad"), { format }));
          closeAll();
          return told;
        }""",
        form,
    )
    assert message in found["message"]
    assert "undefined" not in found["message"]
