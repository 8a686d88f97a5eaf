"""The page unfolds the result of a surface fit from the few kilobytes that it is."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from meshdeform.geometry.shapes import icosphere
from tests.acceptance.service import Service
from tests.browser.conftest import Watch
from tests.browser.steps import badge, barriers, expect, shown_job, until_drawn
from tests.browser.test_ndf_loader import small_field

if TYPE_CHECKING:
    from playwright.sync_api import Page


# A phone in the country: 400 kbit/s, a third of a second each way.
SLOW = {"offline": False, "latency": 300, "downloadThroughput": 50_000, "uploadThroughput": 50_000}


# The worker is asked for no level until `unfoldNow`.
_LEVELS_WAIT = """
const post = Worker.prototype.postMessage, held = [];
Worker.prototype.postMessage = function (message, ...more) {
  if (message?.task === "level" && window.unfoldNow) held.push(() => post.call(this, message, ...more));
  else post.call(this, message, ...more);
};
window.unfoldNow = () => { delete window.unfoldNow; held.forEach((send) => send()); };
"""


@pytest.fixture(scope="module")
def fitted(service: Service, small_sphere: Path) -> str:
    """A finished job of this kind."""
    params = {"base_faces": 100, "steps": 30, "level": 1}
    files = {"asset": ("sphere.obj", small_sphere.read_bytes()), "scalars": ("scalars.npz", scalars_of_ball())}
    request = json.dumps({"kind": "surface_fit", "params": params})
    answer = service.http.post("/v1/jobs", files=files, data={"request": request})
    assert answer.status_code == 202, answer.text
    job = str(answer.json()["id"])
    assert service.finished(job)["state"] == "succeeded"
    return job


def scalars_of_ball(*names: str) -> bytes:
    """Return the height of a sphere's points, and its two halves, or what is named of them."""
    points = icosphere(3).verts
    found = {"height": 10 * points[:, 1], "half": (points[:, 1] > 0).astype(int) + 4}
    file = io.BytesIO()
    np.savez(file, points=points, **{name: found[name] for name in names or found})
    return file.getvalue()


def kilobytes(size: int) -> str:
    """Return a size as the page says it."""
    return f"{size / 1000:.{0 if size >= 10_000 else 1}f} kB"


def ball_of_points() -> bytes:
    """Return the points of a sphere with their normals as PLY."""
    points = icosphere(2).verts
    header = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")] + ["end_header"]
    rows = [" ".join(f"{value:.4f}" for value in [*point, *point]) for point in points]
    return "\n".join([*header, *rows, ""]).encode()


@pytest.mark.without_pictures
def test_points_are_fitted_from_the_form_and_edited(page: Page, watch: Watch, service: Service, tmp_path: Path) -> None:
    watch.allow("status of 422")
    page.goto("/")
    page.get_by_role("navigation", name="Kind of job").get_by_role("link", name="Fit a surface").click()
    steps = page.get_by_label("Steps", exact=True)
    expect(steps).to_have_attribute("placeholder", "600")
    points = icosphere(2).verts
    cloud, bare = tmp_path / "cloud.ply", tmp_path / "bare.xyz"
    cloud.write_bytes(ball_of_points())
    bare.write_text("\n".join(" ".join(f"{value:.4f}" for value in point) for point in points))
    page.set_input_files("#asset-file", bare)
    expect(page.get_by_text("a cloud needs six")).to_be_visible()
    page.set_input_files("#asset-file", cloud)
    expect(page.locator("#asset-facts")).to_contain_text(f"{len(points)} points")
    expect(page.get_by_text("seen once they are fitted")).to_be_visible()
    page.get_by_label("Base faces", exact=True).fill("20")
    expect(page.get_by_text("At least 100.")).to_be_visible()
    page.get_by_role("button", name="Fit", exact=True).click()
    expect(page.get_by_label("Base faces", exact=True)).to_be_focused()
    page.get_by_label("Base faces", exact=True).fill("100")
    steps.fill("4")
    page.get_by_label("Level", exact=True).fill("0")
    page.get_by_text("Advanced", exact=True).click()
    page.get_by_label("Octaves", exact=True).fill("1")
    page.get_by_role("button", name="Fit", exact=True).click()
    page.wait_for_url(re.compile(r"#/jobs/job_\w+$"))
    job = service.finished(shown_job(page))
    assert (job["kind"], job["state"], job["asset"]["filename"]) == ("surface_fit", "succeeded", "cloud.ply")
    asked = {"base_faces": 100, "steps": 4, "level": 0, "octaves": 1, "checkpoint_every_steps": 1}
    assert asked.items() <= job["params"].items()
    expect(page.locator(".field-stage .viewer-tag")).to_contain_text("triangles")
    page.get_by_role("button", name="Edit and run again").click()
    expect(steps).to_have_value("4")
    expect(page.get_by_label("Octaves", exact=True)).to_have_value("1")
    expect(page.locator("#asset-facts")).to_contain_text("cloud.ply")


@pytest.mark.without_pictures
def test_nothing_can_be_done_with_a_mesh_before_it_is_there(page: Page, fitted: str) -> None:
    page.add_init_script(_LEVELS_WAIT)
    page.goto(f"/?job={fitted}")
    expect(page.get_by_label("Level", exact=True)).to_be_visible()
    kept = page.locator(".stage-keep")
    expect(kept).to_be_hidden()
    page.evaluate("unfoldNow()")
    expect(kept).to_be_visible()
    expect(page.locator(".field-facts")).to_contain_text("this level unfolded in")


@pytest.mark.without_pictures
def test_points_go_to_the_form_for_fits_and_the_mesh_comes_back_as_an_asset(
    page: Page, watch: Watch, service: Service, fitted: str, tmp_path: Path
) -> None:
    watch.allow("422.*jobs:validate")
    cloud = tmp_path / "ball.ply"
    cloud.write_bytes(ball_of_points())
    page.goto(f"/?job={fitted}")
    page.get_by_role("button", name="Deform this mesh").click()  # nobody has been at the form yet
    expect(page.locator("#asset-facts")).to_contain_text("-level")
    expect(page.locator("#estimate")).to_contain_text("Enter a prompt")
    page.get_by_label("Prompt", exact=True).fill("a mushroom")
    page.set_input_files("#asset-file", cloud)
    page.get_by_role("link", name="Fit a surface to it").click()
    expect(page.locator("#asset-facts")).to_contain_text("ball.ply")
    expect(page.get_by_label("Base faces", exact=True)).to_have_value("500")  # a quick fit, to be typed over
    expect(page.get_by_label("Steps", exact=True)).to_have_value("300")

    page.goto(f"/?job={fitted}")
    page.get_by_role("button", name="Deform this mesh").click()
    expect(page.locator("#asset-facts")).to_contain_text("-level")
    expect(page.get_by_label("Prompt", exact=True)).to_have_value("a mushroom")
    page.go_back()
    page.get_by_role("button", name="Use as target").click()
    expect(page.locator(".guide-head")).to_contain_text("-level")


def test_a_field_unfolds(page: Page, watch: Watch, service: Service, fitted: str, axe: str) -> None:
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    # The page itself is not what is slow here; its newest jobs have pictures of their own.
    page.goto("/", wait_until="networkidle")
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
    expect(facts).to_contain_text(f"{kilobytes(size)} loaded")

    page.get_by_label("Level", exact=True).fill("2")
    expect(tag).to_have_text("Level 2 · 1,600 triangles")
    until_drawn(viewer)
    assert barriers(page, axe) == []
    with page.expect_download() as download:
        page.get_by_role("button", name="Download this level").click()
    assert download.value.suggested_filename == "sphere-field-seed0-level2.glb"
    glb = Path(download.value.path()).read_bytes()
    found = json.loads(glb[20 : 20 + int.from_bytes(glb[12:16], "little")])
    assert found["accessors"][2]["count"] == 3 * 1600


@pytest.mark.without_pictures
def test_a_field_of_ones_own_is_opened_and_nothing_is_sent(page: Page, watch: Watch, axe: str) -> None:
    data = small_field()
    page.goto("/#/surface", wait_until="networkidle")
    page.get_by_role("link", name="Open a .ndf").click()
    page.locator("#field-file").wait_for(state="attached")
    watch.sent.clear()
    tag = page.locator(".field-stage .viewer-tag")
    page.set_input_files("#field-file", {"name": "ball.ndf", "mimeType": "", "buffer": data})
    expect(tag).to_have_text("Level 5 · 20,480 triangles")
    expect(page.get_by_role("heading", name="ball.ndf")).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download this level").click()
    assert download.value.suggested_filename == "ball-level5.glb"
    assert barriers(page, axe) == []
    page.set_input_files("#field-file", {"name": "torn.NDF", "mimeType": "", "buffer": data[:-9]})
    expect(page.get_by_text("its checksum is wrong")).to_be_visible()
    assert not [path for path in watch.sent if "/v1/" in path]
    # One that is chosen where assets are goes there too.
    page.goto("/")
    page.set_input_files("#asset-file", {"name": "other.ndf", "mimeType": "", "buffer": data})
    expect(page.get_by_role("heading", name="other.ndf")).to_be_visible()
    expect(tag).to_contain_text("triangles")


@pytest.mark.without_3d
def test_without_webgl_the_picture_is_shown(page: Page, fitted: str) -> None:
    page.goto(f"/#/jobs/{fitted}")
    expect(page.locator(".stage-picture img")).to_be_visible()
