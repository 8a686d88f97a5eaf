"""Clips of a rigged asset are played beside each other, and the form asks what becomes of the rig."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from meshdeform.requests.document import OutputParams
from tests.acceptance.service import Service, until
from tests.browser.steps import (
    barriers,
    choose,
    difference,
    expect,
    open_form,
    open_more,
    picture,
    start,
    until_drawn,
    until_judged,
)
from tests.browser.viewer.assets import rigged

if TYPE_CHECKING:
    from playwright.sync_api import Page


@pytest.fixture(scope="module")
def waving(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A box on two joints."""
    path = tmp_path_factory.mktemp("rigged") / "waving.glb"
    path.write_bytes(rigged()[0])
    return path


def test_clips_are_chosen_scrubbed_and_played_in_step(page: Page, service: Service, waving: Path, axe: str) -> None:
    job = service.submit(waving, {"prompt": "20 % taller", "params": {"preset": "preview"}})
    assert service.finished(job)["state"] == "succeeded"
    # With the source as its result, both views are alike at the same moment, and at no other.
    page.route("**/artifacts/result.glb", lambda route: route.fulfill(body=waving.read_bytes()))
    page.goto(f"/#/jobs/{job}")
    player = page.get_by_role("group", name="Animation")
    clip, time = player.get_by_label("Clip", exact=True), player.get_by_label("Time", exact=True)
    after, before = page.locator(".viewer").nth(0), page.locator(".before .viewer")
    expect(after.locator(".viewer-tag")).to_have_text("Result")
    page.get_by_text("Side by side").click()
    until_drawn(before)
    rest = until_drawn(after)

    def moves_in_step() -> bool:
        """Whether both views show one and the same moment, which is not the rest."""
        seen = picture(after)
        return difference(rest, seen) > 0.05 and difference(picture(before), seen) < 0.01

    expect(time).to_be_disabled()
    clip.select_option("Wave")
    # Where motion is reduced, nothing moves by itself.
    expect(player.get_by_role("button", name="Play")).to_be_visible()
    expect(time).to_have_attribute("aria-valuetext", "0.0 of 1.0 seconds")
    time.fill("0.5")
    expect(time).to_have_attribute("aria-valuetext", "0.5 of 1.0 seconds")
    until("both wave", moves_in_step)
    waved = picture(after)
    assert barriers(page, axe) == []

    page.emulate_media(reduced_motion="no-preference")
    clip.select_option("Step aside")
    pause = player.get_by_role("button", name="Pause")
    seen = time.input_value()
    until("it plays", lambda: time.input_value() != seen)
    pause.press("Space")  # a click waits for pictures, which software draws slowly
    expect(player.get_by_role("button", name="Play")).to_be_visible()
    time.fill("0.5")
    until("both step aside", lambda: moves_in_step() and difference(waved, picture(after)) > 0.05)
    clip.select_option("At rest")
    until("both are at rest", lambda: difference(rest, picture(after)) < 0.01)


@pytest.mark.without_pictures
def test_a_rig_follows_or_stays_as_it_was_chosen(page: Page, service: Service, waving: Path) -> None:
    usual = OutputParams().rig.value
    open_form(page)
    open_more(page)
    rig = page.get_by_label("Rig", exact=True)
    expect(rig).to_be_hidden()
    choose(page, waving)
    expect(rig).to_have_value(usual)
    page.get_by_label("Prompt", exact=True).fill("20 % taller")
    with page.expect_request("**/v1/jobs") as asked:
        assert service.job(start(page))["output"]["rig"] == usual
    assert '"rig"' not in (asked.value.post_data or "")

    expect(page.locator("#asset-facts")).to_contain_text("waving.glb")
    until_judged(page)
    open_more(page)
    (other,) = {"follow", "keep"} - {usual}
    rig.select_option(other)
    assert service.job(start(page))["output"]["rig"] == other
    until_judged(page)
    open_more(page)
    expect(rig).to_have_value(other)
