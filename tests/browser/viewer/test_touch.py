"""The tools under fingers, as the browser has them from a screen: one paints, two turn and zoom."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Page

Place = tuple[float, float]

# What the brush says is logged.
_TOOLS = """async () => {
  window.v = await show("source.glb");
  window.log = [];
  const said = (name) => (...given) => void log.push([name, ...given]);
  window.tools = new ControlTools(v, {
    begun: said("begun"), done: said("done"), dropped: said("dropped"), touched: said("touched"),
    painted: (faces) => log.push(["painted", faces.length]),
  });
  tools.setSurface(numberedSurface(v.root));
  window.screenOf = (place) => {
    const { left, top, width, height } = tools.canvas.getBoundingClientRect();
    v.rig.camera.updateMatrixWorld();
    const seen = v.rig.camera.position.clone().fromArray(place).project(v.rig.camera);
    return [left + ((seen.x + 1) / 2) * width, top + ((1 - seen.y) / 2) * height];
  };
  window.take = (tool) => { v.resetView(); log.length = 0; tools.use(tool); };
}"""


class Fingers:
    """Fingers on the screen; places are in pixels of the page."""

    def __init__(self, page: Page) -> None:
        self._session = page.context.new_cdp_session(page)
        self._session.send("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 5})

    def _send(self, kind: str, *places: Place) -> None:
        points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(places)]
        self._session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def drag(self, *ways: tuple[Place, Place], end: str = "touchEnd") -> None:
        """Put down one finger after the other, move all from their first places to the second ones, and lift them."""
        for count in range(1, len(ways) + 1):
            self._send("touchStart", *(begin for begin, _ in ways[:count]))
        for share in (0.25, 0.5, 0.75, 1.0):
            self._send("touchMove", *(_between(*way, share) for way in ways))
        self._send(end)

    def close(self) -> None:
        self._session.send("Emulation.setTouchEmulationEnabled", {"enabled": False})
        self._session.detach()


def _between(begin: Place, end: Place, share: float) -> Place:
    return begin[0] + share * (end[0] - begin[0]), begin[1] + share * (end[1] - begin[1])


@pytest.fixture
def fingers(page: Page) -> Iterator[Fingers]:
    page.evaluate(_TOOLS)
    # A page that is scrolled: places in the window are not those on the page.
    page.evaluate("document.body.style.padding = '200px 0 3000px', scrollTo(0, 180)")
    found = Fingers(page)
    yield found
    page.evaluate("tools.dispose(), document.body.style.padding = '', scrollTo(0, 0)")
    found.close()


def take(page: Page, tool: str) -> tuple[Place, float]:
    """Take a tool in hand, with the view as at first; return where its middle is, and a fiftieth of its height."""
    page.evaluate("(tool) => take(tool)", tool)
    low, high = page.evaluate("[v.ownBox.min.toArray(), v.ownBox.max.toArray()]")
    middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    top = page.evaluate("(place) => screenOf(place)", [middle[0], high[1], middle[2]])
    x, y = page.evaluate("(place) => screenOf(place)", middle)
    return (x, y), math.dist((x, y), top) / 25


def camera(page: Page) -> tuple[float, float, list[float]]:
    """The camera's azimuth and distance about its target, and the target."""
    page.evaluate("drawn()")
    state = page.evaluate("v.rig.state")
    x, y, z = (a - b for a, b in zip(state["position"], state["target"], strict=True))
    return math.atan2(x, z), math.hypot(x, y, z), state["target"]


def said(page: Page) -> list[Any]:
    return [entry[0] for entry in page.evaluate("log")]


def test_one_finger_paints_and_beside_the_asset_it_turns_the_view(page: Page, fingers: Fingers) -> None:
    (x, y), unit = take(page, "paint")
    home = camera(page)
    fingers.drag(((x, y), (x + 10 * unit, y)))
    assert said(page)[0] == "begun"
    assert said(page)[-1] == "done"
    assert said(page).count("painted") > 2
    assert camera(page) == home
    assert page.evaluate("scrollY") == 180
    assert page.evaluate("tools.canvas.style.touchAction") == "none", "the page would scroll instead"
    left = page.evaluate("tools.canvas.getBoundingClientRect().left")
    page.evaluate("log.length = 0")
    fingers.drag(((left + 5, y), (left + 45, y)))
    assert camera(page)[0] != pytest.approx(home[0], abs=0.05)
    assert "painted" not in said(page)


def test_two_fingers_turn_and_zoom_and_what_the_first_one_did_is_taken_back(page: Page, fingers: Fingers) -> None:
    (x, y), unit = take(page, "paint")
    azimuth, distance, _ = camera(page)
    fingers.drag(((x - 5 * unit, y), (x - 15 * unit, y)), ((x + 5 * unit, y), (x + 15 * unit, y)))
    nearer = camera(page)
    assert nearer[1] < 0.8 * distance
    assert nearer[0] == pytest.approx(azimuth, abs=0.02)
    assert said(page)[-1] == "dropped"
    assert "done" not in said(page)

    (x, y), unit = take(page, "paint")
    fingers.drag(((x - 5 * unit, y), (x + 25 * unit, y)), ((x + 5 * unit, y), (x + 35 * unit, y)))
    turned = camera(page)
    assert turned[1] == pytest.approx(distance, rel=0.05)
    assert abs(turned[0] - azimuth) > 0.2
    # Without a tool they move and zoom, as ever.
    (x, y), unit = take(page, "turn")
    target = camera(page)[2]
    fingers.drag(((x - 5 * unit, y), (x + 15 * unit, y)), ((x + 5 * unit, y), (x + 25 * unit, y)))
    moved = camera(page)
    assert moved[0] == pytest.approx(azimuth, abs=0.02)
    assert math.dist(moved[2], target) > 0.02
    assert said(page) == []


def test_a_tap_touches_a_triangle_and_a_finger_that_slides_none(page: Page, fingers: Fingers) -> None:
    (x, y), _ = take(page, "turn")
    fingers.drag(((x, y), (x + 2, y)))
    assert said(page) == ["touched"]
    fingers.drag(((x, y), (x + 40, y)))
    assert said(page) == ["touched"]
