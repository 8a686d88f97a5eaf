"""An asset with its files in a ZIP is shown, turned and deformed."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

from meshdeform.geometry.shapes import icosphere
from tests.acceptance.service import Service, until
from tests.browser.conftest import Watch
from tests.browser.steps import (
    choose,
    choose_way,
    difference,
    expect,
    open_form,
    open_more,
    picture,
    set_steps,
    start,
    until_drawn,
    until_judged,
)
from tests.unit.assets.builders import Builder, unpack

if TYPE_CHECKING:
    from playwright.sync_api import Page


ARROW = np.array([217, 98, 43])  # as `front-arrow.js` has it


def packed_ball(path: Path) -> Path:
    """A ball with a blue texture, as a .gltf with its files."""
    builder, mesh, skin = Builder(), icosphere(2), io.BytesIO()
    vertices = mesh.verts.astype("<f4")
    primitive = builder.primitive(
        vertices, mesh.faces.astype("<u2"), TEXCOORD_0=np.full((len(vertices), 2), 0.5, "<f4")
    )
    builder.node(builder.mesh({**primitive, "material": 0}))
    gltf, binary, _ = unpack(builder.glb())
    gltf["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0}}]
    gltf |= {"textures": [{"source": 0}], "images": [{"uri": "textures/skin.png"}]}
    gltf["buffers"][0] |= {"uri": "ball%20data.bin", "byteLength": len(binary)}
    Image.new("RGB", (4, 4), (20, 40, 230)).save(skin, "PNG")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("ball/ball.gltf", json.dumps(gltf))
        archive.writestr("ball/ball data.bin", binary)
        archive.writestr("ball/textures/skin.png", skin.getvalue())
    return path


def test_a_zip_is_shown_its_front_turned_and_deformed(
    page: Page, watch: Watch, service: Service, tmp_path: Path
) -> None:
    open_form(page)
    choose(page, packed_ball(tmp_path / "ball.zip"))
    expect(page.locator("#asset-facts")).to_contain_text("320 triangles")
    viewer = page.locator(".asset-panel .viewer")
    seen = until_drawn(viewer)
    assert (seen[..., 2] - seen[..., 0] > 60).mean() > 0.05  # the texture is there

    # The arrow follows the pointer, the slider and the form.
    choose_way(page, "pictures")  # a fit searches no front
    page.get_by_text("Not right?").click()
    page.get_by_label("Side that is the front").select_option("else")
    slider, said = page.get_by_label("Front", exact=True).first, page.locator(".front-control output")
    expect(said).to_have_text("Automatic")
    slider.fill("0")
    expect(said).to_have_text("0°")
    expect(page.locator("#param-orientation")).to_have_value("0")

    def arrow() -> tuple[float, float]:
        """Return where the arrow is in the viewer."""
        shown = np.asarray(Image.open(io.BytesIO(viewer.screenshot())).convert("RGB"), dtype=int)
        rows, columns = np.nonzero(np.abs(shown - ARROW).max(2) < 24)
        return (float(np.median(columns)), float(np.median(rows))) if len(rows) > 20 else (0.0, 0.0)

    # The camera makes room for the arrow, and a picture may scroll the page: measure once both are at rest.
    until("the arrow is seen and at rest", lambda: arrow() == arrow() != (0.0, 0.0))
    (x, y), box = arrow(), viewer.bounding_box()
    assert box is not None
    middle = box["width"] / 2
    assert x < middle
    page.mouse.move(box["x"] + x, box["y"] + y)
    page.mouse.down()
    page.mouse.move(box["x"] + 2 * middle - x, box["y"] + y, steps=4)
    page.mouse.up()
    expect(said).not_to_have_text("0°")
    turned = int(said.inner_text().removesuffix("°"))
    assert 20 < turned < 110
    until("the arrow has turned", lambda: arrow()[0] > middle)

    page.get_by_label("Prompt", exact=True).fill("a tall vase")
    set_steps(page, 4)
    expect(page.locator("#estimate")).to_contain_text("4 steps")
    job = start(page)
    until_judged(page)
    assert service.job(job)["params"]["guidance"]["orientation"] == turned
    open_more(page)
    expect(page.get_by_text(f"Front: the side at {turned}°")).to_be_visible()
    page.get_by_text("Side by side").click()
    after, before = page.locator(".viewer").first, page.locator(".before .viewer")
    expect(page.get_by_label("Strength", exact=True)).to_be_visible()  # both have the same vertices
    until_drawn(before)
    assert difference(picture(before), until_drawn(after)) > 0.005
