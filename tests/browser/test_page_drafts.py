"""Nothing that was typed is lost, and nothing is changed without a word."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.acceptance.service import until
from tests.browser.conftest import Watch
from tests.browser.steps import choose, expect, keep, kept_files, open_form, open_more, set_steps

if TYPE_CHECKING:
    from playwright.sync_api import Page


pytestmark = pytest.mark.without_3d


def expect_draft(page: Page, prompt: str, seed: str) -> None:
    expect(page.get_by_label("Prompt", exact=True)).to_have_value(prompt)
    expect(page.locator("#asset-facts")).to_contain_text("sphere.obj")
    expect(page.get_by_label("Variation", exact=True)).to_have_value(seed)


def test_a_draft_survives_back_a_reload_and_a_closed_tab(page: Page, small_sphere: Path) -> None:
    open_form(page)
    choose(page, small_sphere)
    prompt = page.get_by_label("Prompt", exact=True)
    prompt.fill("a tall vase")
    open_more(page)
    page.get_by_label("Variation", exact=True).fill("4711")
    page.get_by_role("link", name="Jobs", exact=True).click()
    page.get_by_role("heading", level=1, name="Jobs").wait_for()
    page.go_back()
    expect_draft(page, "a tall vase", "4711")
    until("the file is kept", lambda: "sphere.obj" in kept_files(page))
    # What was typed last of all counts, a wrong number too.
    prompt.fill("a tall thin vase")
    open_more(page)
    page.get_by_label("Variation", exact=True).fill("-5")
    page.reload()
    expect_draft(page, "a tall thin vase", "-5")
    expect(page.locator("#seed-problem")).to_have_text("At least 0.")
    expect(page.get_by_text("Your draft is back.")).to_be_visible()
    # Another tab, as after a crash, with what was typed in the last moment.
    prompt.fill("a short thin vase")
    context = page.context
    page.close()
    other = context.new_page()
    other.goto("/")
    expect_draft(other, "a short thin vase", "-5")
    other.get_by_role("button", name="Start over").click()
    expect(other.locator("#asset-facts")).to_contain_text("horse.glb")
    expect(other.get_by_label("Prompt", exact=True)).to_have_value("")
    expect(other.locator("#seed-problem")).to_be_hidden()


def test_what_cannot_be_sent_is_marked_and_never_changed_silently(page: Page, watch: Watch, small_sphere: Path) -> None:
    open_form(page)
    choose(page, small_sphere)
    prompt = page.get_by_label("Prompt", exact=True)
    prompt.fill("a vase")
    set_steps(page, 12)
    estimate, start = page.locator("#estimate"), keep(page)
    expect(estimate).to_contain_text("12 steps")
    seed = page.get_by_label("Variation", exact=True)
    seed.fill("1.5")
    expect(page.locator("#seed-problem")).to_contain_text("Enter a whole number")
    # The last estimate is not that of this.
    expect(estimate).to_have_text("Correct the marked settings.")
    start.click()
    expect(seed).to_be_focused()
    expect(seed).to_have_value("1.5")
    assert watch.posted() == []
    # A server with one model offers no other.
    expect(page.get_by_label("Model", exact=True)).to_be_hidden()
