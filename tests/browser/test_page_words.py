"""Words of one's own on the page: meshes are dropped and named, and the prompt knows the noun at once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from meshdeform.assets import build_glb
from meshdeform.settings import Settings
from tests.browser.conftest import watched
from tests.browser.steps import expect, open_form
from tests.in_process import children_in_process
from tests.integration.conftest import serving
from tests.unit.words.words import box

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


@pytest.fixture
def page(browser: Browser, request: pytest.FixtureRequest, redis_url: str, tmp_path: Path) -> Iterator[Page]:
    """A page of a service in this process."""
    settings = Settings(data_dir=tmp_path / "data", redis_url=redis_url, queue="test-page-words")
    with (
        children_in_process(),
        serving(settings) as url,
        watched(browser, url, request, tmp_path) as (found, watch),
    ):
        watch.allow("422")  # a refusal is part of the test
        yield found


@pytest.mark.without_pictures
def test_a_word_is_added_offered_downloaded_removed_and_added_again(page: Page, tmp_path: Path) -> None:
    shape = box(1, 2, 3)
    path = tmp_path / "a.glb"
    path.write_bytes(build_glb(shape.verts, shape.faces))
    page.goto("/")
    page.get_by_role("link", name="Your words").click()
    expect(page.get_by_role("heading", name="No words yet")).to_be_visible()
    expect(page.get_by_label("Noun")).to_have_value("dragonfruit")
    expect(page.locator(".zone-pictures img")).to_have_count(1)
    page.get_by_role("button", name="Remove dragonfruit.glb").click()  # the sample
    expect(page.locator(".zone-pictures img")).to_have_count(0)
    expect(page.get_by_label("Noun")).to_have_value("")
    page.get_by_role("button", name="Add the word").click()
    expect(page.get_by_text("Choose at least one mesh.")).to_be_visible()
    page.get_by_label("Mesh files").set_input_files(path)
    page.get_by_label("Noun").fill("mushroom")
    page.get_by_role("button", name="Add the word").click()
    expect(page.get_by_text("take its place under More options")).to_be_visible()
    page.get_by_label("Noun").fill("Dragon fruit")
    page.get_by_label("Other names").fill("pitaya, strawberry pear")
    page.get_by_role("button", name="Add the word").click()
    word = page.get_by_role("region", name="Your words").get_by_role("listitem")
    expect(word).to_contain_text("also pitaya, strawberry-pear")
    expect(word.get_by_role("img", name="Meshes of dragon-fruit")).to_be_visible()
    with page.expect_download() as download:
        word.get_by_role("button", name="Download dragon-fruit").click()
    download.value.save_as(tmp_path / "mine.word")
    open_form(page)
    page.get_by_role("group", name="Suggested prompts").get_by_role("button", name="a dragon-fruit").click()
    expect(page.locator("#estimate")).to_contain_text("A fit")
    page.get_by_role("link", name="Your words").click()
    word.get_by_role("button", name="Remove dragon-fruit").click()
    page.get_by_role("dialog").get_by_role("button", name="Remove").click()
    expect(page.get_by_role("heading", name="No words yet")).to_be_visible()
    page.get_by_label("Mesh files").set_input_files([tmp_path / "mine.word"])
    page.get_by_role("button", name="Add the word").click()
    expect(word).to_contain_text("also pitaya, strawberry-pear")
