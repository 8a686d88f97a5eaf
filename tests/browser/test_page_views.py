"""The 3D views show what their labels say, and what they show can be downloaded."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.acceptance.service import Service, until
from tests.browser.conftest import Watch
from tests.browser.steps import badge, choose, difference, expect, open_form, picture, shown_job, until_drawn

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route

RESULT = re.compile(r"/artifacts/result\.glb$")


@pytest.fixture(scope="module")
def done(service: Service, small_sphere: Path) -> str:
    """A job that has succeeded."""
    job = service.submit(small_sphere, {"prompt": "a fat penguin", "params": {"preset": "preview", "steps": 6}})
    assert service.finished(job)["state"] == "succeeded"
    return job


def test_a_file_that_cannot_be_shown_takes_the_model_before_it_away(
    page: Page, repository: Path, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.glb"
    broken.write_bytes((repository / "examples" / "sphere.glb").read_bytes()[:5000])
    open_form(page)
    viewer = page.locator(".asset-panel .viewer")
    until_drawn(viewer)
    page.set_input_files("#asset-file", broken)
    expect(viewer.locator(".viewer-note")).to_have_text("This file can't be shownIt may be empty, cut off or damaged.")
    filled = "(canvas) => canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some(Boolean)"
    assert viewer.locator("canvas").evaluate(filled) is False
    choose(page, repository / "examples" / "cube.glb")
    expect(viewer.locator(".viewer-note")).to_be_hidden()
    until_drawn(viewer)


def test_a_shape_on_the_way_is_downloaded_continued_and_retried(
    page: Page, watch: Watch, service: Service, small_sphere: Path, tmp_path: Path
) -> None:
    params = {"preset": "preview", "steps": 50_000, "checkpoint_every_steps": 4, "seed": 7}
    first = service.submit(small_sphere, {"prompt": "a tall vase", "params": params})
    service.at_step(first, 30)
    service.http.post(f"/v1/jobs/{first}/cancel")
    assert service.finished(first)["state"] == "canceled"
    found = service.http.get(f"/v1/jobs/{first}/checkpoints").json()["checkpoints"]
    steps = [each["step"] for each in found if each["mesh"]]

    page.goto(f"/#/jobs/{first}")
    view = page.locator(".viewer").first
    tag, shapes = view.locator(".viewer-tag"), page.get_by_role("group", name="Shapes so far").get_by_role("button")
    expect(tag).to_have_text(f"Step {steps[-1]:,}")
    until_drawn(view)
    expect(shapes).to_have_count(len(steps))
    shapes.first.click()
    expect(tag).to_have_text(f"Step {steps[0]:,}")
    expect(shapes.first).to_have_attribute("aria-pressed", "true")

    # What is on the screen is what is saved, under a name that says so.
    with page.expect_download() as download:
        page.get_by_role("button", name="Download", exact=True).click()
    download.value.save_as(tmp_path / "step.glb")
    assert download.value.suggested_filename == f"sphere-a-tall-vase-seed7-step{steps[0]}.glb"
    found_mesh = service.http.get(f"/v1/jobs/{first}/checkpoints/{steps[0]}/mesh.glb").content
    assert (tmp_path / "step.glb").read_bytes() == found_mesh
    # Another job can start from it.
    expect(page.get_by_role("button", name=f"Starts from step {steps[0]}")).to_be_visible()
    expect(page.get_by_role("button", name="Run", exact=True)).to_be_visible()

    # A retry shows the shape that it starts from, not the source.
    with service.held_jobs():
        page.get_by_role("button", name="Retry").click()
        page.wait_for_url(lambda url: first not in url)
        expect(tag).to_have_text("Start")
        until_drawn(view)
        page.get_by_text("Side by side").click()
        before = page.locator(".before .viewer")
        until_drawn(before)
        assert difference(picture(before), picture(view)) > 0.005
    service.http.post(f"/v1/jobs/{shown_job(page)}/cancel")
    expect(badge(page)).to_have_text("Canceled")


def test_a_result_that_is_slow_to_come_is_never_the_source(page: Page, watch: Watch, done: str) -> None:
    watch.allow(r"status of (503|429) ")
    asked: list[str] = []

    def refuse(route: Route) -> None:
        """First as a server in trouble, then as one that limits the rate, then let it pass."""
        asked.append(route.request.url)
        if len(asked) == 1:
            route.fulfill(status=503, json={"code": "unavailable", "title": "Unavailable"})
        elif len(asked) == 2:
            limited = {"code": "rate_limited", "title": "Rate limit exceeded"}
            route.fulfill(status=429, headers={"Retry-After": "2"}, json=limited)
        else:
            route.continue_()

    page.route(RESULT, refuse)
    page.goto(f"/#/jobs/{done}")
    after = page.locator(".viewer").first
    expect(after.locator(".viewer-cover")).to_contain_text("This shape could not be loaded")
    expect(page.locator(".toast").first).to_contain_text("Rate limit reached. Trying again by itself in 2 s.")
    expect(after.locator(".viewer-note")).to_be_hidden()
    expect(after.locator(".viewer-tag")).to_have_text("Result")
    page.get_by_text("Side by side").click()
    before = page.locator(".before .viewer")
    until_drawn(before)
    until("the result differs", lambda: difference(picture(before), picture(after)) > 0.005)
    assert len(asked) == 3


@pytest.mark.without_pictures
def test_a_result_is_weakened_exaggerated_and_downloaded(
    page: Page, service: Service, done: str, tmp_path: Path
) -> None:
    page.goto(f"/#/jobs/{done}")
    tag = page.locator(".viewer-tag").first
    expect(tag).to_have_text("Result")
    for share in (60, 130):
        page.get_by_label("Strength", exact=True).fill(str(share))
        expect(tag).to_have_text(f"Result · {share}%")
        with page.expect_download(timeout=240_000) as download:  # a process that imports torch, several times
            page.get_by_role("button", name="Download", exact=True).click()
        download.value.save_as(tmp_path / f"{share}.glb")
        assert download.value.suggested_filename == f"sphere-a-fat-penguin-seed0-strength{share}.glb"
        made = service.http.get(f"/v1/jobs/{done}/artifacts/result.glb", params={"strength": share / 100})
        assert (tmp_path / f"{share}.glb").read_bytes() == made.content
