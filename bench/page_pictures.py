"""Take the pictures of the web page for the docs, with a real browser and a real service.

python -m bench.page_pictures                 writes docs/pictures/web_job.png, web_list_dark.png and web_phone.png
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page, sync_playwright

from tests.acceptance.service import serving
from tests.browser.conftest import CHROMIUM_ARGUMENTS, chromium_path
from tests.browser.steps import DEADLINE_MS

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "pictures"
LARGEST_BYTES = 420_000
EXAMPLES = ROOT / "service" / "web" / "examples"
JOBS = (
    ("horse.glb", "a longer neck and longer legs", 0),
    ("animal.glb", "a giraffe with a long neck", 0),
    ("sphere.glb", "a mushroom with a big cap", 0),
    ("walker.glb", "longer legs", 0),
    ("robot.glb", "bigger head", 0),
    ("cube.glb", "a chair", 4),
    ("car.glb", "30 % longer", 0),
    ("teapot.glb", "longer spout", 0),
)
"""Assets, prompts and seeds; the first is shown by itself."""
JOB: dict[str, Any] = {"viewport": {"width": 1200, "height": 860}}
PHONE: dict[str, Any] = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True}


@contextmanager
def with_jobs(folder: Path) -> Iterator[tuple[str, str]]:
    """Run a service with finished jobs; yield its URL and the id of one of them."""
    with serving(folder, PYTHONPATH=str(ROOT)) as service:  # without the tests' smaller pictures
        jobs = []
        for name, prompt, seed in JOBS:
            jobs.append(service.submit(EXAMPLES / name, {"prompt": prompt, "params": {"seed": seed}}))
        for job in jobs:
            assert service.finished(job)["state"] == "succeeded", service.log
        yield str(service.http.base_url).rstrip("/"), jobs[0]


@contextmanager
def opened(browser: Browser, url: str, view: str, path: Path, **options: Any) -> Iterator[Page]:
    """Open a view, and save its picture at the end."""
    context = browser.new_context(base_url=url, reduced_motion="reduce", **options)
    context.set_default_timeout(2 * DEADLINE_MS)
    page: Page = context.new_page()
    page.goto(view)
    yield page
    page.wait_for_load_state("networkidle")
    page.screenshot(path=path)
    context.close()
    assert path.stat().st_size < LARGEST_BYTES, f"{path} has {path.stat().st_size} bytes"


def take(browser: Browser, url: str, path: Path, view: str, ready: str, press: str = "", **options: Any) -> None:
    """Save a picture of a view once it is complete; `press` is the label of the button to press before."""
    with opened(browser, url, view, path, **options) as page:
        page.locator(ready).first.wait_for()
        page.wait_for_load_state("networkidle")
        if press:
            page.get_by_text(press, exact=True).click()
            page.locator(".before .viewer").wait_for()
            page.evaluate("() => Promise.all(document.getAnimations().map((each) => each.finished))")
            page.evaluate("() => scrollTo(0, 0)")  # the click may have scrolled


def main() -> None:
    """Take the pictures of the web page."""
    with tempfile.TemporaryDirectory(prefix="meshdeform-pictures-") as folder, sync_playwright() as playwright:
        launched = playwright.chromium.launch(
            executable_path=chromium_path(), args=CHROMIUM_ARGUMENTS, env={**os.environ, "OMP_NUM_THREADS": "1"}
        )
        with with_jobs(Path(folder)) as (url, job):
            desktop: dict[str, Any] = {"viewport": {"width": 1200, "height": 760}}
            take(launched, url, PICTURES / "web_job.png", f"/#/jobs/{job}", ".parts .read .chip", "Side by side", **JOB)
            take(launched, url, PICTURES / "web_list_dark.png", "/#/jobs", ".card img", color_scheme="dark", **desktop)
            take(launched, url, PICTURES / "web_phone.png", f"/#/jobs/{job}", ".verdict p", **PHONE)


if __name__ == "__main__":
    main()
