"""A word is taught on the page: meshes, names, the lesson, what it learned, and a prompt with the new word."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from meshdeform.runs import start_run
from meshdeform.settings import Settings
from tests.browser.conftest import watched
from tests.browser.steps import badge, expect
from tests.in_process import children_in_process
from tests.integration.conftest import serving
from tests.taught import shorten_lessons, write_small_weights
from tests.worker_world import working

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


@pytest.fixture
def page(
    browser: Browser, request: pytest.FixtureRequest, redis_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Page]:
    """A page of a service in this process, where a lesson is short and the model small."""
    shorten_lessons(monkeypatch)
    (tmp_path / "models").mkdir()
    write_small_weights(tmp_path / "models" / "small.safetensors")
    settings = Settings(
        data_dir=tmp_path / "data", redis_url=redis_url, queue="test-page-teach", models=str(tmp_path / "models")
    )
    with (
        children_in_process(),
        serving(settings) as url,
        working(settings, start_run),
        watched(browser, url, request, tmp_path) as (found, watch),
    ):
        watch.allow("422")  # a refusal is part of the test
        yield found


@pytest.mark.without_3d
def test_a_word_is_taught_and_used(page: Page, small_sphere: Path) -> None:
    page.goto("/")
    page.get_by_role("link", name="Teach").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Teach it a word")
    page.get_by_role("button", name="Teach", exact=True).click()
    expect(page.get_by_text("Type the word first.")).to_be_visible()

    mesh = small_sphere.read_bytes()
    page.get_by_label("Mesh files").set_input_files(
        [
            {"name": "pot.obj", "mimeType": "model/obj", "buffer": mesh},
            {"name": "pot.obj", "mimeType": "model/obj", "buffer": mesh},
            {"name": "spare.obj", "mimeType": "model/obj", "buffer": mesh},
        ]
    )
    page.get_by_role("button", name="Remove spare.obj").click()
    expect(page.get_by_text("2 files")).to_be_visible()
    page.get_by_label("What pot.obj is").last.select_option("tall")
    page.get_by_label("Add the word to").select_option("small")
    page.get_by_label("Other names").fill("kettle")
    page.get_by_text("Advanced").click()
    page.get_by_label("Most steps").fill("2")
    page.get_by_label("Word", exact=True).fill("a vase")
    page.get_by_role("button", name="Teach", exact=True).click()
    expect(page.get_by_text("The model knows 'vase' already.")).to_be_visible()

    page.get_by_label("Word", exact=True).fill("a teapot")
    page.get_by_role("button", name="Teach", exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_have_text("The word “a teapot”")
    expect(badge(page)).to_have_text("Succeeded")
    expect(page.locator(".stage-picture img")).to_be_visible()
    expect(page.get_by_text("old words that were tried are still known")).to_be_visible()
    page.get_by_text("Settings", exact=True).click()
    expect(page.get_by_text('["kettle"]')).to_be_visible()

    page.get_by_role("link", name="Use “a teapot”").click()
    expect(page.get_by_label("Prompt", exact=True)).to_have_value("a teapot")
    expect(page.get_by_label("Model", exact=True).locator("option:checked")).to_have_text("teapot")
    expect(page.get_by_text("steps, about")).to_be_visible()
    page.get_by_label("Prompt", exact=True).fill("a tall kettle")
    expect(page.get_by_text("steps, about")).to_be_visible()
    page.get_by_label("Prompt", exact=True).fill("a giraffe")
    expect(page.locator("#prompt-problem")).to_contain_text("giraffe")
