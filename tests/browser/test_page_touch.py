"""The page's tools under fingers: one paints and drags, two turn and zoom; what the first of two did is taken back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.acceptance.service import Service, until
from tests.browser.conftest import watched
from tests.browser.steps import choose, difference, expect, open_form, picture, until_drawn
from tests.browser.test_page_control import tool, two_parts

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page


Place = tuple[float, float]


@pytest.fixture
def tablet(browser: Browser, service: Service, request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Page]:
    """A page on a screen that is touched."""
    options = {"viewport": {"width": 1024, "height": 768}, "has_touch": True}
    with watched(browser, str(service.http.base_url).rstrip("/"), request, tmp_path, **options) as (page, _):
        yield page


class Fingers:
    """Touch a viewer as the browser has it from a screen; places are shares of the viewer's width and height."""

    def __init__(self, page: Page, viewer: Locator) -> None:
        self._session = page.context.new_cdp_session(page)
        self._viewer = viewer

    def _send(self, kind: str, places: list[Place]) -> None:
        box = self._viewer.bounding_box()
        assert box is not None
        points = [
            {"x": box["x"] + x * box["width"], "y": box["y"] + y * box["height"], "id": number}
            for number, (x, y) in enumerate(places)
        ]
        self._session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def drag(self, *ways: tuple[Place, Place]) -> None:
        """Put down one finger after the other, move all of them from the first to the second place, and lift them."""
        for count in range(1, len(ways) + 1):
            self._send("touchStart", [begin for begin, _ in ways[:count]])
        for share in (0.25, 0.5, 0.75, 1.0):
            self._send("touchMove", [_between(begin, end, share) for begin, end in ways])
        self._send("touchEnd", [])


def _between(begin: Place, end: Place, share: float) -> Place:
    return begin[0] + share * (end[0] - begin[0]), begin[1] + share * (end[1] - begin[1])


@pytest.mark.long  # tests/browser/viewer/test_touch.py proves it of the tools; this, that the form hears of it
def test_a_finger_paints_and_drags_and_what_the_first_of_two_did_is_taken_back(tablet: Page, tmp_path: Path) -> None:
    page = tablet
    open_form(page)
    choose(page, two_parts(tmp_path / "balls.glb"))
    viewer = page.locator(".asset-panel .viewer")
    until_drawn(viewer)
    page.get_by_text("Control", exact=True).tap()
    tool(page, "Paint")
    viewer.scroll_into_view_if_needed()
    rows = page.get_by_role("list", name="Regions and handles").get_by_role("listitem")
    expect(page.get_by_text("Two fingers turn and zoom the view")).to_be_visible()
    fingers = Fingers(page, viewer)
    scrolled = page.evaluate("scrollY")

    def painted() -> bool:
        fingers.drag(((0.66, 0.42), (0.7, 0.46)))
        return rows.count() > 0

    until("the tools are loaded", painted)
    expect(rows).to_have_count(1)
    expect(rows.first).to_contain_text("Painted")
    assert page.evaluate("scrollY") == scrolled, "a finger that paints does not scroll the page"

    page.get_by_role("button", name="Reset view").first.tap()  # the view turned while the tools were loaded

    # Two fingers on the asset, apart: the view comes closer, and what the first one painted is taken back.
    said, far = rows.first.inner_text(), picture(viewer)
    fingers.drag(((0.62, 0.5), (0.57, 0.5)), ((0.68, 0.5), (0.73, 0.5)))
    until("the view comes closer", lambda: difference(far, picture(viewer)) > 0.3)
    assert rows.first.inner_text() == said
    page.get_by_role("button", name="Reset view").first.tap()

    tool(page, "Handle")
    fingers.drag(((0.36, 0.45), (0.3, 0.3)))
    expect(rows.nth(1)).to_contain_text("Handle 1")
    expect(page.get_by_label("Goes to y")).not_to_have_value(page.get_by_label("Point y").input_value())
    fingers.drag(((0.62, 0.5), (0.57, 0.5)), ((0.68, 0.5), (0.73, 0.5)))
    until("the view comes closer", lambda: difference(far, picture(viewer)) > 0.3)
    expect(rows).to_have_count(2)
