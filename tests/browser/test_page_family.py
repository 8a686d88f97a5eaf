"""A family on the page: assets become a wall with parts and corresponding points, and the wall becomes new shapes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from bench.parametric_families import family, labels_document
from meshdeform.assets import load_asset
from meshdeform.kinds.families import reading
from meshdeform.runs import start_run
from meshdeform.settings import Settings
from tests.browser.conftest import watched
from tests.browser.steps import badge, expect
from tests.in_process import children_in_process
from tests.integration.conftest import serving
from tests.worker_world import working

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page


@pytest.fixture
def page(
    browser: Browser,
    request: pytest.FixtureRequest,
    redis_url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Page]:
    """A page of a service and a worker in this process, which reads nothing: all assets are labelled."""
    monkeypatch.setattr(reading, "read_source", lambda *_, **__: None)
    settings = Settings(data_dir=tmp_path / "data", redis_url=redis_url, queue="test-page-family")
    with (
        children_in_process(),
        serving(settings) as url,
        working(settings, start_run),
        watched(browser, url, request, tmp_path) as (found, watch),
    ):
        watch.allow("422")  # a refusal is part of the test
        yield found


def point_at_a_shape(page: Page, wall: Locator, said: Locator) -> tuple[float, float]:
    """Move over the wall until a shape is under the pointer, and return where."""
    box = wall.bounding_box()
    assert box is not None
    for row in range(2, 18):
        for column in range(2, 18):
            place = (box["x"] + box["width"] * column / 20, box["y"] + box["height"] * row / 20)
            page.mouse.move(*place)
            if ": point" in said.inner_text():
                return place
    raise AssertionError("no shape is under the pointer anywhere")


@pytest.mark.without_pictures
def test_a_family_is_found_and_new_shapes_are_made_of_it(page: Page, tmp_path: Path) -> None:
    chairs = family("chairs", 10)
    files = [{"name": each.name, "mimeType": "model/gltf-binary", "buffer": each.glb()} for each in chairs]
    labels = json.dumps(labels_document("chairs", chairs, 10)).encode()
    page.goto("/")
    page.get_by_role("link", name="Find a family").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("What they have in common")
    expect(page.locator(".zone-pictures img")).to_have_count(8)
    page.get_by_role("button", name="Remove chairs.zip").click()  # the sample
    page.get_by_role("button", name="Find the family").click()
    expect(page.get_by_text("Choose the assets first.")).to_be_visible()
    page.get_by_label("Mesh files").set_input_files(files[:1])
    page.get_by_role("button", name="Find the family").click()
    expect(page.get_by_text("a family has at least 10")).to_be_visible()
    page.get_by_label("Mesh files").set_input_files(
        [*files[1:], {"name": "labels.json", "mimeType": "application/json", "buffer": labels}]
    )
    page.get_by_text("Advanced", exact=True).click()
    for name, value in {"Points": 40, "Samples": 80, "Iterations": 2, "Epochs": 5}.items():
        page.get_by_label(name, exact=True).fill(str(value))
    page.get_by_role("button", name="Find the family").click()

    # The wall: its parts, and the same point on all shapes, by pointer and by slider.
    expect(badge(page)).to_have_text("Succeeded")
    fitted = page.url
    result = page.get_by_role("region", name="Result")
    expect(result.get_by_role("list", name="Parts").get_by_role("listitem")).to_have_text(
        ["seat", "back", "leg", "arm"]
    )
    expect(result.locator(".viewer-tag")).to_have_text("10 shapes")
    said = result.locator(".wall-said")
    point_at_a_shape(page, result.locator("canvas"), said)
    expect(said).to_contain_text("of 10 shapes have it")
    point = result.get_by_label("Point", exact=True)
    assert f"point {point.input_value()}, " in said.inner_text()
    point.fill("7")
    expect(said).to_contain_text("Point 7, ", ignore_case=True)

    # A click chooses a member to begin with, a list the other one.
    page.get_by_text("Between two", exact=True).click()
    page.mouse.click(*point_at_a_shape(page, result.locator("canvas"), said))
    named = said.inner_text().split(":")[0]
    expect(page.get_by_label("From", exact=True)).to_have_value(named)
    other = next(each.name for each in reversed(chairs) if each.name != named)
    page.get_by_label("To", exact=True).select_option(other)
    page.get_by_label("Count", exact=True).fill("3")
    page.get_by_role("button", name="Make shapes").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("New shapes of a family")
    expect(badge(page)).to_have_text("Succeeded")
    shape = page.get_by_role("slider", name="Shape")
    expect(page.locator(".viewer-tag", has_text=f"0% from {named} to {other}")).to_be_visible()
    shape.fill("2")
    expect(page.locator(".viewer-tag", has_text=f"100% from {named} to {other}")).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download this shape").click()
    last = load_asset(download.value.path().read_bytes())
    member = load_asset(next(each.glb() for each in chairs if each.name == other))
    assert last.surface.triangles.shape == member.surface.triangles.shape

    # The parts to keep are those of the member that is chosen.
    page.goto(fitted)
    page.get_by_text("Keep parts", exact=True).click()
    page.get_by_role("button", name="Make shapes").click()
    expect(page.get_by_text("The mode complete needs the parts to keep.")).to_be_visible()
    page.get_by_label("seat", exact=True).check()
    page.get_by_label("Count", exact=True).fill("2")
    page.get_by_role("button", name="Make shapes").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("New shapes of a family")
    expect(badge(page)).to_have_text("Succeeded")
    expect(page.locator(".viewer-tag", has_text="most like")).to_be_visible()

    page.goto(fitted)
    page.get_by_role("button", name="Edit and run again").click()
    expect(page.get_by_text("1 file")).to_be_visible()
    page.get_by_text("Advanced", exact=True).click()
    expect(page.get_by_label("Epochs", exact=True)).to_have_value("5")
