"""Two jobs side by side: chosen in the list or at a job, with their shapes, requests and figures."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from meshdeform.assets import load_asset
from tests.acceptance.service import Service, until
from tests.browser.conftest import Watch
from tests.browser.steps import difference, drag, expect, picture, set_steps, start, until_drawn, until_judged

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
    page.goto("/#/groups/pair")
    expect(page.locator(".card")).to_have_count(2)
    page.get_by_role("button", name="Select", exact=True).click()
    compare = page.get_by_role("button", name="Compare", exact=True)
    expect(compare).to_be_disabled()
    page.get_by_role("button", name="Select all finished").click()
    compare.click()
    page.wait_for_url(f"**/#/compare/{pair[0]}/{pair[1]}")
    left, right = page.locator(".viewer").nth(0), page.locator(".viewer").nth(1)
    expect(left.locator(".viewer-tag")).to_have_text("A · a tall vase")
    expect(right.locator(".viewer-tag")).to_have_text("B · a fat penguin")
    until_drawn(right)
    until("the results differ", lambda: difference(picture(left), picture(right)) > 0.005)
    plain = picture(right)
    page.get_by_text("Displacement", exact=True).click()
    expect(page.locator(".legend")).to_contain_text("Displacement")
    until("B is coloured", lambda: difference(plain, picture(right)) > 0.05)
    # Both cameras move: what the left one shows from elsewhere, the right one does too.
    seen = picture(right)
    drag(page, left, (0.2, 0.2), (0.6, 0.25))
    until("the other view turns", lambda: difference(seen, picture(right)) > 0.005)

    asked = page.get_by_role("table", name="Asked")
    rows = {row.inner_text().split("\t")[0].strip(): row for row in asked.get_by_role("row").all()}
    assert rows["Prompt"].inner_text().split("\t")[1:] == ["a tall vase", "a fat penguin"]
    assert rows["Variation"].inner_text().split("\t")[1:] == ["0", "1"]
    assert "differs" not in (rows["Asset"].get_attribute("class") or "")
    assert "steps" not in rows, "what is the same is left out"
    result = page.get_by_role("table", name="Result")
    for name in ("Flipped faces", "Distortion, 99th percentile", "Time"):
        expect(result.get_by_role("row", name=re.compile(f"^{name}"))).to_be_visible()
    page.get_by_role("link", name="Swap").click()
    expect(page.locator(".viewer").nth(0).locator(".viewer-tag")).to_have_text("A · a fat penguin")


@pytest.mark.without_3d
def test_what_cannot_be_compared_is_said(page: Page, watch: Watch, pair: tuple[str, str]) -> None:
    watch.allow(r"status of 404 ")
    gone = pair[0][:-4] + "0000"
    page.goto(f"/#/compare/{pair[0]}/{gone}")
    expect(page.get_by_role("region", name="Job B")).to_contain_text("it was deleted, or belongs to another key")
    expect(page.locator(".compare").get_by_text("These jobs cannot be compared")).to_be_visible()


@pytest.mark.without_3d
def test_a_result_is_gone_on_from_taken_back_and_given_to_another_file(
    page: Page, service: Service, small_sphere: Path, tmp_path: Path
) -> None:
    params = {"preset": "preview", "steps": 2, "checkpoint_every_steps": 1}
    first = service.submit(small_sphere, {"prompt": "a tall vase", "params": params})
    assert service.finished(first)["state"] == "succeeded"
    page.goto(f"/#/jobs/{first}")
    versions = page.get_by_role("region", name="Versions")
    expect(page.get_by_role("button", name="Continue from it")).to_be_visible()
    expect(versions).to_be_hidden()
    page.get_by_role("button", name="Continue from it").click()
    expect(page.locator("#asset-facts")).to_contain_text("sphere.glb")
    page.get_by_label("Prompt", exact=True).fill("a fat penguin")
    set_steps(page, 2)
    second = start(page)
    until_judged(page)
    job = service.job(second)
    result = next(each for each in service.job(first)["artifacts"] if each["name"] == "result.glb")
    assert (job["metadata"]["thread"], job["asset"]["sha256"]) == (first, result["sha256"])
    expect(versions.get_by_role("listitem")).to_contain_text(
        ["“a tall vase”from sphere.obj", "“a fat penguin”after “a tall vase”", "Undo"]
    )
    versions.get_by_role("button", name="Compare with").first.click()
    page.wait_for_url(f"**/#/compare/{first}/{second}")
    page.go_back()
    page.get_by_role("link", name="Undo: back to the version before").click()
    page.wait_for_url(f"**/#/jobs/{first}")
    expect(versions.locator("[aria-current]")).to_contain_text("a tall vase")
    # Until the files are those of the first job, the field belongs to a view that is about to end.
    expect(page.get_by_role("region", name="Files", exact=True)).to_contain_text("sphere.obj")

    with page.expect_download() as download:
        page.get_by_label("Files to deform alike").set_input_files(small_sphere)
    assert download.value.suggested_filename == "sphere-edited.glb"
    download.value.save_as(tmp_path / "alike.glb")
    files = (tmp_path / "alike.glb").read_bytes(), service.artifact(first, "result.glb")
    shapes = [load_asset(data).surface.positions for data in files]
    np.testing.assert_allclose(*shapes, atol=0.05)
