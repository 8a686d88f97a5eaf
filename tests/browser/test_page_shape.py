"""An asset is fitted to what a word stands for, or to the nearest of several meshes: the form and the result."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.acceptance.meshes import write_ellipsoid
from tests.acceptance.service import Service
from tests.browser.steps import barriers, choose, expect, open_form, open_more, shown_job, start

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route

OUTLOOK = {
    "doubtful": True,
    "reasons": ["A sphere has nothing that could become four legs."],
    "suggestions": ["a mushroom", "a vase"],
}
FIT = {"member": {"noun": "bird", "form": "bird", "pose": "folded"}, "target": None, "kept": 0.93}


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
    quality, strength = page.get_by_role("group", name="Quality"), page.get_by_label("Strength", exact=True)
    way = page.get_by_role("group", name="How")
    expect(way.get_by_label("By shape")).to_be_checked()  # unless something else is chosen
    way.get_by_text("By pictures").click()
    expect(strength).to_be_hidden()
    expect(quality).to_be_visible()
    way.get_by_text("By shape").click()
    expect(quality).to_be_hidden()
    strength.fill("80")
    expect(strength).to_have_attribute("aria-valuetext", "80 percent")
    open_more(page)
    expect(page.get_by_label("Negative prompt")).to_be_hidden()
    expect(page.get_by_text("each in many designs")).to_be_visible()

    # What can hardly be is said, with what would work; it can start all the same.
    warning = page.locator(".outlook")
    expect(warning).to_contain_text("nothing that could become four legs")
    expect(page.locator("#estimate")).to_contain_text("A fit")
    assert barriers(page, axe) == []
    warning.get_by_role("button", name="Use “a vase”").click()
    expect(page.locator("#prompt")).to_have_value("a vase")
    expect(warning).to_be_hidden()
    page.reload()  # a draft has it
    expect(way.get_by_label("By shape")).to_be_checked()
    expect(strength).to_have_value("80")
    expect(page.locator("#estimate")).to_contain_text("A fit")
    with service.held_jobs():
        job = start(page)
        document = service.job(job)
        service.http.post(f"/v1/jobs/{job}/cancel")
    assert document["prompt"] == "a vase"
    assert document["params"]["guidance"] == {"kind": "exemplar", "strength": 0.8}
    expect(page.get_by_role("region", name="Control")).to_contain_text("Strength: 80%")
    page.get_by_role("button", name="Edit and run again").click()
    expect(way.get_by_label("By shape")).to_be_checked()
    expect(strength).to_have_value("80")


@pytest.mark.without_3d
def test_the_nearest_of_several_meshes_is_the_target(
    page: Page, service: Service, small_sphere: Path, tmp_path: Path
) -> None:
    meshes = [write_ellipsoid(tmp_path / f"{name}.obj", height) for name, height in (("flat", 0.5), ("tall", 2.0))]
    open_form(page)
    choose(page, small_sphere)
    open_more(page)
    way = page.get_by_role("group", name="How")
    heads = page.locator(".guide-head")
    way.get_by_text("By pictures").click()
    # Pushed to a mesh, the asset has one target: another takes its place.
    for mesh in meshes:
        page.set_input_files("#target-file", mesh)
        expect(heads).to_have_count(1)
        expect(heads).to_contain_text(mesh.name)
    way.get_by_text("By shape").click()
    page.set_input_files("#target-file", meshes[0])
    expect(heads).to_have_text([re.compile("Target 1tall.obj"), re.compile("Target 2flat.obj")])
    expect(page.get_by_text("nearest to your asset")).to_be_visible()
    expect(way.get_by_label("By pictures")).to_be_disabled()
    page.get_by_role("button", name="Show target 1").click()
    expect(page.get_by_role("button", name="Show target 1")).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#estimate")).to_contain_text("A fit")
    with service.held_jobs():
        job = start(page)
        document = service.job(job)
        service.http.post(f"/v1/jobs/{job}/cancel")
    assert document["params"]["guidance"] == {"kind": "exemplar"}
    assert {part: file["filename"] for part, file in document["files"].items() if part != "asset"} == {
        "target": "tall.obj",
        "target_2": "flat.obj",
    }
    page.get_by_role("button", name="Edit and run again").click()
    expect(heads).to_have_count(2)
    page.get_by_role("button", name="Remove target 1").click()
    expect(heads).to_have_text([re.compile("Target meshflat.obj")])
    expect(way.get_by_label("By pictures")).to_be_enabled()


@pytest.mark.without_3d
def test_a_result_says_what_it_was_fitted_to_and_another_design_is_a_click_away(
    page: Page, service: Service, small_sphere: Path
) -> None:
    job = service.submit(small_sphere, {"prompt": "a vase", "params": {"preset": "preview", "steps": 1}})
    assert service.finished(job)["state"] == "succeeded"

    def reported(route: Route) -> None:
        report: dict[str, Any] = route.fetch().json()
        route.fulfill(json={**report, "exemplars": [FIT]})

    page.route("**/artifacts/report.json", reported)
    page.goto(f"/#/jobs/{job}")
    quality = page.get_by_role("region", name="Quality")
    expect(quality).to_contain_text("Fitted to a bird, wings folded: 93% of the way")
    with service.held_jobs():
        page.get_by_role("button", name="Another design").click()
        page.wait_for_url(re.compile(rf"#/jobs/(?!{job})job_\w+$"))
        other = service.job(shown_job(page))
        service.http.post(f"/v1/jobs/{other['id']}/cancel")
    assert other["prompt"] == "a vase"
    assert other["params"]["seed"] != 0
