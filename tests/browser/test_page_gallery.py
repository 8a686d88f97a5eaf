"""The examples of the page: a result at once on the workbench, and the same job live."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.acceptance.service import Service, until
from tests.browser.conftest import Watch
from tests.browser.steps import badge, difference, expect, open_form, open_more, picture, shown_job, until_drawn

if TYPE_CHECKING:
    from playwright.sync_api import Page


FOLDER = Path(__file__).parents[2] / "service" / "web" / "examples"
EXAMPLES: list[dict[str, Any]] = json.loads((FOLDER / "gallery.json").read_text())["examples"]
CHAIR = next(example for example in EXAMPLES if example["id"] == "chair")


@pytest.mark.live("preview")
def test_an_example_is_seen_at_once_and_runs_with_one_click(
    page: Page, watch: Watch, service: Service, small_sphere: Path
) -> None:
    open_form(page)
    expect(page.get_by_role("region", name="Examples").get_by_role("listitem")).to_have_count(6)
    page.get_by_role("link", name="All examples").click()
    expect(page.locator(".gallery").get_by_role("listitem")).to_have_count(len(EXAMPLES))
    page.go_back()
    page.get_by_role("region", name="Examples").get_by_role("link", name="a chair").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_label("Prompt", exact=True)).to_have_value("a chair")
    view = page.locator(".asset-panel .viewer").first
    expect(view.locator(".viewer-tag")).to_have_text("Result")
    result = until_drawn(view)
    assert watch.posted() == []
    assert "POST /v1/jobs:preview" not in watch.sent, "it came with the page"
    page.get_by_label("Strength", exact=True).fill("0")
    until("the asset is to be seen", lambda: difference(result, picture(view)) > 0.02)
    page.get_by_label("Strength", exact=True).fill("100")
    with service.held_jobs():
        before = service.submit(small_sphere, {"prompt": "a vase", "params": {"preset": "preview", "steps": 2}})
        service.at_step(before, 1)
        page.get_by_role("button", name="Keep").click()
        page.wait_for_url(re.compile(r"#/jobs/job_\w+$"))
        job = shown_job(page)
        expect(badge(page)).to_have_text("Queued")
        for each in (job, before):
            service.http.post(f"/v1/jobs/{each}/cancel")
    assert len(watch.posted()) == 1
    posted, asked = service.job(job), CHAIR["document"]
    assert posted["prompt"] == asked["prompt"]
    posted["params"].pop("checkpoint_every_steps", None)  # how often shapes on the way are kept
    assert posted["params"] == asked["params"]
    assert {name: posted["output"][name] for name in asked["output"]} == asked["output"]
    assert service.http.get(f"/v1/jobs/{job}/asset").content == (FOLDER / CHAIR["asset"]).read_bytes()
    expect(badge(page)).to_have_text("Canceled")


@pytest.mark.without_3d
def test_an_example_is_changed_first(page: Page) -> None:
    page.goto("/#/examples/kept-foot")
    expect(page.get_by_label("Prompt", exact=True)).to_have_value("a mushroom")
    expect(page.locator("#asset-facts")).to_contain_text("vase.glb")
    open_more(page)
    expect(page.get_by_role("list", name="Regions").get_by_role("listitem")).to_have_count(1)
    page.get_by_label("Prompt", exact=True).fill("a lamp")
    page.reload()  # the draft counts from then on
    expect(page.get_by_label("Prompt", exact=True)).to_have_value("a lamp")
    page.goto("/#/examples/no-such")
    expect(page.get_by_text("There is no example no-such.")).to_be_visible()
