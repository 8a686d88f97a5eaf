"""The reference of the API, programs to copy, and usage: read, searched and copied, without barriers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from tests.acceptance.service import Service
from tests.browser.steps import OF_COLOURS, RULES, barriers, expect

if TYPE_CHECKING:
    from playwright.sync_api import Page


def sideways(page: Page) -> int:
    """By how many pixels the page scrolls sideways."""
    return int(page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth"))


def test_the_reference_is_read_searched_and_copied(page: Page, service: Service, axe: str) -> None:
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.goto("/")
    page.get_by_role("navigation").get_by_role("link", name="API").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("API")
    expect(page.get_by_role("link", name="API", exact=True)).to_have_attribute("aria-current", "page")

    # A program in the language that is chosen, by keyboard too; the choice lasts.
    job = page.locator(".snippet").first
    job.get_by_role("tab", name="curl").press("ArrowRight")
    expect(job.get_by_role("tab", name="Python")).to_have_attribute("aria-selected", "true")
    job.get_by_role("button", name="Copy").click()
    copied = page.evaluate("navigator.clipboard.readText()")
    assert copied == job.get_by_role("tabpanel").inner_text()
    assert f"Client({str(service.http.base_url).rstrip('/')!r})".replace("'", '"') in copied
    page.reload()
    expect(job.get_by_role("tab", name="Python")).to_have_attribute("aria-selected", "true")

    page.get_by_label("Find a request").fill("usage")
    expect(page.get_by_role("status").filter(has_text="request")).to_have_text("1 request")
    found = page.locator(".api-operation")
    found.locator("summary").first.press("Enter")
    members = found.get_by_text("Members")
    members.click()
    expect(members).to_have_count(2)  # schemas are shown as far as somebody looks
    members.last.click()
    expect(found).to_contain_text("Seconds for which workers had jobs")
    expect(found.locator("pre")).to_have_text(re.compile(r"^curl -sS \S+/v1/usage$"))
    page.get_by_label("Find a request").fill("create_job")
    page.locator(".api-operation summary").first.click()
    for scheme, rules in (("light", RULES), ("dark", OF_COLOURS)):
        page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
        assert barriers(page, axe, rules) == [], scheme
    for width in (390, 1280, 1920):
        page.set_viewport_size({"width": width, "height": 900})
        assert sideways(page) <= 0, width


def test_usage_is_shown_by_month(page: Page, service: Service, small_sphere: Path, axe: str) -> None:
    job = service.submit(small_sphere, {"prompt": "a vase", "params": {"preset": "preview", "steps": 1}})
    assert service.finished(job)["state"] == "succeeded"
    page.goto("/#/api")
    page.get_by_role("link", name="what you have used").click()
    table = page.get_by_role("table")
    expect(table.get_by_role("columnheader")).to_have_text(["Month", "Jobs", "Seconds", "Megabytes"])
    assert int(table.get_by_role("cell").first.inner_text()) >= 1
    assert barriers(page, axe) == []
