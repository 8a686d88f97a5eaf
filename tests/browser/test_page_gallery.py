"""The examples of the page: a result at once, without a key, and the same job live."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.acceptance.service import Service
from tests.browser.conftest import Watch
from tests.browser.steps import badge, difference, expect, open_form, open_more, picture, shown_job, until_drawn

if TYPE_CHECKING:
    from playwright.sync_api import Page


FOLDER = Path(__file__).parents[2] / "service" / "web" / "examples"
EXAMPLES: list[dict[str, Any]] = json.loads((FOLDER / "gallery.json").read_text())["examples"]
CHAIR = next(example for example in EXAMPLES if example["id"] == "chair")


def test_an_example_is_seen_at_once_and_runs_with_one_click(page: Page, watch: Watch, service: Service) -> None:
    open_form(page)
    expect(page.get_by_role("region", name="Examples").get_by_role("listitem")).to_have_count(6)
    page.get_by_role("link", name="All examples").click()
    expect(page.locator(".gallery").get_by_role("listitem")).to_have_count(len(EXAMPLES))
    page.go_back()
    page.get_by_role("region", name="Examples").get_by_role("link", name="a chair").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", level=1, name="“a chair”")).to_be_visible()
    before, after = page.locator(".viewer").nth(0), page.locator(".viewer").nth(1)
    expect(page.get_by_label("Strength", exact=True)).to_be_visible()
    until_drawn(after)
    assert difference(picture(before), picture(after)) > 0.02
    page.get_by_text("Displacement", exact=True).click()
    expect(page.locator(".legend")).to_contain_text("Displacement")
    assert watch.posted() == []
    with service.held_jobs():
        page.get_by_role("button", name="Run it").click()
        page.wait_for_url(re.compile(r"#/jobs/job_\w+$"))
        job = shown_job(page)
        expect(badge(page)).to_have_text(re.compile("Queued|Running"))
        service.http.post(f"/v1/jobs/{job}/cancel")
    assert len(watch.posted()) == 1
    posted, asked = service.job(job), CHAIR["document"]
    assert posted["prompt"] == asked["prompt"]
    assert posted["params"] == asked["params"]
    assert {name: posted["output"][name] for name in asked["output"]} == asked["output"]
    assert service.http.get(f"/v1/jobs/{job}/asset").content == (FOLDER / CHAIR["asset"]).read_bytes()
    expect(badge(page)).to_have_text("Canceled")


@pytest.mark.without_3d
def test_an_example_is_changed_first(page: Page) -> None:
    page.goto("/#/examples/kept-foot")
    expect(page.get_by_text("Painted vase, its foot kept")).to_be_visible()
    page.get_by_role("button", name="Change it first").click()
    expect(page.get_by_label("Prompt", exact=True)).to_have_value("a mushroom")
    expect(page.locator("#asset-facts")).to_contain_text("vase.glb")
    open_more(page)
    expect(page.get_by_role("list", name="Regions and handles").get_by_role("listitem")).to_have_count(1)
    page.get_by_label("Prompt", exact=True).fill("a lamp")
    page.reload()  # the draft counts from then on
    expect(page.get_by_label("Prompt", exact=True)).to_have_value("a lamp")
    page.goto("/#/examples/no-such")
    expect(page.get_by_text("There is no example no-such.")).to_be_visible()


@pytest.mark.without_3d
def test_looking_needs_no_key_and_no_job(page: Page, watch: Watch) -> None:
    watch.allow(r"status of 401 ")
    refused = {"code": "unauthorized", "title": "An API key is required"}
    page.route("**/v1/**", lambda route: route.fulfill(status=401, json=refused))
    page.goto("/#/examples")
    page.get_by_role("link", name="a chair").click()
    expect(page.get_by_text(re.compile("^It looks like a chair"))).to_be_visible()
    expect(page.get_by_role("dialog")).to_have_count(0)
    assert not [line for line in watch.sent if " /v1/" in line]
    page.get_by_role("button", name="Run it").click()
    expect(page.get_by_role("dialog", name="API key")).to_be_visible()
