"""What goes wrong is said on the page, with what to do; and jobs are canceled, retried and branched."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import pytest

from tests.acceptance.service import Service, until
from tests.browser.conftest import Watch, watched
from tests.browser.steps import badge, choose, expect, keep, open_form, set_steps, shown_job, start, until_judged
from tests.fault_proxy import FaultProxy

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


pytestmark = pytest.mark.without_3d

ENDLESS: dict[str, Any] = {
    "prompt": "a mushroom",
    "params": {"preset": "preview", "steps": 50_000, "checkpoint_every_steps": 5, "seed": 7},
}


def test_a_file_that_is_broken_is_refused_with_advice_and_nothing_is_posted(
    page: Page, watch: Watch, repository: Path, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.glb"
    broken.write_bytes((repository / "examples" / "sphere.glb").read_bytes()[:5000])
    watch.allow(r"status of 4\d\d .*/v1/jobs:validate")
    open_form(page)
    page.get_by_label("Prompt", exact=True).fill("a mushroom")
    choose(page, broken)
    alert = page.get_by_label("Asset", exact=True).get_by_role("alert")
    expect(alert).to_contain_text("The GLB's header declares 115548 bytes, but the file has 5000.")
    expect(alert).to_contain_text("Send the whole file")
    keep(page).click()
    expect(keep(page)).to_be_enabled()
    expect(alert).to_be_visible()
    assert watch.posted() == []
    # Another file, and all is well again.
    choose(page, repository / "examples" / "cube.glb")
    expect(alert).to_be_hidden()
    expect(page.locator("#estimate")).to_contain_text("A fit")


def test_a_job_is_canceled_retried_and_branched(page: Page, watch: Watch, service: Service, small_sphere: Path) -> None:
    # A checkpoint every 5 steps: one that was listed has given way to newer ones when its mesh is asked for.
    watch.allow(r"status of 404 .*/checkpoints/\d+/mesh\.glb")
    first = service.submit(small_sphere, ENDLESS)
    page.goto(f"/?job={first}")
    page.wait_for_url(f"**/#/jobs/{first}")
    shapes = page.get_by_role("group", name="Shapes so far").get_by_role("button", name=re.compile("Step"))
    expect(shapes.first).to_be_visible()
    page.get_by_role("button", name="Cancel").click()
    expect(badge(page)).to_have_text("Canceled")
    assert service.job(first)["state"] == "canceled"

    # Other words from one of its steps.
    page.reload()
    expect(shapes.first).to_be_visible()
    step = int(re.sub(r"\D", "", (shapes.first.get_attribute("title") or "")))
    shapes.first.click()
    expect(page.get_by_role("button", name=f"Starts from step {step}: start from the asset instead")).to_be_visible()
    page.get_by_label("Prompt", exact=True).fill("a tall vase")
    branch = start(page)
    job = service.job(branch)
    assert (job["prompt"], job["origin"]) == ("a tall vase", {"job_id": first, "step": step, "mode": "branch"})
    expect(page.get_by_role("heading", level=1)).to_have_text("“a tall vase”")
    page.get_by_role("button", name="Cancel").click()
    expect(badge(page)).to_have_text("Canceled")

    page.get_by_role("button", name="Retry").click()
    page.wait_for_url(lambda url: branch not in url)
    retry = shown_job(page)
    # It had no checkpoint of its own: the retry begins where the branch began.
    again = service.job(retry)
    assert (again["prompt"], again["origin"]["job_id"], again["origin"]["step"]) == ("a tall vase", first, step)
    expect(badge(page)).to_have_text("Running")
    page.get_by_role("button", name="Cancel").click()
    expect(badge(page)).to_have_text("Canceled")

    page.get_by_role("button", name="Delete").click()
    page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    page.wait_for_url("**/#/jobs")
    page.reload()
    until("the job is deleted", lambda: service.http.get(f"/v1/jobs/{retry}").status_code == 404)


def test_a_server_that_is_away_is_said_to_be_away_and_nothing_is_lost(
    browser: Browser, service: Service, small_sphere: Path, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    port = urlsplit(str(service.http.base_url)).port
    assert port is not None
    with (
        FaultProxy(port) as proxy,
        watched(browser, f"http://127.0.0.1:{proxy.port}", request, tmp_path) as (page, watch),
    ):
        watch.allow(r"net::ERR_|status of 503 ")
        open_form(page)
        choose(page, small_sphere)
        page.get_by_label("Prompt", exact=True).fill("a tall vase")
        set_steps(page, 8)
        expect(page.locator("#estimate")).to_contain_text("8 steps")
        before = len(service.http.get("/v1/jobs", params={"limit": 100}).json()["jobs"])
        proxy.refuse()
        keep(page).click()
        expect(page.get_by_role("alert").filter(has_text="The server does not answer.")).to_be_visible()
        proxy.pass_through()
        with service.held_jobs():
            job_id = start(page)
            expect(page.locator(".view-job")).to_be_visible()  # so its modules are loaded
            service.at_step(job_id, 1)
            notice = page.locator(".notice")
            for fault in (proxy.refuse, proxy.error503):
                fault()
                expect(notice).to_contain_text("Reconnecting; your job is safe")
                proxy.pass_through()
                expect(notice).to_be_hidden()
        until_judged(page)
        # What was sent again and again is one job.
        assert len(service.http.get("/v1/jobs", params={"limit": 100}).json()["jobs"]) == before + 1


def test_a_view_whose_modules_do_not_arrive_is_loaded_once_the_server_answers(page: Page, watch: Watch) -> None:
    open_form(page)
    page.get_by_label("Prompt", exact=True).fill("a mushroom")
    watch.allow(r"net::ERR_FAILED")
    page.route("**/app/**", lambda route: route.abort())
    with page.expect_request("**/web/app/main.js"):  # it asks whether the server is back
        page.get_by_role("link", name="Jobs", exact=True).click()
        expect(page.get_by_role("heading", name="The page could not be loaded")).to_be_visible()
    page.unroute_all()
    expect(page.get_by_role("heading", name="Jobs", exact=True)).to_be_visible()
    page.get_by_role("link", name="Create", exact=True).click()
    expect(page.get_by_label("Prompt", exact=True)).to_have_value("a mushroom")


def test_a_job_that_is_not_there_is_said_to_be_so(page: Page, watch: Watch) -> None:
    watch.allow(r"status of 404 .*/v1/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6")
    page.goto("/#/jobs/job_01kg9zqk2xf3v8c5m7n9p1r4t6")
    expect(page.get_by_role("alert")).to_contain_text("There is no job")
    page.get_by_role("link", name="All jobs").click()
    expect(page.get_by_role("heading", level=1, name="Jobs")).to_be_visible()
    page.goto("/#/nowhere")
    expect(page.get_by_role("heading", level=1)).to_have_text("Not found")
