"""Two jobs side by side: chosen in the list or at a job, with their shapes, requests and figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from meshdeform.assets import load_asset
from tests.acceptance.service import Service, until
from tests.browser.steps import (
    difference,
    drag,
    expect,
    open_more,
    picture,
    set_steps,
    start,
    until_drawn,
    until_judged,
)

if TYPE_CHECKING:
    from playwright.sync_api import Page


@pytest.fixture(scope="module")
def pair(service: Service, small_sphere: Path) -> tuple[str, str]:
    """Two finished jobs of one asset that differ by prompt and seed, the older one first."""
    jobs = []
    for seed, prompt in enumerate(("a tall vase", "a fat penguin")):
        params = {"preset": "preview", "steps": 6, "seed": seed}
        jobs.append(service.submit(small_sphere, {"prompt": prompt, "params": params, "metadata": {"group": "pair"}}))
    for job in jobs:
        assert service.finished(job)["state"] == "succeeded"
    first, second = sorted(jobs)
    return first, second


def test_two_jobs_of_the_list_are_compared(page: Page, service: Service, pair: tuple[str, str]) -> None:
    page.goto("/#/jobs")
    page.get_by_role("button", name="Select", exact=True).click()
    compare = page.get_by_role("button", name="Compare", exact=True)
    expect(compare).to_be_disabled()
    for job in pair:
        page.locator(".card", has=page.locator(f'a[href="#/jobs/{job}"]')).get_by_role("checkbox").check()
    compare.click()
    page.wait_for_url(f"**/#/compare/{pair[0]}/{pair[1]}")
    # The newer one is shown, with the older one as before.
    after, before = page.locator(".viewer").first, page.locator(".before .viewer")
    expect(before.locator(".viewer-tag")).to_have_text("Before: a tall vase")
    expect(page.get_by_label("Compare with")).to_contain_text("a tall vase")
    expect(page.get_by_role("heading", level=1)).to_have_text("“a fat penguin”")
    until_drawn(before)
    until_drawn(after)
    until("the results differ", lambda: difference(picture(before), picture(after)) > 0.005)
    # Both cameras move: what one shows from elsewhere, the other one does too.
    seen = picture(before)
    drag(page, after, (0.2, 0.2), (0.6, 0.25))
    until("the other view turns", lambda: difference(seen, picture(before)) > 0.005)
    page.get_by_label("Compare with").select_option("")
    expect(before.locator(".viewer-tag")).to_have_text("Before")


@pytest.mark.without_3d
def test_a_result_is_gone_on_from_taken_back_and_given_to_another_file(
    page: Page, service: Service, small_sphere: Path, tmp_path: Path
) -> None:
    params = {"preset": "preview", "steps": 2, "checkpoint_every_steps": 1}
    first = service.submit(small_sphere, {"prompt": "a tall vase", "params": params})
    assert service.finished(first)["state"] == "succeeded"
    page.goto(f"/#/jobs/{first}")
    shapes = page.get_by_role("group", name="Shapes so far").get_by_role("button")
    expect(page.get_by_role("button", name="Continue from it")).to_be_visible()
    page.get_by_role("button", name="Continue from it").click()
    expect(page.locator("#asset-facts")).to_contain_text("sphere.glb")
    page.get_by_label("Prompt", exact=True).fill("a fat penguin")
    set_steps(page, 2)
    second = start(page)
    until_judged(page)
    job = service.job(second)
    result = next(each for each in service.job(first)["artifacts"] if each["name"] == "result.glb")
    assert (job["metadata"]["thread"], job["asset"]["sha256"]) == (first, result["sha256"])
    expect(shapes.first).to_have_text("1 · a tall vase")
    shapes.first.click()
    page.wait_for_url(f"**/#/jobs/{first}")
    open_more(page)
    # Until the files are those of the first job, the field belongs to a view that is about to end.
    expect(page.get_by_role("region", name="Files", exact=True)).to_contain_text("sphere.obj")

    with page.expect_download() as download:
        page.get_by_label("Files to deform alike").set_input_files(small_sphere)
    assert download.value.suggested_filename == "sphere-edited.glb"
    download.value.save_as(tmp_path / "alike.glb")
    files = (tmp_path / "alike.glb").read_bytes(), service.artifact(first, "result.glb")
    shapes = [load_asset(data).surface.positions for data in files]
    np.testing.assert_allclose(*shapes, atol=0.05)
