"""The page unfolds the result of a surface fit from the few kilobytes that it is, and computes distances on it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

playwright_api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")

from tests.acceptance.service import Service, until  # noqa: E402
from tests.browser.conftest import Watch  # noqa: E402
from tests.browser.steps import badge, difference, picture, until_drawn  # noqa: E402

if TYPE_CHECKING:
    from playwright.sync_api import Page

expect = playwright_api.expect
expect.set_options(timeout=60_000)

# A phone in the country: 400 kbit/s, a third of a second each way.
SLOW = {"offline": False, "latency": 300, "downloadThroughput": 50_000, "uploadThroughput": 50_000}


@pytest.fixture(scope="module")
def fitted(service: Service, small_sphere: Path) -> str:
    """A finished job of this kind."""
    params = {"base_faces": 100, "steps": 30, "level": 1}
    answer = service.post(small_sphere.read_bytes(), "sphere.obj", {"kind": "surface_fit", "params": params})
    assert answer.status_code == 202, answer.text
    job = str(answer.json()["id"])
    assert service.finished(job)["state"] == "succeeded"
    return job


def test_a_field_unfolds_and_shows_distances(page: Page, watch: Watch, service: Service, fitted: str) -> None:
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    page.goto("/")  # the page itself is not what is slow here
    session.send("Network.emulateNetworkConditions", SLOW)
    watch.sent.clear()
    page.goto(f"/?job={fitted}")
    expect(badge(page)).to_have_text("Succeeded")
    viewer = page.locator(".field-stage .viewer")
    tag = viewer.locator(".viewer-tag")
    # By itself up to about 40,000 triangles, from nothing but the field.
    expect(tag).to_have_text("Level 4 · 25,600 triangles")
    fetched = [path for path in watch.sent if f"/v1/jobs/{fitted}/" in path]
    assert f"GET /v1/jobs/{fitted}/artifacts/surface.ndf" in fetched
    assert not [path for path in fetched if re.search(r"/asset$|\.glb|preview", path)], fetched
    size = len(service.http.get(f"/v1/jobs/{fitted}/artifacts/surface.ndf").content)
    facts = page.locator(".field-facts")
    expect(facts).to_contain_text(f"{size / 1000:.1f} kB loaded")

    page.get_by_label("Level", exact=True).fill("2")
    expect(tag).to_have_text("Level 2 · 1,600 triangles")
    plain = until_drawn(viewer)
    # Where the pointer clicks the surface, and then at its other end: half a turn around the sphere.
    viewer.locator("canvas").click()
    expect(facts).to_contain_text("the farthest point is")
    expect(page.get_by_role("button", name="Distances")).to_have_attribute("aria-pressed", "true")
    until("the colours are to be seen", lambda: difference(plain, picture(viewer)) > 0.1)
    farthest = float(re.findall(r"farthest point is ([\d.]+)", facts.inner_text())[0])
    assert farthest == pytest.approx(3.1416, rel=0.1)
    here = picture(viewer)
    page.get_by_role("button", name="Move the source to the farthest point").click()
    until("the source has moved", lambda: difference(here, picture(viewer)) > 0.1)

    # The source is dragged; what begins beside it turns the view.
    page.get_by_role("button", name="Distances").click()
    viewer.locator("canvas").click()
    until("the source is back", lambda: difference(here, picture(viewer)) < 0.05)
    box = viewer.locator("canvas").bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 40, steps=4)
    page.mouse.up()
    until("the source has moved", lambda: difference(here, picture(viewer)) > 0.05)
    page.get_by_role("button", name="Distances").click()
    until("the colours are gone", lambda: difference(plain, picture(viewer)) < 0.05)

    with page.expect_download() as download:
        page.get_by_role("button", name="Download this level").click()
    assert download.value.suggested_filename == "sphere-field-seed0-level2.glb"
    glb = Path(download.value.path()).read_bytes()
    found = json.loads(glb[20 : 20 + int.from_bytes(glb[12:16], "little")])
    assert found["accessors"][2]["count"] == 3 * 1600


@pytest.mark.without_3d
def test_without_webgl_the_picture_is_shown(page: Page, fitted: str) -> None:
    page.goto(f"/#/jobs/{fitted}")
    expect(page.locator(".stage-picture img")).to_be_visible()
