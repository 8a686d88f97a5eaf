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
    before, after = page.locator(".viewer").nth(0), page.locator(".viewer").nth(1)
    expect(after.locator(".viewer-tag")).to_have_text(f"After · step {steps[-1]:,}")
    until_drawn(after)
    page.get_by_label("Step", exact=True).fill("1")
    expect(after.locator(".viewer-tag")).to_have_text(f"After · step {steps[0]:,}")

    # What is on the screen is what is saved, under a name that says so; the server makes strengths of results alone.
    save = page.get_by_role("button", name="Download this shape")
    with page.expect_download() as download:
        save.click()
    download.value.save_as(tmp_path / "step.glb")
    assert download.value.suggested_filename == f"sphere-a-tall-vase-seed7-step{steps[0]}.glb"
    found_mesh = service.http.get(f"/v1/jobs/{first}/checkpoints/{steps[0]}/mesh.glb").content
    assert (tmp_path / "step.glb").read_bytes() == found_mesh
    page.get_by_label("Morph", exact=True).fill("50")
    expect(after.locator(".viewer-tag")).to_have_text(f"After · step {steps[0]:,} · morph 50%")
    expect(save).to_be_disabled()

    # A new version starts from the step that is looked at.
    page.get_by_role("button", name="New version").click()
    expect(page.get_by_label("Start from")).to_have_value(str(steps[0]))
    page.keyboard.press("Escape")

    # A retry shows the shape that it starts from, not the source.
    page.get_by_label("Morph", exact=True).fill("100")
    with service.held_jobs():
        page.get_by_role("button", name="Retry").click()
        page.wait_for_url(lambda url: first not in url)
        expect(after.locator(".viewer-tag")).to_have_text("After · start")
        until_drawn(after)
        assert difference(picture(before), picture(after)) > 0.005
    service.http.post(f"/v1/jobs/{shown_job(page)}/cancel")
    expect(badge(page)).to_have_text("Canceled")


def test_a_result_that_is_slow_to_come_is_never_the_source(
    page: Page, watch: Watch, service: Service, small_sphere: Path
) -> None:
    done = service.submit(small_sphere, {"prompt": "a fat penguin", "params": {"preset": "preview", "steps": 6}})
    assert service.finished(done)["state"] == "succeeded"
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
    after = page.locator(".viewer").nth(1)
    expect(after.locator(".viewer-cover")).to_contain_text("This shape could not be loaded")
    expect(page.locator(".toast").first).to_contain_text("Rate limit reached. Trying again by itself in 2 s.")
    expect(after.locator(".viewer-note")).to_be_hidden()
    expect(after.locator(".viewer-tag")).to_have_text("After")
    until("the result differs", lambda: difference(picture(page.locator(".viewer").nth(0)), picture(after)) > 0.005)
    assert len(asked) == 3


@pytest.mark.without_pictures
def test_the_way_to_a_result_is_bent_exaggerated_and_downloaded(
    page: Page, service: Service, small_sphere: Path, tmp_path: Path
) -> None:
    done = service.submit(small_sphere, {"prompt": "a fat penguin", "params": {"preset": "preview", "steps": 6}})
    assert service.finished(done)["state"] == "succeeded"
    page.goto(f"/#/jobs/{done}")
    after = page.locator(".viewer").nth(1)
    expect(after.locator(".viewer-tag")).to_have_text("After")
    for share in (60, 130):
        page.get_by_label("Morph", exact=True).fill(str(share))
        expect(after.locator(".viewer-tag")).to_have_text(f"After · strength {share}%")
        with page.expect_download(timeout=240_000) as download:  # a process that imports torch, several times
            page.get_by_role("button", name="Download this shape").click()
        download.value.save_as(tmp_path / f"{share}.glb")
        assert download.value.suggested_filename == f"sphere-a-fat-penguin-seed0-strength{share}.glb"
        made = service.http.get(f"/v1/jobs/{done}/artifacts/result.glb", params={"strength": share / 100})
        assert (tmp_path / f"{share}.glb").read_bytes() == made.content
