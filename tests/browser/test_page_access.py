"""The page for everybody: behind an API key, by the keyboard, on a phone, in the dark, and to assistive technology."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx
import pytest

from meshdeform.record.database import Database
from meshdeform.record.keys import KeyRing
from meshdeform.settings import Settings
from tests.acceptance.service import Service
from tests.browser.conftest import Watch, watched
from tests.browser.steps import (
    OF_COLOURS,
    RULES,
    badge,
    barriers,
    choose,
    expect,
    open_form,
    open_more,
    read_all_alike,
    set_steps,
    shown_job,
    start,
    straight_way,
    until_judged,
    until_noted,
)
from tests.fake_kind import FakeKind
from tests.integration.conftest import serving
from tests.worker_world import working

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


PHONE: dict[str, Any] = {
    "viewport": {"width": 360, "height": 740},
    "device_scale_factor": 1,
    "has_touch": True,
    "is_mobile": True,
}


@pytest.fixture(scope="session")
def finished(service: Service, small_sphere: Path) -> str:
    """A job that has succeeded, with everything that a job can have."""
    request = {
        "prompt": "a mushroom with a big cap",
        "params": {"preset": "preview", "steps": 12, "checkpoint_every_steps": 4, "seed": 7},
        "output": {"morph": True},
        "metadata": {"group": "access"},
    }
    job_id = service.submit(small_sphere, request)
    assert service.finished(job_id)["state"] == "succeeded"
    return job_id


def views(page: Page, finished: str) -> Iterator[str]:
    """Each view of the page, once it is complete."""
    open_form(page)
    open_more(page)
    page.get_by_text(re.compile(r"^All \d+ nouns")).click()
    page.get_by_text("Control", exact=True).click()
    page.evaluate("() => document.activeElement.blur()")
    page.get_by_role("heading", name="Recent jobs").wait_for()
    yield "form"
    page.goto("/#/surface")
    page.get_by_role("form", name="New surface fit").get_by_label("Steps", exact=True).wait_for()
    page.get_by_text("Advanced", exact=True).click()
    yield "surface form"
    page.goto(f"/#/jobs/{finished}")
    open_more(page)
    page.get_by_role("button", name="Download result.glb").wait_for()
    page.get_by_role("heading", name="All settings").click()
    yield "job"
    page.goto("/#/jobs")
    page.locator(".card").first.wait_for()
    page.get_by_role("button", name="Select", exact=True).click()
    yield "jobs"
    page.goto("/#/groups/access")  # they hang on the wall
    page.locator(".many-card .badge-good, .many-card .badge-doubtful, .many-card .badge-keep_source").first.wait_for()
    yield "group"
    page.goto("/#/examples")
    page.locator(".gallery .card").first.wait_for()
    yield "examples"
    page.goto("/#/many")
    page.locator(".many-card").nth(5).wait_for()
    yield "many"
    page.goto("/#/examples/kept-foot")
    expect(page.get_by_label("Prompt", exact=True)).not_to_have_value("")
    open_more(page)
    page.get_by_role("list", name="Regions").get_by_role("listitem").wait_for()
    yield "example"
    other = finished[:-4] + "0000"  # the same job under another name
    page.route(f"**/{other}**", lambda route: route.continue_(url=route.request.url.replace(other, finished)))
    page.goto(f"/#/compare/{finished}/{other}")
    page.locator(".verdict p").first.wait_for()
    yield "comparison"


@pytest.mark.without_3d
def test_a_server_that_wants_a_key_is_given_one(
    browser: Browser, request: pytest.FixtureRequest, redis_url: str, small_sphere: Path, tmp_path: Path
) -> None:
    settings = Settings(data_dir=tmp_path / "data", redis_url=redis_url, queue=f"test-{tmp_path.name}", auth="on")
    database = Database(settings.resolved_database_url)
    try:
        key = KeyRing(database).create("browser")[1]
    finally:
        database.close()
    with (
        serving(settings) as home,
        working(settings, FakeKind().start),
        watched(browser, home, request, tmp_path) as (page, watch),
    ):
        watch.allow(r"status of 401 |status of 404 .*preview.png")  # the fake kind draws none
        # What is there without one is shown first, and nothing is asked for until something is done.
        page.goto("/#/examples/giraffe")
        expect(page.get_by_label("Prompt", exact=True)).to_have_value("a giraffe")
        expect(page.locator("#estimate")).to_have_text("This server asks for a key once you change or keep something.")
        dialog = page.get_by_role("dialog", name="API key")
        expect(dialog).to_have_count(0)
        page.get_by_label("Prompt", exact=True).fill("a bowl")
        dialog.get_by_label("Key", exact=True).fill(key[:-4] + "AAAA")
        dialog.get_by_role("button", name="Use key").click()
        expect(dialog).to_contain_text("did not accept this key")
        dialog.get_by_label("Key", exact=True).fill(key)
        dialog.get_by_role("button", name="Use key").click()
        expect(dialog).to_have_count(0)
        page.get_by_role("group", name="Suggested prompts", include_hidden=True).locator("button").first.wait_for(
            state="attached"
        )
        choose(page, small_sphere)
        page.get_by_label("Prompt", exact=True).fill("a bowl")
        set_steps(page, 6)
        expect(page.locator("#estimate")).to_contain_text("6 steps")
        job_id = start(page)
        # Events are followed with the key, which `EventSource` could not send.
        expect(badge(page)).to_have_text("Succeeded")
        open_more(page)
        with page.expect_download() as download:
            page.get_by_role("button", name="Download result.glb").click()
        download.value.save_as(tmp_path / "result.glb")
        stored = httpx.get(f"{home}/v1/jobs/{job_id}/artifacts/result.glb", headers={"Authorization": f"Bearer {key}"})
        assert (tmp_path / "result.glb").read_bytes() == stored.raise_for_status().content
        # A link for somebody who has no key, to this one file and for a time.
        page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        page.get_by_role("button", name="Copy a link to result.glb").click()
        until_noted(page, "Link copied. It needs no key and works until ")
        link = page.evaluate("navigator.clipboard.readText()")
        assert key not in link
        assert httpx.get(link).raise_for_status().content == stored.content
        # A link to the whole job: in a browser that has never had a key.
        page.get_by_role("button", name="Share", exact=True).click()
        until_noted(
            page, "Link copied. It shows this job with its files, also the asset as you sent it, needs no key and"
        )
        link = page.evaluate("navigator.clipboard.readText()")
        assert link.startswith(f"{home}/#/shared/{job_id}/link.")
        assert key not in link
        with watched(browser, home, request, tmp_path) as (visitor, visits):
            visits.allow(r"status of 401 |status of 404 .*preview.png")
            visitor.goto(link)
            expect(badge(visitor)).to_have_text("Succeeded")
            expect(visitor.locator(".job-head")).to_contain_text("You see this job by a link.")
            open_more(visitor)
            for name, content in (("result.glb", stored.content), ("sphere.obj", small_sphere.read_bytes())):
                with visitor.expect_download() as download:
                    visitor.get_by_role("button", name=f"Download {name}").click()
                download.value.save_as(tmp_path / "shared")
                assert (tmp_path / "shared").read_bytes() == content
            # Nothing that would change the job, nor the way to others.
            expect(visitor.get_by_label("Format")).to_be_visible()
            expect(visitor.get_by_role("button", name=re.compile("^(Make|Copy|Delete|Share|Keep|Run)"))).to_have_count(
                0
            )
            expect(visitor.get_by_label("Prompt", exact=True)).to_have_count(0)
            expect(visitor.get_by_role("navigation")).to_have_count(0)
            assert visits.posted() == []
            visitor.goto(link[:-1] + ("0" if link[-1] != "0" else "1"))
            problem = visitor.get_by_role("alert")
            expect(problem).to_contain_text("The link does not open this job.")
            expect(problem).to_contain_text("Ask whoever sent it for a new one.")
            expect(visitor.get_by_role("dialog")).to_have_count(0)  # no key mends it
        # The key is in no address, and stays for this tab.
        assert key not in page.url
        page.reload()
        expect(badge(page)).to_have_text("Succeeded")
        page.goto("/#/jobs")
        expect(page.locator(".card")).to_have_count(1)
        page.get_by_role("button", name="Forget the API key").click()
        page.reload()
        expect(page.get_by_role("dialog", name="API key")).to_be_visible()


@pytest.mark.without_pictures
def test_the_keyboard_is_enough(page: Page, watch: Watch, service: Service, small_sphere: Path) -> None:
    watch.allow(r"status of 422 .*/v1/jobs:validate")  # of a prompt that is still being typed
    straight_way(page, watch)
    open_form(page)
    page.keyboard.press("Tab")
    expect(page.get_by_role("link", name="Skip to the content")).to_be_focused()
    page.keyboard.press("Enter")
    seen: list[str] = []
    for _ in range(60):
        page.keyboard.press("Tab")
        seen.append(page.evaluate("() => document.activeElement.id || document.activeElement.textContent.trim()"))
        ring = page.evaluate(
            """() => {
              const focused = document.activeElement, style = getComputedStyle(focused);
              return style.outlineStyle !== 'none' || style.boxShadow !== 'none' || focused.type === 'radio';
            }"""
        )
        assert ring, f"the focus on {seen[-1]!r} is not to be seen"
        if seen[-1] == "prompt":
            break
    assert seen[-1] == "prompt", seen
    assert "Choose a file" in seen
    page.keyboard.type("20 % taller")
    for _ in range(50):
        page.keyboard.press("Tab")
        focused = page.evaluate("() => document.activeElement.id || document.activeElement.textContent.trim()")
        if focused == "Keep":
            break
    assert focused == "Keep"
    expect(page.locator("#estimate")).to_contain_text("A change in plain words")
    page.keyboard.press("Enter")
    page.wait_for_url(re.compile(r"#/jobs/job_\w+$"))
    job_id = shown_job(page)
    assert service.finished(job_id)["state"] == "succeeded"
    until_judged(page)
    assert service.job(job_id)["prompt"] == "20 % taller"
    # The focus is at the new content; the strength is moved by the arrows, and before is seen while a key is held.
    expect(page.locator("#main")).to_be_focused()
    strength, stage = page.get_by_label("Strength", exact=True), page.locator(".asset-panel .stage")
    expect(strength).to_be_visible()
    page.keyboard.down("b")
    expect(stage).to_have_attribute("data-compare", "hold")
    page.keyboard.up("b")
    expect(stage).to_have_attribute("data-compare", "none")
    strength.focus()
    page.keyboard.press("ArrowLeft")
    expect(strength).to_have_value("99")
    # What is shown can be asked for again, and compared.
    expect(page.get_by_role("button", name="Keep")).to_be_visible()
    page.get_by_label("Result", exact=True).focus()
    page.keyboard.press("ArrowRight")
    expect(stage).to_have_attribute("data-compare", "wipe")
    page.get_by_label("Before and after").press("Home")
    expect(page.get_by_label("Before and after")).to_have_attribute("aria-valuetext", "0 percent before")


@pytest.mark.live("parts")
@pytest.mark.without_3d
def test_nothing_is_wider_than_a_phone(
    browser: Browser, service: Service, finished: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    with watched(browser, str(service.http.base_url).rstrip("/"), request, tmp_path, **PHONE) as (page, _):
        read_all_alike(page)
        for view in views(page, finished):
            if view == "form":
                expect(page.get_by_text("No 3D view")).to_be_visible()
                prompt = page.get_by_label("Prompt", exact=True)
                page.evaluate("() => scrollTo(0, 0)")
                below = prompt.bounding_box()
                assert below["y"] + below["height"] < page.viewport_size["height"], (
                    "the prompt is not to be seen without scrolling"
                )
            width = page.evaluate("() => document.documentElement.scrollWidth")
            assert width <= 360, (view, width, widest(page))
            small = page.evaluate(
                """() => [...document.querySelectorAll('button, select, input, summary, nav a')]
                  .filter((element) => element.checkVisibility() && !element.closest('.visually-hidden, label'))
                  .map((element) => [element.textContent.trim() || element.id || element.ariaLabel,
                                     element.getBoundingClientRect()])
                  .filter(([, box]) => box.width > 1 && (box.width < 24 || box.height < 24))
                  .map(([name, box]) => `${name}: ${box.width} x ${box.height}`)"""
            )
            # WCAG 2.2, 2.5.8: targets of at least 24 by 24 pixels.
            assert small == [], view


def widest(page: Page) -> list[str]:
    """What stands out to the right, for a failing test."""
    found: list[str] = page.evaluate(
        """() => [...document.querySelectorAll('body *')]
        .filter((e) => e.getBoundingClientRect().right > innerWidth + 1)
        .map((e) => `${e.tagName}.${e.className} ${e.getBoundingClientRect().right}`).slice(0, 8)"""
    )
    return found


@pytest.mark.live("parts")
@pytest.mark.without_pictures
def test_no_barrier_is_found(
    browser: Browser, service: Service, finished: str, axe: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    home = str(service.http.base_url).rstrip("/")
    with watched(browser, home, request, tmp_path, color_scheme="light", reduced_motion="reduce") as (page, watch):
        watch.allow(r"status of 422 .*/v1/jobs:validate")
        read_all_alike(page)
        for view in views(page, finished):
            if view == "form":
                page.get_by_label("Prompt", exact=True).fill("Albert Einstein")
                page.get_by_role("group", name="Prompts that work").wait_for()
            for scheme, rules in (("light", RULES), ("dark", OF_COLOURS)):
                page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
                assert barriers(page, axe, rules) == [], (view, scheme)
            page.emulate_media(color_scheme="light", reduced_motion="reduce")
            if view == "job":
                page.get_by_role("button", name="Delete").first.click()
                page.get_by_role("dialog").wait_for()
                assert barriers(page, axe) == [], "dialog"
                page.keyboard.press("Escape")
