"""An asset is fitted to what a word stands for, or to the nearest of several meshes: the form and the result."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.acceptance.meshes import write_ellipsoid
from tests.acceptance.service import Service
from tests.browser.steps import barriers, choose, expect, open_form, open_more, start

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route

OUTLOOK = {
    "doubtful": True,
    "reasons": ["A sphere has nothing that could become four legs."],
    "suggestions": ["a mushroom", "a vase"],
}


@pytest.mark.without_3d
def test_a_word_is_used_by_its_shape(page: Page, service: Service, axe: str, small_sphere: Path) -> None:
    def foreseen(route: Route) -> None:
        doubtful = b"a horse" in (route.request.post_data_buffer or b"")
        outlook = OUTLOOK if doubtful else {**OUTLOOK, "doubtful": False}
        route.fulfill(json={**route.fetch().json(), "outlook": outlook})

    page.route("**/v1/jobs:validate", foreseen)
    open_form(page)
    choose(page, small_sphere)
    page.get_by_label("Prompt", exact=True).fill("a horse")
    open_more(page)
    quality, way = page.get_by_label("Quality", exact=True), page.get_by_label("How", exact=True)
    expect(way).to_have_value("shape")  # unless something else is chosen
    way.select_option("pictures")
    expect(quality).to_be_visible()
    way.select_option("shape")
    expect(quality).to_be_hidden()

    # What can hardly be is said, with what would work; it can start all the same.
    warning = page.locator(".outlook", has_text="nothing that could become")
    expect(warning).to_contain_text("nothing that could become four legs")
    expect(page.locator("#estimate")).to_contain_text("A fit")
    assert barriers(page, axe) == []
    warning.get_by_role("button", name="Use “a vase”").click()
    expect(page.locator("#prompt")).to_have_value("a vase")
    expect(warning).to_be_hidden()
    page.reload()  # a draft has it
    expect(way).to_have_value("shape")
    expect(page.locator("#estimate")).to_contain_text("A fit")
    with service.held_jobs():
        job = start(page)
        document = service.job(job)
        service.http.post(f"/v1/jobs/{job}/cancel")
    assert document["prompt"] == "a vase"
    assert document["params"]["guidance"] == {"kind": "exemplar"}
    expect(way).to_have_value("shape")


@pytest.mark.without_3d
def test_another_mesh_is_the_target(page: Page, service: Service, small_sphere: Path, tmp_path: Path) -> None:
    meshes = [write_ellipsoid(tmp_path / f"{name}.obj", height) for name, height in (("flat", 0.5), ("tall", 2.0))]
    open_form(page)
    choose(page, small_sphere)
    heads = page.locator(".guide-head")
    for mesh in meshes:  # another takes its place
        page.set_input_files("#target-file", mesh)
        expect(heads).to_have_text(re.compile(f"Target mesh{mesh.name}"))
    expect(page.locator("#estimate")).to_contain_text("A fit")
    with service.held_jobs():
        job = start(page)
        document = service.job(job)
        service.http.post(f"/v1/jobs/{job}/cancel")
    assert document["params"]["guidance"] == {"kind": "exemplar"}
    assert document["files"]["target"]["filename"] == "tall.obj"
    expect(heads).to_have_text(re.compile("Target meshtall.obj"))
    page.get_by_role("button", name="Remove the target").click()
    expect(heads).to_have_count(0)
