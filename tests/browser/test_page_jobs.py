"""The page's main path in a real browser: a file, a prompt, a job that is watched, a result to look at and to keep."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.acceptance.service import Service, until
from tests.browser.conftest import Watch
from tests.browser.steps import (
    badge,
    choose,
    difference,
    expect,
    open_form,
    open_more,
    picture,
    set_steps,
    start,
    straight_way,
    until_drawn,
    until_judged,
    upper_half,
)
from tests.browser.viewer.site import WEB, smaller

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route


def smaller_turntable(route: Route) -> None:
    """Answer with a turntable of few small pictures."""
    route.fulfill(body=smaller(WEB / "viewer/turntable.js"), content_type="text/javascript")


def test_a_file_becomes_a_result_that_is_looked_at_and_kept(
    page: Page, watch: Watch, service: Service, small_sphere: Path
) -> None:
    straight_way(page, watch)
    page.route("**/turntable.js", smaller_turntable)
    open_form(page)
    choose(page, small_sphere)
    expect(page.locator("#asset-facts")).to_contain_text("320 triangles")
    until_drawn(page.locator(".asset-panel .viewer"))
    page.get_by_label("Prompt", exact=True).fill("a mushroom with a big cap")
    set_steps(page, 12)
    expect(page.locator("#estimate")).to_contain_text("12 steps")
    assert watch.posted() == []

    # Live: a step in the middle is seen, not only the end.
    with service.held_jobs():
        job_id = start(page)
        assert watch.posted() == ["POST /v1/jobs"]
        job = service.job(job_id)
        assert (job["prompt"], job["asset"]["filename"]) == ("a mushroom with a big cap", "sphere.obj")
        assert (job["params"]["steps"], job["params"]["seed"]) == (12, 7)
        expect(page.get_by_label("Progress").locator(".progress-numbers")).to_contain_text("Step 1 of 12")
        expect(badge(page)).to_have_text("Running")
    until_judged(page)

    after, before = page.locator(".viewer").first, page.locator(".before .viewer")
    strength = page.get_by_label("Strength", exact=True)
    expect(strength).to_be_visible()
    expect(after.locator(".viewer-tag")).to_have_text("Result")  # no step on the way
    page.get_by_text("Side by side").click()
    until_drawn(before)
    deformed = until_drawn(after)
    assert difference(picture(before), deformed) > 0.02
    strength.fill("0")
    # But for the ground, which lies below the lower of both shapes: the upper half is compared.
    until("both sides are alike", lambda: difference(upper_half(before), upper_half(after)) < 0.002)
    strength.fill("100")
    until("the deformation is back", lambda: difference(deformed, picture(after)) < 0.002)

    def saved(button: str) -> tuple[str, bytes]:
        with page.expect_download() as download:
            page.get_by_role("button", name=button, exact=True).click()
        return download.value.suggested_filename, download.value.path().read_bytes()

    stem = "sphere-a-mushroom-with-a-big-cap-seed7"
    assert saved("Download") == (f"{stem}.glb", service.artifact(job_id, "result.glb"))
    page.get_by_label("Format").select_option("result.stl")  # made as it is asked for
    assert saved("Download") == (f"{stem}.stl", service.artifact(job_id, "result.stl"))
    open_more(page)
    assert saved("Download result.glb") == (f"{stem}.glb", service.artifact(job_id, "result.glb"))
    assert saved("Download sphere.obj") == ("sphere.obj", small_sphere.read_bytes())
    name, video = saved("Save a turntable as WebM")
    assert (name, video[:4]) == ("turntable.webm", b"\x1a\x45\xdf\xa3")
    assert len(video) > 2000


@pytest.mark.without_pictures
def test_a_file_is_dropped_anywhere_on_the_page(page: Page, small_sphere: Path) -> None:
    open_form(page)
    page.evaluate(
        """([name, content]) => {
          const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
          const carried = new DataTransfer();
          carried.items.add(new File([bytes], name));
          for (const kind of ["dragenter", "dragover", "drop"]) {
            const event = new DragEvent(kind, { bubbles: true, cancelable: true, dataTransfer: carried });
            const taken = !document.querySelector("h1").dispatchEvent(event);
            if (kind !== "dragenter" && !taken) throw new Error(`${kind} was left to the browser`);
          }
        }""",
        ["dropped.obj", base64.b64encode(small_sphere.read_bytes()).decode()],
    )
    expect(page.locator("#asset-facts")).to_contain_text("dropped.obj")
    expect(page.locator("#asset-facts")).to_contain_text("320 triangles")


@pytest.mark.without_3d
def test_a_large_file_is_uploaded_once_and_the_form_says_how_far(
    page: Page, watch: Watch, service: Service, small_sphere: Path, tmp_path: Path
) -> None:
    large = tmp_path / "large.obj"
    large.write_bytes(b"#" * (5 << 18) + b"\n" + small_sphere.read_bytes())
    held: list[Route] = []
    page.route("**/v1/uploads/*/content*", lambda route: route.continue_() if held else held.append(route))
    open_form(page)
    page.get_by_label("Prompt", exact=True).fill("a vase")
    set_steps(page, 4)
    with page.expect_request("**/v1/uploads/*/content*"):
        choose(page, large)
    expect(page.locator("#estimate")).to_have_text("Uploading, 0%")
    held[0].continue_()
    expect(page.locator("#estimate")).to_contain_text("4 steps")
    job = service.job(start(page))
    assert (job["asset"]["filename"], job["asset"]["size"]) == ("large.obj", large.stat().st_size)
    # The check, the check before the start and the job: all by one upload. A request without an answer is repeated.
    sent = [line.split("/")[3] for line in watch.sent if line.startswith("PUT /v1/uploads/")]
    assert sent
    assert len(set(sent)) == 1
    assert watch.posted() == ["POST /v1/jobs"]


@pytest.mark.without_pictures
def test_a_lost_worker_is_said_and_the_job_continues(page: Page, service: Service, small_sphere: Path) -> None:
    params = {"preset": "preview", "steps": 12, "checkpoint_every_steps": 2, "seed": 7}
    with service.held_jobs():
        job_id = service.submit(small_sphere, {"prompt": "a tall vase", "params": params})
        page.goto(f"/#/jobs/{job_id}")
        service.at_step(job_id, 1)
        numbers = page.get_by_label("Progress").locator(".progress-numbers")
        expect(numbers).to_contain_text("Step 1 of 12 · 8%")
        service.part("-m", "worker.process").kill()
        expect(page.locator(".notice")).to_have_text(
            re.compile(r"The worker was lost at step \d+\. The job continues by itself from its last checkpoint\.")
        )
        expect(numbers).to_contain_text("attempt 2")
    until_judged(page)
    expect(page.locator(".notice")).to_be_hidden()

    # The same words at the next quality, on the page of the job.
    open_more(page)
    page.get_by_role("combobox", name="Quality").select_option("balanced")
    page.get_by_role("button", name="Drop them").click()
    with service.held_jobs():
        better = service.job(start(page))
        assert (better["prompt"], better["params"]["preset"], better["params"]["seed"]) == (
            "a tall vase",
            "balanced",
            7,
        )
        assert "steps" not in better["params"]
        assert better["asset"]["sha256"] == service.job(job_id)["asset"]["sha256"]


@pytest.mark.without_3d
def test_jobs_are_searched_and_several_are_deleted(page: Page, service: Service, small_sphere: Path) -> None:
    other = small_sphere.with_name("crate.obj")
    other.write_bytes(small_sphere.read_bytes())
    with service.held_jobs():
        jobs = [
            service.submit(asset, {"prompt": prompt, "params": {"preset": "preview", "steps": 2}})
            for asset, prompt in ((small_sphere, "a turtle"), (other, "a turtle"), (other, "a bell"))
        ]
        for job in reversed(jobs):  # those that wait first: they end at once
            service.http.post(f"/v1/jobs/{job}/cancel")
    for job in jobs:
        assert service.finished(job)["state"] == "canceled"
    page.goto("/#/jobs")
    search, shown = page.get_by_label("Search jobs"), page.locator(".card:visible")
    expect(page.get_by_role("link", name="a bell")).to_be_visible()
    search.fill("TURTLE crate")
    expect(shown).to_have_count(1)
    expect(shown).to_contain_text("crate.obj")
    expect(page.get_by_role("paragraph").filter(has_text="1 job found.")).to_be_visible()
    # Back from the job, the search is still there.
    shown.get_by_role("link").click()
    expect(badge(page)).to_be_visible()
    page.go_back()
    expect(search).to_have_value("TURTLE crate")
    expect(shown).to_have_count(1)
    search.fill("crate")
    expect(shown).to_have_count(2)
    page.get_by_role("button", name="Select", exact=True).click()
    page.get_by_role("button", name="Select all finished").click()
    page.get_by_role("button", name="Delete 2 jobs").click()
    dialog = page.get_by_role("dialog", name="Delete 2 jobs?")
    dialog.get_by_role("button", name="Delete").click()
    expect(dialog).to_have_count(0)
    expect(shown).to_have_count(0)
    # Those that the search hid are still there.
    assert [service.http.get(f"/v1/jobs/{job}").status_code for job in jobs] == [200, 404, 404]
