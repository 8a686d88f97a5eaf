"""An asset with its files in a ZIP is shown, turned and deformed."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from meshdeform.geometry.shapes import icosphere
from tests.acceptance.service import Service
from tests.browser.conftest import Watch
from tests.browser.steps import (
    choose,
    difference,
    expect,
    open_form,
    picture,
    read_all_alike,
    set_steps,
    start,
    until_drawn,
    until_judged,
)
from tests.unit.assets.builders import Builder, unpack

if TYPE_CHECKING:
    from playwright.sync_api import Page


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


@pytest.mark.live("parts")
def test_a_zip_is_shown_its_front_said_and_deformed(page: Page, watch: Watch, service: Service, tmp_path: Path) -> None:
    read_all_alike(page)
    open_form(page)
    choose(page, packed_ball(tmp_path / "ball.zip"))
    expect(page.locator("#asset-facts")).to_contain_text("320 triangles")
    viewer = page.locator(".asset-panel .viewer")
    seen = until_drawn(viewer)
    assert (seen[..., 2] - seen[..., 0] > 60).mean() > 0.05  # the texture is there

    page.get_by_text("Not right?").click()
    page.get_by_label("Side that is the front").select_option("45")
    page.get_by_label("Prompt", exact=True).fill("a tall vase")
    set_steps(page, 4)
    expect(page.locator("#estimate")).to_contain_text("4 steps")
    job = start(page)
    until_judged(page)
    assert service.job(job)["params"]["guidance"]["orientation"] == 45
    page.get_by_text("Side by side").click()
    after, before = page.locator(".viewer").first, page.locator(".before .viewer")
    expect(page.get_by_label("Strength", exact=True)).to_be_visible()  # both have the same vertices
    until_drawn(before)
    assert difference(picture(before), until_drawn(after)) > 0.005
