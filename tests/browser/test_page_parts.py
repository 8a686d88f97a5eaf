"""The parts of an asset on the page: pointed at in the view, changed by words and a slider, and seen at once."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from meshdeform.assets import load_asset
from tests.acceptance.service import Service, until
from tests.browser.steps import (
    barriers,
    choose,
    difference,
    expect,
    open_form,
    picture,
    start,
    until_drawn,
    until_judged,
)
from tests.unit.plain.shapes import rigged_dog

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page


def chip(page: Page, name: str) -> Locator:
    return page.locator(".parts").get_by_role("button", name=name, exact=True)


def marked(viewer: Locator) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """Where in a viewer something is tinted."""
    seen = picture(viewer)
    return np.argwhere(seen[..., 0] - seen[..., 2] > 60)


def test_a_part_is_pointed_at_changed_and_seen_at_once(page: Page, service: Service, axe: str, tmp_path: Path) -> None:
    asset = tmp_path / "dog.glb"
    asset.write_bytes(rigged_dog())
    open_form(page)
    choose(page, asset)
    viewer, prompt = page.locator(".asset-panel .viewer"), page.locator("#prompt")
    until_drawn(viewer)
    expect(chip(page, "tail")).to_be_visible()
    assert page.locator(".parts .chips").first.get_by_role("button").all_inner_texts()[:2] == ["legs", "head"]

    # What a chip marks is what a click in the view chooses.
    chip(page, "head").focus()
    until("the head is marked", lambda: len(marked(viewer)) > 40)
    y, x = np.median(marked(viewer), axis=0)
    box = viewer.bounding_box()
    assert box is not None
    viewer.click(position={"x": float(x) + box["width"] // 5, "y": float(y) + box["height"] // 5})
    expect(chip(page, "head")).to_have_attribute("aria-pressed", "true")
    before = picture(viewer)

    chip(page, "bigger").click()
    expect(prompt).to_have_value("head bigger by 30 %")
    tag = viewer.locator(".viewer-tag")
    expect(tag).to_have_text("Preview")
    until("the view shows it", lambda: difference(before, picture(viewer)) > 0.01)
    slider = page.get_by_label("Amount", exact=True)
    slider.fill("-20")
    expect(prompt).to_have_value("head smaller by 20 %")
    expect(slider).to_have_attribute("aria-valuetext", "head smaller by 20 percent")
    chip(page, "legs").press("Enter")
    chip(page, "longer").press("Space")
    expect(prompt).to_have_value("head smaller by 20 % and legs longer by 30 %")
    expect(chip(page, "longer")).to_be_focused()
    expect(chip(page, "longer")).to_have_attribute("aria-pressed", "true")
    assert barriers(page, axe) == []
    slider.fill("0")
    expect(page.locator("#estimate")).to_contain_text("A change in plain words")
    expect(prompt).to_have_value("head smaller by 20 %")

    job = start(page)
    until_judged(page)
    (change,) = json.loads(service.artifact(job, "report.json"))["changes"]
    assert (change["part"], change["asked"]) == ("head", 0.8)
    assert len(load_asset(service.artifact(job, "result.glb")).surface.positions)


def test_another_prompt_is_the_users_own_and_the_view_shows_the_asset_again(page: Page, tmp_path: Path) -> None:
    asset = tmp_path / "dog.glb"
    asset.write_bytes(rigged_dog())
    open_form(page)
    choose(page, asset)
    tag = page.locator(".asset-panel .viewer-tag").first
    chip(page, "legs").click()
    chip(page, "shorter").click()
    expect(tag).to_have_text("Preview")
    page.locator("#prompt").fill("a horse")
    expect(tag).to_be_hidden()
    expect(chip(page, "shorter")).to_have_attribute("aria-pressed", "false")
    page.get_by_role("button", name="Cube", exact=True).click()
    expect(chip(page, "tail")).to_be_hidden()
