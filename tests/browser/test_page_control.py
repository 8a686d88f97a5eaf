"""The page's control: what is painted, or a part that is kept, is what the job is asked to keep."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from meshdeform.assets import load_asset
from meshdeform.geometry.shapes import icosphere
from tests.acceptance.service import Service, until
from tests.browser.conftest import Watch
from tests.browser.steps import (
    badge,
    choose,
    drag,
    expect,
    keep,
    kept_files,
    open_form,
    open_more,
    set_steps,
    start,
    until_noted,
    until_shown,
)
from tests.unit.assets.builders import Builder
from tests.unit.plain.shapes import rigged_dog

if TYPE_CHECKING:
    from playwright.sync_api import Page


def two_parts(path: Path) -> Path:
    """Two balls side by side: the left one mirrored and of two primitives, the right one an instance of both."""
    builder = Builder()
    mesh = icosphere(2)
    verts, faces = mesh.verts.astype(np.float32), mesh.faces.astype(np.uint16)
    builder.root["materials"] = [{"name": "upper"}, {"name": "lower"}]
    above = verts[faces].mean(1)[:, 1] > 0
    halves = [
        {**builder.primitive(verts, faces[part], NORMAL=verts), "material": number}
        for number, part in enumerate((above, ~above))
    ]
    ball = builder.mesh(*halves, name="ball")
    builder.node(ball, name="left", translation=[-1.2, 0, 0], scale=[-1, 1, 1])
    builder.node(ball, name="right", translation=[1.2, 0, 0])
    path.write_bytes(builder.glb())
    return path


LOWER = 168
"""Triangles of the lower primitive of `two_parts`."""


def tool(page: Page, name: str) -> None:
    """Take a tool in hand."""
    page.get_by_role("group", name="Tool").get_by_text(name, exact=True).click()


@pytest.mark.without_pictures
def test_painted_faces_are_kept(page: Page, service: Service, tmp_path: Path) -> None:
    asset = two_parts(tmp_path / "balls.glb")
    open_form(page)
    choose(page, asset)
    viewer = page.locator(".asset-panel .viewer")
    until_shown(page, LOWER)
    open_more(page)
    page.get_by_text("Control", exact=True).click()
    tool(page, "Paint")
    rows = page.get_by_role("list", name="Regions").get_by_role("listitem")

    # The camera stands to the right of the front: the ball that it sees on the right is `right`.
    def painted() -> bool:
        drag(page, viewer, (0.66, 0.42), (0.7, 0.46))
        return rows.count() > 0

    until("the tools are loaded", painted)
    expect(rows).to_have_count(1)
    expect(rows.first).to_contain_text("Painted")
    # Beside the asset the view turns, and nothing is painted.
    said = rows.first.inner_text()
    drag(page, viewer, (0.05, 0.1), (0.06, 0.1))
    assert rows.first.inner_text() == said

    tool(page, "Turn")
    page.get_by_role("button", name="Clear all").click()
    expect(rows).to_have_count(0)
    page.keyboard.press("Control+z")
    expect(rows).to_have_count(1)

    page.get_by_label("Prompt", exact=True).fill("a tall vase")
    set_steps(page, 3)
    page.reload()  # a draft has all of it
    open_more(page)
    expect(rows).to_have_count(1)
    expect(page.locator("#estimate")).to_contain_text("3 steps")
    job = start(page)
    service.http.post(f"/v1/jobs/{job}/cancel")
    control = service.job(job)["params"]["control"]
    source = load_asset(asset.read_bytes())
    items = control["regions"][0]["faces"]
    ranges = [range(item[0], item[1] + 1) if isinstance(item, list) else [item] for item in items]
    numbers = [number for each in ranges for number in each]
    assert 1 < len(numbers) < 100
    names = {node["index"]: node["name"] for node in source.pieces().nodes}
    assert {names[node] for node in source.pieces().node_of_triangle[numbers]} == {"right"}
    middles = source.surface.positions[source.surface.triangles[numbers]].mean(1)
    assert np.ptp(middles, axis=0).max() < 1.2, "the brush stays where it was"
    assert (middles[:, 2] > -0.2).all(), "and on the side that is seen"
    open_more(page)
    expect(rows).to_have_count(1)  # the page of the job is the form with all of it
    # Another file has other triangles.
    page.get_by_role("link", name="Create", exact=True).click()
    page.get_by_role("button", name="Choose a file").wait_for()
    open_more(page)
    expect(rows).to_have_count(1)
    page.get_by_role("button", name="Sphere", exact=True).click()
    until_noted(page, "belonged to the other file")
    expect(rows).to_have_count(0)


@pytest.mark.live("parts")
@pytest.mark.without_pictures
def test_a_part_is_kept_by_the_keyboard_alone(page: Page, watch: Watch, service: Service, tmp_path: Path) -> None:
    head = {"name": "head", "found_by": "joints", "confidence": None, "faces": [[0, 767]], "changes": []}
    found = {"reading": None, "parts": [head], "result": None, "warnings": []}
    page.route("**/v1/jobs:parts", lambda route: route.fulfill(json=found))
    open_form(page)
    asset = tmp_path / "dog.glb"
    asset.write_bytes(rigged_dog())
    choose(page, asset)
    page.locator(".parts").get_by_role("button", name="head", exact=True).press("Enter")
    keeps = page.get_by_role("button", name="Keep as it is")
    keeps.press("Enter")
    expect(keeps).to_have_attribute("aria-pressed", "true")
    expect(keeps).to_be_focused()
    rows = page.get_by_role("list", name="Regions").get_by_role("listitem")
    open_more(page)
    page.locator("summary").filter(has_text="Control").press("Enter")
    expect(rows).to_have_text(re.compile("The head"))
    page.get_by_label("Prompt", exact=True).fill("a tall vase")
    set_steps(page, 2)
    page.get_by_label("Symmetry").select_option("x")
    # Split edges number the triangles anew.
    begin = keep(page)
    page.get_by_label("Split long edges first").check()
    expect(page.get_by_text("Triangles are numbered as in the file")).to_be_visible()
    begin.click()
    assert watch.posted() == []
    page.get_by_label("Split long edges first").uncheck()
    expect(page.locator("#estimate")).to_contain_text("2 steps")
    job = start(page)
    control = service.job(job)["params"]["control"]
    (region,) = control["regions"]
    assert (region["faces"], region["action"], control["symmetry"]) == ([[0, 767]], "keep", "x")
    service.http.post(f"/v1/jobs/{job}/cancel")
    expect(badge(page)).to_have_text("Canceled")
    open_more(page)
    expect(rows).to_have_count(1)
    page.get_by_role("button", name="Clear all").click()
    expect(rows).to_have_count(0)
    page.get_by_role("button", name="Undo").first.click()
    expect(rows).to_have_count(1)


@pytest.mark.without_pictures
def test_a_target_or_a_picture(page: Page, service: Service, tmp_path: Path) -> None:
    open_form(page)
    expect(page.locator("#asset-facts")).to_contain_text("triangles")
    Image.fromarray(np.pad(np.zeros((40, 20), np.uint8), 20, constant_values=255)).save(tmp_path / "front.png")
    page.set_input_files("#picture-file", tmp_path / "front.png")
    direction = page.locator(".direction")
    expect(direction).to_have_text("Seen from 0°")
    expect(page.locator(".picture-veil")).to_be_visible()
    drag(page, page.locator(".asset-panel .viewer"), (0.5, 0.5), (0.4, 0.5))
    expect(direction).not_to_have_text("Seen from 0°")
    seen = re.search(r"from (\d+)°", direction.inner_text())
    assert seen, "dragged to the left, the asset shows its left side"
    assert 5 < int(seen[1]) < 90
    set_steps(page, 2)
    expect(page.locator("#estimate")).to_contain_text("2 steps")  # the server takes the picture, without a prompt
    expect(page.get_by_role("button", name="Fit to another mesh")).to_be_hidden()
    page.get_by_role("button", name="Remove picture 1").click()
    expect(page.locator("#estimate")).to_contain_text("Enter a prompt")

    page.set_input_files("#target-file", two_parts(tmp_path / "balls.glb"))
    expect(page.get_by_label("Prompt", exact=True)).to_be_hidden()
    target = page.locator(".asset-panel .viewer").nth(1)
    until_shown(page, LOWER)
    until("both files are kept", lambda: {"horse.glb", "balls.glb"} <= {*kept_files(page)})
    page.reload()  # a draft has both
    expect(target.locator(".viewer-tag")).to_have_text("Target")
    expect(page.locator("#estimate")).to_contain_text("2 steps")
    job = start(page)
    document = service.job(job)
    guidance = document["params"]["guidance"]
    assert (guidance["kind"], document["target"]["filename"]) == ("target", "balls.glb")
    service.http.post(f"/v1/jobs/{job}/cancel")
    service.finished(job)
    expect(target.locator(".viewer-tag")).to_have_text("Target")
