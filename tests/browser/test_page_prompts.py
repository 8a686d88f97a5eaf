"""Several prompts on the page: added, repaired, weighted, and given regions by the tools of *Control*."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.acceptance.service import Service, until
from tests.browser.conftest import Watch
from tests.browser.steps import choose, drag, expect, open_form, set_steps, start, until_shown

if TYPE_CHECKING:
    from playwright.sync_api import Page


def plain(prompts: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Prompts as the API returns them, without members of their regions that are null."""
    return [
        {**each, "regions": [{k: v for k, v in region.items() if v is not None} for region in each.get("regions", [])]}
        for each in prompts
    ]


@pytest.mark.without_pictures
def test_two_prompts_of_which_one_has_regions(page: Page, watch: Watch, service: Service, small_sphere: Path) -> None:
    watch.allow(r"status of 422 .*/v1/jobs:validate")
    open_form(page)
    choose(page, small_sphere)
    viewer = page.locator(".asset-panel .viewer")
    until_shown(page, 320)
    page.get_by_label("Prompt", exact=True).fill("a pear")
    set_steps(page, 2)
    page.get_by_role("button", name="Add a prompt").click()
    second = page.get_by_role("textbox", name="Prompt 2", exact=True)
    expect(second).to_be_focused()
    second.fill("a mushrom")
    rows = page.get_by_role("list", name="Further prompts")
    # The prompt that is not understood is repaired in its own place.
    rows.get_by_role("button", name="Use “a mushroom”").click()
    expect(second).to_have_value("a mushroom")
    expect(page.locator("#estimate")).to_contain_text("2 steps")
    page.get_by_label("Weight of prompt 2").fill("3")
    page.get_by_label("Where prompt 2 pulls").select_option("in")
    expect(page.get_by_text("Prompt 2 has no region yet")).to_be_visible()
    page.get_by_role("button", name="Deform").click()
    assert watch.posted() == []

    tools = page.get_by_role("group", name="Regions of prompt 2")
    tools.get_by_role("button", name="Paint a region").click()
    regions = page.get_by_role("list", name="Regions of prompt 2, listed").get_by_role("listitem")

    def painted() -> bool:
        drag(page, viewer, (0.5, 0.4), (0.52, 0.42))
        return regions.count() > 0

    until("the tools are loaded", painted)
    expect(regions.first).to_contain_text("Painted")
    tools.get_by_role("button", name="Add a box").click()
    expect(regions).to_have_count(2)
    # What a prompt pulls at is not kept.
    expect(page.get_by_role("list", name="Regions and handles")).to_have_count(0)
    regions.nth(1).get_by_label("From y").fill("0.25")
    page.reload()  # a draft has all of it
    expect(regions).to_have_count(2)
    expect(page.get_by_label("Weight of prompt 2")).to_have_value("3")
    expect(page.locator("#estimate")).to_contain_text("2 steps")
    job = start(page)
    document = service.job(job)
    assert document["prompt"] == "a pear"
    [further] = plain(document["params"]["guidance"]["prompts"])
    assert (further["prompt"], further["weight"]) == ("a mushroom", 3)
    faces, upper = further["regions"]
    assert set(faces) == {"faces"}
    assert faces["faces"]
    assert upper["box"]["min"][1] == 0.25
    assert "control" not in document["params"]
    assert service.finished(job)["state"] == "succeeded"
    control = page.get_by_role("region", name="Control")
    expect(control).to_contain_text("Prompt: a mushroom, weight 3 (Painted, ")

    page.get_by_role("button", name="Edit and run again").click()
    expect(second).to_have_value("a mushroom")
    expect(regions).to_have_count(2)
    page.get_by_role("button", name="Remove prompt 2").click()
    expect(second).to_have_count(0)
    page.keyboard.press("Control+z")
    expect(second).to_have_value("a mushroom")
    expect(regions).to_have_count(2)
    # Without a prompt of its own, a request has the further ones alone.
    page.get_by_label("Prompt", exact=True).fill("")
    page.get_by_label("Where prompt 2 pulls").select_option("all")
    expect(regions).to_have_count(0)
    expect(page.locator("#estimate")).to_contain_text("2 steps")
    alone = start(page)
    service.http.post(f"/v1/jobs/{alone}/cancel")
    document = service.job(alone)
    assert document["prompt"] == ""
    assert [(each["prompt"], each["regions"]) for each in plain(document["params"]["guidance"]["prompts"])] == [
        ("a mushroom", [])
    ]
