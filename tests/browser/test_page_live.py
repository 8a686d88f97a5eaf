"""The asset becomes what is typed: the shape in the view, other designs of it below, and how far it goes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

from meshdeform.assets import build_glb, load_asset
from meshdeform.geometry.shapes import icosphere
from meshdeform.requests.previews import PreviewShape, PreviewShapes, pack
from meshdeform.runs.preview_work import positions_of
from tests.acceptance.service import Service, until
from tests.browser.steps import (
    barriers,
    choose,
    choose_way,
    difference,
    expect,
    open_form,
    open_more,
    picture,
    until_drawn,
    until_shown,
)

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page, Route

    from tests.browser.conftest import Watch

pytestmark = pytest.mark.live("preview")


class Previews:
    """Answers previews of an asset in place of the server: taller with each seed, in the way of the last prompt."""

    def __init__(self, page: Page, asset: Path) -> None:
        self._asset = load_asset(asset.read_bytes(), asset.name)
        self.asked: list[tuple[str, str, list[int]]] = []
        self.status = 200
        self.drafts = False
        """Whether exact shapes are held back, and drafts come before them."""
        self.slow = False
        """And drafts as well."""
        self.held: list[Callable[[], None]] = []
        page.route("**/v1/jobs:preview*", self._answer)

    def _answer(self, route: Route) -> None:
        query = parse_qs(urlsplit(route.request.url).query)
        form, draft = query["as"][0], self.drafts and query.get("draft") == ["true"]
        sent = (route.request.post_data_buffer or b"").decode("latin-1")
        found = re.search(r'\{"prompt".*"seeds":\[\d+\].*\}', sent)
        assert found, sent[:500]
        document = json.loads(found[0])
        self.asked.append((document["prompt"], form, document["seeds"]))
        if self.status != 200:
            problem = {"status": self.status, "code": "prompt_unknown_words", "detail": "no", "title": "no"}
            if self.status == 501:
                problem["code"] = "dependency_missing"
            route.fulfill(status=self.status, content_type="application/problem+json", body=json.dumps(problem))
            return
        glb = self.result(document["seeds"][0])
        shape = PreviewShape(
            document["seeds"][0], positions_of(glb), {"form": "mushroom", "pose": ""}, ["It leans.", "See `x`."]
        )
        body = glb if form == "glb" else pack(PreviewShapes("0" * 64, False, None, [shape]))
        headers = {"Meshdeform-Asset": "0" * 64, "Meshdeform-Draft": str(draft).lower()}
        answer = partial(route.fulfill, body=body, content_type="application/octet-stream", headers=headers)
        if self.drafts and form == "glb" and (self.slow or not draft):
            self.held.append(answer)
        else:
            answer()

    def result(self, seed: int) -> bytes:
        """What the asset becomes with a seed."""
        return self._asset.replace(self._asset.surface.positions * np.array([1.0, 1.5 + 0.5 * (seed % 10), 0.6]))

    @property
    def forms(self) -> list[str]:
        return [form for _, form, _ in self.asked]


@pytest.fixture
def asset(tmp_path: Path) -> Path:
    """An asset that is not the example with which the form begins."""
    ball, path = icosphere(3), tmp_path / "ball.glb"
    path.write_bytes(build_glb(ball.verts, ball.faces))
    return path


@pytest.fixture
def shown(page: Page, service: Service, asset: Path) -> Previews:
    """The form with the asset, a prompt, and a shape in the view."""
    del service
    previews = Previews(page, asset)
    open_form(page)
    choose(page, asset)
    open_more(page)
    page.locator("#seed").fill("10")
    page.locator("#prompt").fill("a mushroom")
    expect(tag(page)).to_have_text("Preview")
    expect(members(page)).to_have_count(6)
    expect(page.locator(".live-member:nth-child(6) img[src]")).to_be_attached()
    return previews


def until_asked(page: Page, what: str, look: Callable[[], bool]) -> None:
    """Wait for a request; while nothing of the page is looked at, none is answered."""
    until(what, lambda: page.evaluate("true") and look())


def viewer(page: Page) -> Locator:
    return page.locator(".asset-panel .viewer").first


def tag(page: Page) -> Locator:
    return viewer(page).locator(".viewer-tag")


def members(page: Page) -> Locator:
    return page.get_by_role("group", name="Designs").get_by_role("button")


def test_what_is_typed_is_seen_and_a_click_takes_another_design(page: Page, shown: Previews, axe: str) -> None:
    assert shown.asked[0] == ("a mushroom", "glb", [10])
    assert [seeds for _, form, seeds in shown.asked if form == "positions"] == [[10 + k] for k in range(6)]
    assert [each.get_attribute("aria-pressed") for each in members(page).all()] == ["true", *5 * ["false"]]
    assert members(page).nth(2).get_attribute("aria-label") == "Design 3: mushroom"
    expect(page.locator(".outlook:visible")).to_have_text("It leans.")
    assert barriers(page, axe) == []
    asked, before = len(shown.asked), until_drawn(viewer(page))
    page.get_by_label("Strength", exact=True).fill("0")
    expect(tag(page)).to_have_text("Preview · 0%")
    until("it goes back", lambda: difference(before, picture(viewer(page))) > 0.01)
    page.get_by_label("Strength", exact=True).fill("100")
    expect(tag(page)).to_have_text("Preview")
    until("and is there again", lambda: difference(before, picture(viewer(page))) < 0.01)
    assert len(shown.asked) == asked, "strength moves the mesh without a request"
    members(page).nth(3).press("Enter")
    expect(page.locator("#seed")).to_have_value("13")
    expect(members(page).nth(3)).to_have_attribute("aria-pressed", "true")
    expect(members(page).nth(3)).to_be_focused()
    until("the view shows it", lambda: difference(before, picture(viewer(page))) > 0.01)
    until_asked(page, "its file is asked for", lambda: ("a mushroom", "glb", [13]) in shown.asked)
    # The designs stay: only the file of the one that was taken is new.
    assert shown.forms.count("positions") == 6
    expect(page.locator(".outlook:visible")).to_have_text("It leans.")
    # One that is gone back to stays in its place.
    shapes = page.get_by_role("group", name="Shapes so far").get_by_role("button")
    expect(shapes).to_have_count(2)
    shapes.first.click()
    expect(page.locator("#seed")).to_have_value("10")
    expect(shapes.first).to_have_attribute("aria-pressed", "true")


@pytest.mark.without_pictures
def test_the_asset_is_back_where_a_prompt_is_refused_gone_or_of_another_file(
    page: Page, shown: Previews, asset: Path, watch: Watch
) -> None:
    watch.allow(r"status of 422 .*/v1/jobs:validate")

    def is_back() -> None:
        expect(tag(page)).to_be_hidden()
        expect(page.locator(".live")).to_be_hidden()
        expect(page.get_by_text("It leans.")).to_be_hidden()

    page.locator("#prompt").fill("")
    is_back()
    page.locator("#prompt").fill("a vase")
    expect(tag(page)).to_have_text("Preview")
    shown.status = 422
    page.locator("#prompt").fill("a xyzzy")
    is_back()
    shown.status = 200
    page.locator("#prompt").fill("a vase")
    expect(tag(page)).to_have_text("Preview")
    choose_way(page, "pictures")
    is_back()
    other = asset.with_name("other.glb")
    ball = icosphere(3)
    other.write_bytes(build_glb(1.5 * ball.verts, ball.faces))
    choose_way(page, "shape")
    expect(tag(page)).to_have_text("Preview")
    asked = len(shown.asked)
    choose(page, other)
    until_asked(page, "it is made of the other file", lambda: len(shown.asked) > asked)


@pytest.mark.without_pictures
def test_a_server_that_makes_no_previews_is_asked_once(page: Page, service: Service, asset: Path, watch: Watch) -> None:
    del service
    watch.allow(r"status of 501 .*/v1/jobs:preview")
    previews = Previews(page, asset)
    previews.status = 501
    open_form(page)
    choose(page, asset)
    until_shown(page, 1280)
    page.locator("#prompt").fill("a mushroom")
    until_asked(page, "it was asked", lambda: previews.asked != [])
    expect(page.locator(".live")).to_be_hidden()
    expect(page.get_by_role("button", name="Run", exact=True)).to_be_visible()  # there is nothing to keep
    page.locator("#prompt").fill("a vase")
    expect(page.locator("#estimate")).to_contain_text("A fit")
    assert len(previews.asked) == 1


@pytest.mark.without_pictures
def test_a_draft_gives_way_to_the_exact_shape(page: Page, service: Service, asset: Path) -> None:
    del service
    previews = drafted(page, asset)
    expect(members(page)).to_have_count(0)
    previews.held[0]()
    expect(tag(page)).to_have_text("Preview")
    expect(members(page)).to_have_count(6)
    assert previews.forms == ["glb", "glb", *6 * ["positions"]]


@pytest.mark.without_pictures
def test_the_exact_shape_of_a_large_asset_comes_after_the_designs(page: Page, service: Service, asset: Path) -> None:
    del service
    ball = icosphere(5)
    asset.write_bytes(build_glb(ball.verts, ball.faces))
    previews = drafted(page, asset)
    expect(members(page)).to_have_count(6)
    previews.held[0]()
    expect(tag(page)).to_have_text("Preview")
    assert previews.forms == ["glb", *6 * ["positions"], "glb"]


def drafted(page: Page, asset: Path) -> Previews:
    """The form with a draft in the view, of which the exact shape is asked for."""
    previews = Previews(page, asset)
    previews.drafts = True
    open_form(page)
    choose(page, asset)
    page.locator("#prompt").fill("a mushroom")
    expect(tag(page)).to_have_text("Draft")
    until_asked(page, "the exact shape is asked for", lambda: previews.held != [])
    expect(page.get_by_text("A draft; the exact shape follows.")).to_be_visible()
    return previews


@pytest.mark.without_pictures
def test_a_draft_under_way_is_shown_before_it_gives_way_to_what_is_typed_next(
    page: Page, service: Service, asset: Path
) -> None:
    del service
    previews = Previews(page, asset)
    previews.drafts = previews.slow = True
    open_form(page)
    choose(page, asset)
    page.locator("#prompt").fill("a mushroom")
    until_asked(page, "the draft is asked for", lambda: previews.held != [])
    for prompt in ("a mushroom house", "a vase"):
        page.locator("#prompt").fill(prompt)
    previews.held.pop(0)()
    expect(tag(page)).to_have_text("Draft")
    until_asked(page, "the last prompt is asked for", lambda: previews.held != [])
    assert [prompt for prompt, *_ in previews.asked] == ["a mushroom", "a vase"]
