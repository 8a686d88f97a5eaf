"""The page as static files: examples, a job as it ran, and a result in a page of somebody else."""

from __future__ import annotations

import functools
import re
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qs, urljoin

import pytest

from docs.generation import demo
from tests.acceptance.service import Service, until
from tests.browser.conftest import watched
from tests.browser.steps import badge, difference, expect, picture, until_drawn, until_judged
from tests.browser.test_ndf_loader import small_field
from tests.browser.viewer.assets import rigged

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 the name of the base class
        """Say nothing: requests are not what the tests are about."""


@pytest.fixture(scope="module")
def host(service: Service, small_sphere: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A web host that knows nothing but files, and the address of the demo on it."""
    folder = tmp_path_factory.mktemp("site")
    job = service.submit(small_sphere, {"prompt": "20 % taller"})
    assert service.finished(job)["state"] == "succeeded"
    with pytest.MonkeyPatch.context() as few:
        few.setattr(demo, "_MEMBERS", 2)
        few.setattr(demo, "_PARTS", 1)
        shown = [example for example in demo._EXAMPLES if example["id"] in ("lamp", "walker")]
        demo.build(folder / "demo", service.http, job, shown)
    for name, data in zip(("rigged.glb", "taller.glb"), rigged(), strict=True):
        (folder / "demo" / name).write_bytes(data)
    page = folder / "demo" / "index.html"
    page.write_text(page.read_text().replace('data-demo="12000"', 'data-demo="4000"'))
    handler = functools.partial(_Quiet, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}/demo/"
        server.shutdown()
        thread.join()


@pytest.fixture
def visitor(browser: Browser, host: str, request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Page]:
    """A page on that host, which asks nothing of any other."""
    with watched(browser, host, request, tmp_path) as (page, watch):
        watch.allow("404.*none.glb")
        yield page


@pytest.mark.without_pictures
def test_examples_and_a_job_are_seen_without_a_server(visitor: Page) -> None:
    visitor.goto("./#/jobs")  # there are none here
    visitor.get_by_role("link", name="a lamp").click()
    expect(visitor.get_by_role("heading", level=1, name="“a lamp”")).to_be_visible()
    expect(visitor.get_by_label("Strength", exact=True)).to_be_visible()
    expect(visitor.get_by_role("button", name="Keep")).to_have_count(0)

    for _ in range(2):  # whoever comes back sees it again
        visitor.get_by_role("link", name="How it is made", exact=True).click()
        expect(badge(visitor)).to_have_text(re.compile("Queued|Running"))
        until_judged(visitor)
        expect(visitor.get_by_role("group", name="Shapes so far").get_by_role("button")).to_have_count(1)
        expect(visitor.locator(".verdict")).to_be_visible()
        visitor.get_by_role("link", name="Examples", exact=True).click()
        expect(visitor.get_by_role("heading", level=1, name="Examples")).to_be_visible()

    # A field of one's own needs no server either.
    visitor.get_by_role("link", name="A field", exact=True).click()
    expect(visitor.get_by_role("heading", name="A sample: a bumpy torus")).to_be_visible()
    visitor.set_input_files("#field-file", {"name": "ball.ndf", "mimeType": "", "buffer": small_field()})
    expect(visitor.locator(".field-stage .viewer-tag")).to_have_text("Level 5 · 20,480 triangles")
    expect(visitor.get_by_role("button", name="Deform this mesh")).to_have_count(0)


def test_designs_parts_and_clips_of_examples_need_no_server(visitor: Page) -> None:
    visitor.goto("./#/examples/lamp")
    designs = visitor.get_by_role("group", name="Designs").get_by_role("button")
    expect(designs).to_have_count(2)
    expect(designs.nth(1).locator("img[src^='blob:']")).to_be_visible()
    after, strength = visitor.locator(".asset-panel .viewer").first, visitor.get_by_label("Strength", exact=True)
    first = until_drawn(after)
    designs.nth(1).click()
    until("another lamp is to be seen", lambda: difference(first, picture(after)) > 0.01)
    expect(designs.nth(1)).to_have_attribute("aria-pressed", "true")
    designs.nth(0).click()
    until("the first one is back", lambda: difference(first, picture(after)) < 0.01)

    visitor.goto("./#/examples/walker")
    expect(visitor.get_by_role("heading", level=1, name="“longer legs”")).to_be_visible()
    part = visitor.get_by_role("group", name="Parts").get_by_role("button").nth(1)
    result = until_drawn(after)
    part.click()
    tag = after.locator(".viewer-tag")
    expect(tag).to_have_text(re.compile(r"^\w+ .+ by 50%$"))
    changed = picture(after)
    assert difference(result, changed) > 0.01, "it is changed, and lit"
    visitor.get_by_label("Clip", exact=True).select_option("Walk")
    visitor.get_by_label("Time", exact=True).fill("0.3")
    until("it has taken a step", lambda: difference(changed, picture(after)) > 0.01)
    visitor.get_by_label("Clip", exact=True).select_option("At rest")
    strength.fill("0")
    expect(strength).to_have_attribute("aria-valuetext", "0 percent")
    visitor.get_by_role("group", name="Parts").get_by_role("button", name="Result").click()
    expect(tag).to_have_text("Result")


def again(visitor: Page, **attributes: str) -> None:
    """Put the element anew, with other files."""
    opened = visitor.locator("meshdeform-result")
    opened.evaluate("(node, files) => Object.entries(files).forEach((file) => node.setAttribute(...file))", attributes)
    opened.evaluate("(node) => node.replaceWith(node.cloneNode())")


def test_a_result_stands_in_another_page(visitor: Page) -> None:
    visitor.goto("embed.html")
    view, slider = visitor.locator("meshdeform-result .view"), visitor.get_by_role("slider").first
    lamp = until_drawn(view)
    slider.fill("0")
    until("the vase is to be seen", lambda: difference(lamp, picture(view)) > 0.05)
    clip = visitor.get_by_label("Clip", exact=True)
    expect(clip).to_be_hidden()
    again(visitor, source="rigged.glb", result="taller.glb")
    clip.select_option("Wave")
    box = until_drawn(view)
    visitor.get_by_label("Time", exact=True).fill("0.5")
    until("the box waves", lambda: difference(box, picture(view)) > 0.02)
    again(visitor, animation="Step aside", theme="dark")
    expect(clip).to_have_value("Step aside")  # it stands still where motion is unwanted
    expect(visitor.get_by_role("button", name="Play")).to_be_visible()
    opened = visitor.locator("meshdeform-result")
    dark = until_drawn(view)
    opened.evaluate("(node) => node.setAttribute('theme', 'light')")
    until("it is light", lambda: picture(view).mean() > dark.mean() + 60)
    size = visitor.viewport_size
    assert size is not None
    for font, width in (("20px serif", "auto"), ("12px monospace", "300px")):
        opened.evaluate("(node, [font, width]) => Object.assign(node.style, { font, width })", [font, width])
        assert clip.evaluate("(node) => getComputedStyle(node).fontSize") == font.split()[0], "as the text around it"
        box, bar = opened.bounding_box(), slider.bounding_box()
        assert box is not None
        assert bar is not None
        assert bar["y"] + bar["height"] <= box["y"] + box["height"] + 1, "all of it is inside its box"
        assert box["height"] <= size["height"]
    room = visitor.get_by_role("link", name="View in your room")
    expect(room).to_have_count(0)  # no device for it
    visitor.evaluate("Object.defineProperty(navigator, 'userAgent', { value: 'Linux; Android 16' })")
    again(visitor, usdz="taller.usdz", label="A box & its wave")
    scheme, _, address = str(room.get_attribute("href")).partition("?")
    assert scheme == "intent://arvr.google.com/scene-viewer/1.0"
    asked = parse_qs(address.partition("#")[0])
    assert asked == {
        "file": [urljoin(visitor.url, "taller.glb")],
        "mode": ["ar_preferred"],
        "title": ["A box & its wave"],
    }
    visitor.evaluate("DOMTokenList.prototype.supports = (token) => token === 'ar'")
    opened.evaluate("(node) => node.setAttribute('usdz', 'lamp.usdz')")
    expect(room).to_have_attribute("href", "lamp.usdz")
    opened.evaluate("(node) => node.setAttribute('usdz', 'taller.usdz')")
    assert (room.get_attribute("rel"), room.get_attribute("href")) == ("ar", "taller.usdz")
    assert room.evaluate("(link) => [...link.childNodes].map((node) => node.nodeName).join()") == "IMG"
    again(visitor, result="none.glb")
    expect(visitor.get_by_role("alert")).to_have_text("The result could not be loaded.")
