"""What a person does on the page, in the words of the page."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tests.acceptance.service import DEADLINE_S, until

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

    from tests.browser.conftest import Watch

_KEPT_FILES = """() => new Promise((resolve) => {
  const opening = indexedDB.open("meshdeform", 2);
  opening.onsuccess = () => {
    const read = opening.result.transaction("files").objectStore("files").getAll();
    read.onsuccess = () => {
      opening.result.close();
      resolve(read.result.flatMap((files) => Object.values(files).map(({ name }) => name)));
    };
  };
})"""


DEADLINE_MS = 1000 * DEADLINE_S  # only a hang takes so long, on a busy machine too
_FEW_STEPS = """
(() => {
  if (window.__stringify) return;
  const stringify = (window.__stringify = JSON.stringify);
  JSON.stringify = (value, ...more) => {
    if (!value?.params?.preset || value.kept) return stringify(value, ...more);
    const params = { ...value.params, steps: window.__steps };
    // The search for the front takes as long as the rest.
    if (value.prompt) params.guidance = { orientation: "keep", ...params.guidance };
    return stringify({ ...value, params }, ...more);
  };
})();
"""

_LONG = [{"operation": "long", "more": "longer", "less": "shorter"}]
_READ: dict[str, Any] = {
    "reading": {"noun": "horse", "probability": 0.6, "sure": False, "noun_given": False, "front_given": False},
    "parts": [
        {"name": name, "found_by": "shapes", "confidence": 0.4, "faces": [[k, k]], "changes": _LONG}
        for k, name in enumerate(("head", "neck", "body", "legs", "tail", "ears", "muzzle"))
    ],
    "result": None,
    "warnings": [],
}
_READ["reading"] |= {"nouns": [{"noun": "horse", "probability": 0.6}, {"noun": "cow", "probability": 0.3}]}
_READ["reading"] |= {"front_azimuth_deg": 90.0, "front_sure": False}


def read_all_alike(page: Page) -> None:
    """Answer what each file is read as, on a page that is `live("parts")`: a process would take seconds."""
    page.route("**/v1/jobs:parts", lambda route: route.fulfill(json=_READ))


def expect(what: Page | Locator) -> Any:
    """Return Playwright's assertions, which wait for as long as only a hang takes.

    Every worker of the tests reads these files, and Playwright takes it a second: only those that use it import it.
    """
    from playwright.sync_api import expect

    expect.set_options(timeout=DEADLINE_MS)
    return expect(what)


def open_form(page: Page) -> None:
    """Go to the form for a new job, and wait until it is all there."""
    page.goto("/")
    page.get_by_role("heading", level=1, name="Describe what it should become").wait_for()
    page.get_by_role("group", name="Suggested prompts", include_hidden=True).locator("button").first.wait_for(
        state="attached"
    )


def open_more(page: Page) -> None:
    """Open the fold with all that most people do without."""
    fold = page.locator("details.bench-details")
    fold.wait_for()
    if fold.get_attribute("open") is None:
        fold.locator("summary").first.click()


def choose_way(page: Page, way: str) -> None:
    """Choose how the asset becomes what is asked for: `shape` or `pictures`."""
    open_more(page)
    page.get_by_label("How", exact=True).select_option(way)


def choose(page: Page, asset: Path) -> None:
    """Choose a file as the asset."""
    page.set_input_files("#asset-file", asset)
    page.locator("#asset-facts", has_text=asset.name).wait_for()


def kept_files(page: Page) -> list[str]:
    """The names of the files that drafts have: the browser writes them a moment after the last change."""
    return list(page.evaluate(_KEPT_FILES))


def set_steps(page: Page, steps: int, seed: int = 7) -> None:
    """Let every job that the page asks for from now on be so short; fits have no steps, so a model pushes.

    The page itself offers three qualities, of which the quickest is long for a test.
    """
    page.add_init_script(f"window.__steps = {steps}; {_FEW_STEPS}")
    page.evaluate(f"window.__steps = {steps}; {_FEW_STEPS}")
    choose_way(page, "pictures")
    page.get_by_label("Variation", exact=True).fill(str(seed))


def keep(page: Page) -> Locator:
    """What makes a job of what the page shows, or of what it cannot show before a job has run."""
    return page.get_by_role("button", name=re.compile("^(Keep|Run)$"))


def start(page: Page) -> str:
    """Start the job and return its id once the page shows it."""
    before = page.url
    keep(page).click()
    page.wait_for_url(lambda url: url != before and re.search(r"#/jobs/job_\w+$", url) is not None)
    page.locator(".job-head").wait_for()
    return shown_job(page)


def shown_job(page: Page) -> str:
    """The id of the job that the page shows."""
    found = re.search(r"#/jobs/(job_\w+)$", page.url)
    assert found, page.url
    return found[1]


def drag(page: Page, place: Locator, *ways: tuple[float, float]) -> None:
    """Drag over something, along shares of its width and height."""
    box = place.bounding_box()
    assert box is not None
    begin, *rest = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in ways]
    page.mouse.move(*begin)
    page.mouse.down()
    for each in rest:
        page.mouse.move(*each, steps=3)
    page.mouse.up()


def badge(page: Page) -> Locator:
    """The state of the job that the page shows, and what its result is worth where the report says it."""
    return page.locator(".job-head .badge")


def until_judged(page: Page) -> None:
    """Wait until the page says what the result of a deformation is worth."""
    expect(badge(page)).to_have_text(re.compile("^(Good|Doubtful|Better keep your asset)$"))


def until_noted(page: Page, text: str) -> None:
    """Wait until the page has shown a short note with the text; the note itself may be gone by then."""
    until(f"the note {text!r}", lambda: any(text in note for note in page.evaluate("window.__notes")))


def picture(viewer: Locator) -> NDArray[np.int16]:
    """The middle of a viewer, as it is on the screen: what stands over its edges is left out."""
    seen: NDArray[Any] = np.asarray(Image.open(io.BytesIO(viewer.screenshot())).convert("RGB"), dtype=np.int16)
    height, width = seen.shape[:2]
    return seen[height // 5 : -height // 5, width // 5 : -width // 5]


def upper_half(viewer: Locator) -> NDArray[np.int16]:
    """The upper half of what `picture` shows."""
    seen = picture(viewer)
    return seen[: len(seen) // 2]


def difference(a: NDArray[np.int16], b: NDArray[np.int16]) -> float:
    """How much two pictures of the same size differ: the share of pixels that are clearly not alike."""
    height, width = min(a.shape[0], b.shape[0]), min(a.shape[1], b.shape[1])
    return float((np.abs(a[:height, :width] - b[:height, :width]).max(axis=2) > 24).mean())


def until_drawn(viewer: Locator) -> NDArray[np.int16]:
    """The picture of a viewer once there is something to see in it."""

    seen = picture(viewer)

    def drawn() -> bool:
        nonlocal seen
        seen = picture(viewer)
        return bool(seen.std() > 5)

    until("something is to be seen in the viewer", drawn)
    return seen


def until_shown(page: Page, triangles: int) -> None:
    """Wait until a viewer shows a mesh of so many triangles, on a page `without_pictures`."""
    page.wait_for_function("(corners) => window.__drawn.has(corners)", arg=3 * triangles)


def straight_way(page: Page, watch: Watch) -> None:
    """Let the server make no shapes on the way to a result, which takes seconds of a process for each of them.

    The view then takes straight lines. tests/browser/test_page_views.py has the real way.
    """
    watch.allow(r"status of 422 .*strength=")
    refusal = {"code": "invalid_request", "title": "Invalid request", "status": 422, "detail": "Not here."}
    headers = {"Content-Type": "application/problem+json"}
    page.route("**/result.glb?strength=*", lambda route: route.fulfill(status=422, headers=headers, json=refusal))


RULES = {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}
OF_COLOURS = {"type": "rule", "values": ["color-contrast", "link-in-text-block"]}


def barriers(page: Page, axe: str, rules: dict[str, Any] = RULES) -> list[str]:
    """What axe-core finds, of whatever impact; `OF_COLOURS` are the rules that look at colours."""
    if not page.evaluate("() => 'axe' in window"):
        # By the debugger, which the page's policy does not bind.
        page.evaluate(axe)
    # A colour on its way from light to dark is neither. An element that inherits one sets out a frame after its parent.
    page.evaluate(
        """async () => {
          for (let still = 0; still < 2; still += 1) {
            await new Promise((done) => requestAnimationFrame(done));
            const moving = document.getAnimations().filter((animation) => animation.playState === "running");
            if (moving.length) still = -1;
            await Promise.allSettled(moving.map((animation) => animation.finished));
          }
        }"""
    )
    found: list[dict[str, Any]] = page.evaluate(
        "async (rules) => (await axe.run(document, { runOnly: rules })).violations", rules
    )
    return [
        f"{each['impact']}: {each['id']}: {each['help']}: "
        + json.dumps([(node["html"][:160], node.get("failureSummary", "")[:300]) for node in each["nodes"][:3]])
        for each in found
    ]
