"""The parts of an asset on the page: pointed at in the view, changed by words and a slider, and seen at once."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from meshdeform.assets import load_asset
from tests.acceptance.service import Service, until
from tests.browser.steps import (
    barriers,
    choose,
    difference,
    drag,
    expect,
    open_form,
    picture,
    set_steps,
    start,
    until_drawn,
    until_judged,
    until_noted,
    until_shown,
)
from tests.unit.plain.shapes import rigged_dog

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page, Route


def chip(page: Page, name: str) -> Locator:
    return page.locator(".parts").get_by_role("button", name=name, exact=True)


def marked(viewer: Locator) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """Where in a viewer something is tinted."""
    seen = picture(viewer)
    return np.argwhere(seen[..., 0] - seen[..., 2] > 60)


@pytest.mark.live
def test_a_part_is_pointed_at_changed_and_seen_at_once(page: Page, service: Service, axe: str, tmp_path: Path) -> None:
    asset = tmp_path / "dog.glb"
    asset.write_bytes(rigged_dog())
    open_form(page)
    choose(page, asset)
    viewer, prompt = page.locator(".asset-panel .viewer"), page.locator("#prompt")
    until_drawn(viewer)
    expect(chip(page, "tail")).to_be_visible()
    assert page.locator(".parts .chips").first.get_by_role("button").all_inner_texts()[:2] == ["legs", "head"]

    # What a chip marks is what a click in the view chooses.
    chip(page, "head").focus()
    until("the head is marked", lambda: len(marked(viewer)) > 40)
    y, x = np.median(marked(viewer), axis=0)
    box = viewer.bounding_box()
    assert box is not None
    viewer.click(position={"x": float(x) + box["width"] // 5, "y": float(y) + box["height"] // 5})
    expect(chip(page, "head")).to_have_attribute("aria-pressed", "true")
    before = picture(viewer)

    chip(page, "bigger").click()
    expect(prompt).to_have_value("head bigger by 30 %")
    tag = viewer.locator(".viewer-tag")
    expect(tag).to_have_text("Preview")
    until("the view shows it", lambda: difference(before, picture(viewer)) > 0.01)
    slider = page.get_by_label("Amount", exact=True)
    slider.fill("-20")
    expect(prompt).to_have_value("head smaller by 20 %")
    expect(slider).to_have_attribute("aria-valuetext", "head smaller by 20 percent")
    chip(page, "legs").press("Enter")
    chip(page, "longer").press("Space")
    expect(prompt).to_have_value("head smaller by 20 % and legs longer by 30 %")
    expect(chip(page, "longer")).to_be_focused()
    expect(chip(page, "longer")).to_have_attribute("aria-pressed", "true")
    assert barriers(page, axe) == []
    slider.fill("0")
    expect(page.locator("#estimate")).to_contain_text("A change in plain words")
    expect(prompt).to_have_value("head smaller by 20 %")

    job = start(page)
    until_judged(page)
    (change,) = json.loads(service.artifact(job, "report.json"))["changes"]
    assert (change["part"], change["asked"]) == ("head", 0.8)
    assert len(load_asset(service.artifact(job, "result.glb")).surface.positions)


FOUND: dict[str, tuple[str, float | None, list[Any]]] = {
    "legs": ("joints", None, [[768, 2495]]),
    "horns": ("shapes", 0.3, [[2796, 3095]]),
    "tail": ("shapes", 0.9, [[2496, 2795]]),
}
READING = {"noun": "cow", "probability": 0.52, "sure": False, "noun_given": False, "front_given": False}
READING |= {"nouns": [{"noun": "cow", "probability": 0.52}, {"noun": "dog", "probability": 0.3}]}
READING |= {"front_azimuth_deg": 90.0, "front_sure": True}


class Reader:
    """Reads each file as a cow with horns, while it knows any, and lays what is asked over it."""

    def __init__(self, page: Page) -> None:
        self.asked: dict[str, Any] = {}
        self.knows = True
        page.route("**/v1/jobs:parts", self._answer)

    def _answer(self, route: Route) -> None:
        body = route.request.post_data_buffer or b""
        document = json.loads(body.rsplit(b"\r\n\r\n", 1)[-1].split(b"\r\n--")[0])
        self.asked = {"guidance": {}, "control": {}, **document["params"]}
        if not self.knows:
            route.fulfill(json={"reading": None, "parts": [], "result": None, "warnings": []})
            return
        guidance, entries = self.asked["guidance"], self.asked["control"].get("parts", [])
        reading: dict[str, Any] = dict(READING)
        if "source_noun" in guidance:
            reading |= {"noun": guidance["source_noun"], "noun_given": True, "sure": True}
        if "orientation" in guidance:
            reading |= {"front_azimuth_deg": guidance["orientation"], "front_given": True}
        names = {old: entry["name"] for entry in entries for old in entry.get("parts", [])}
        given = {name: ("given", None, faces) for name, (_, _, faces) in FOUND.items() if name in names}
        parts = {names.get(name, name): part for name, part in {**FOUND, **given}.items()}
        parts |= {entry["name"]: ("given", None, entry["faces"]) for entry in entries if "faces" in entry}
        changes = [{"operation": "long", "more": "longer", "less": "shorter"}]
        listed = [
            {"name": name, "found_by": by, "confidence": confidence, "faces": faces, "changes": changes}
            for name, (by, confidence, faces) in parts.items()
        ]
        route.fulfill(json={"reading": reading, "parts": listed, "result": None, "warnings": []})


@pytest.mark.live("parts")
@pytest.mark.without_pictures
def test_what_is_read_wrong_is_corrected_and_kept(page: Page, service: Service, axe: str, tmp_path: Path) -> None:
    reader = Reader(page)
    asset = tmp_path / "beast.glb"
    asset.write_bytes(rigged_dog())
    open_form(page)
    choose(page, asset)
    until_shown(page, 3528)
    noun, front = page.get_by_label("What the asset is", exact=True), page.get_by_label("Side that is the front")
    line, list_ = page.locator(".reading"), page.get_by_role("list", name="Corrections").get_by_role("listitem")
    expect(page.locator(".reading-words")).to_have_text("Perhaps a cow, perhaps facing right. Its parts:")
    page.get_by_text("Not right?").click()
    expect(line).to_contain_text("Perhaps a")
    expect(noun.locator("option:checked")).to_have_text("cow, 52%")
    expect(front.locator("option:checked")).to_have_text("+X")
    chip(page, "perhaps horns").click()
    expect(page.get_by_role("group", name="Correct horns")).to_contain_text("Perhaps found by its shape, 30% sure.")

    # The noun and the front.
    noun.select_option("else")
    typed = page.get_by_label("Noun of the asset")
    expect(typed).to_be_focused()
    typed.fill("gnu")
    typed.press("Enter")
    expect(line).to_contain_text("No noun that is known here")
    typed.fill("elephant")
    typed.press("Enter")
    expect(noun.locator("option:checked")).to_have_text("Elephant, as you said")
    expect(noun).to_be_focused()
    with page.expect_response(
        lambda got: got.url.endswith("jobs:parts") and b'"orientation":180' in (got.request.post_data_buffer or b"")
    ):
        front.select_option("180")
    expect(front).to_have_value("180")
    assert reader.asked["guidance"]["source_noun"] == "elephant"

    # A part: its name, that it is two, its faces; each is seen, and can be taken back.
    page.get_by_role("button", name="Rename…").press("Enter")
    page.get_by_role("dialog").get_by_label("Name").fill("ears")
    page.get_by_role("dialog").get_by_label("Name").press("Enter")
    expect(chip(page, "ears")).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_role("button", name="Rename…")).to_be_focused()
    chip(page, "tail").click()
    page.get_by_role("button", name="Rename…").click()
    page.get_by_role("dialog").get_by_label("Name").fill("ears")
    page.get_by_role("dialog").get_by_role("button", name="Rename").click()
    expect(chip(page, "tail")).to_have_count(0)
    expect(list_).to_have_text(["horns and tail together are “ears”"])
    list_.get_by_role("button", name="Remove").click()
    expect(chip(page, "perhaps horns")).to_be_visible()
    expect(page.get_by_role("button", name="Another part…")).to_be_focused()

    chip(page, "legs").click()
    chip(page, "shorter").click()
    expect(chip(page, "shorter")).to_have_attribute("aria-pressed", "true")
    page.get_by_label("Prompt", exact=True).fill("a horse")  # another prompt is the user's own
    expect(chip(page, "shorter")).to_have_attribute("aria-pressed", "false")
    page.get_by_role("button", name="Paint", exact=True).click()
    expect(list_).to_have_text(["“legs”: painted, 0 triangles"])
    viewer = page.locator(".asset-panel .viewer")

    def painted() -> bool:
        drag(page, viewer, (0.45, 0.45), (0.5, 0.5))
        return "painted, 0" not in list_.inner_text()

    until("the brush paints", painted)
    said = list_.inner_text()
    assert barriers(page, axe) == []
    page.get_by_role("button", name="Paint", exact=True).click()
    expect(page.get_by_role("group", name="Control in the view")).to_be_hidden()
    page.get_by_role("button", name="Another part…").click()
    page.get_by_role("dialog").get_by_label("Name").fill("tusks!")
    page.get_by_role("button", name="Paint it").click()
    expect(page.get_by_role("dialog")).to_be_visible()  # no name
    page.keyboard.press("Escape")

    # A draft, a job and what is begun with it have all of it; another file has nothing of it.
    page.get_by_label("Prompt", exact=True).fill("a tall vase")
    set_steps(page, 2)
    page.reload()
    page.get_by_text("Not right?").click()
    expect(list_).to_have_text([said])
    expect(noun.locator("option:checked")).to_have_text("Elephant, as you said")
    expect(page.locator("#estimate")).to_contain_text("2 steps")
    job = start(page)
    params = service.job(job)["params"]
    assert (params["guidance"]["source_noun"], params["guidance"]["orientation"]) == ("elephant", 180)
    (part,) = params["control"]["parts"]
    assert part["name"] == "legs"
    assert part["faces"] == reader.asked["control"]["parts"][0]["faces"]
    service.http.post(f"/v1/jobs/{job}/cancel")
    service.finished(job)
    page.get_by_text("Not right?").click()
    expect(list_).to_have_text([said])
    page.get_by_role("link", name="Create", exact=True).click()
    page.get_by_text("Not right?").click()
    expect(list_).to_have_text([said])
    reader.knows = False
    page.get_by_role("button", name="Sphere", exact=True).click()
    until_noted(page, "belonged to the other file")
    expect(page.locator(".parts")).to_contain_text("No parts are known for this file.")
    expect(page.locator(".parts .chips").first.get_by_role("button")).to_have_count(0)
    assert reader.asked["guidance"].keys().isdisjoint({"source_noun", "orientation"})
