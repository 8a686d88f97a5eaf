"""A real browser on a real service: what the tests of the web page stand on.

Every page is watched: a script's error, a line of the console that says error, anything that the page's policy refused,
or a request to another host fails the test. Where a test fails, the last thing to see is a picture of the page.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast
from urllib.parse import urlsplit

import pytest

from tests.acceptance.service import Service
from tests.browser.steps import DEADLINE_MS

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, Request

T = TypeVar("T")

# WebGL by software: the machines that test have no GPU. Without the sandbox, which root may not use.
CHROMIUM_ARGUMENTS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox", "--disable-gpu-sandbox"]
# Only WebGL: the page itself is drawn without a GPU, in a third of the time. Debian's Chromium asks for one by itself.
CHROMIUM_ARGUMENTS += ["--disable-gpu-rasterization", "--disable-gpu-compositing"]
# One sample for each pixel is drawn sooner than four, and no test looks at an edge.
CHROMIUM_ARGUMENTS += ["--webgl-antialiasing-mode=none"]
_VIOLATIONS = """
window.__violations = [];
document.addEventListener("securitypolicyviolation", (event) => {
  window.__violations.push(`${event.violatedDirective}: ${event.blockedURI} (${event.sourceFile}:${event.lineNumber})`);
});
"""
# Short notes go after seconds, which a busy machine may need for one look at the page.
_NOTES = """
window.__notes = [];
new MutationObserver((changes) => {
  for (const change of changes)
    for (const node of change.addedNodes)
      if (node instanceof HTMLElement && node.classList.contains("toast")) window.__notes.push(node.textContent);
}).observe(document, { childList: true, subtree: true });
"""
_NO_WEBGL = """
const getContext = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.startsWith("webgl") ? null : getContext.call(this, kind, ...more);
};
if (self.OffscreenCanvas) OffscreenCanvas.prototype.getContext = () => null;
"""
# Each file that is chosen would be read, and each prompt that stands for a moment fitted: seconds of a process for what
# most tests do not look at.
_UNREAD = {
    "parts": (200, {"reading": None, "parts": [], "result": None, "warnings": []}),
    "preview": (422, {"status": 422, "code": "prompt_invalid", "title": "No preview", "detail": "Not in this test."}),
}
_ANSWERED = """
(() => {
  const fetched = window.fetch, answers = %s;
  window.fetch = (input, init) => {
    const [, answer] = Object.entries(answers).find(([name]) => String(input).includes(`/v1/jobs:${name}`)) ?? [];
    if (!answer) return fetched.call(window, input, init);
    return Promise.resolve(Response.json(answer[1], { status: answer[0] }));
  };
})();
"""
# What draws does nothing: the pages stay as they are with WebGL, but software need not compile and run the shaders.
_NO_DRAWING = """
window.__drawn = new Set(); // how many corners there were to draw
for (const name of ["drawArrays", "drawArraysInstanced"])
  WebGL2RenderingContext.prototype[name] = (mode, first, count) => void window.__drawn.add(count);
for (const name of ["drawElements", "drawElementsInstanced"])
  WebGL2RenderingContext.prototype[name] = (mode, count) => void window.__drawn.add(count);
"""
# Each page draws the studio's light once, with 256 samples at each of its pixels: three quarters of the time until the
# first picture. Each shape draws its shadow, and blurs it by 8 samples. No test looks at that light or a shadow's edge.
FEW_SAMPLES = """
const { shaderSource } = WebGL2RenderingContext.prototype;
WebGL2RenderingContext.prototype.shaderSource = function (shader, source) {
  const fewer = source.replace(/(#define GGX_SAMPLES) \\d+u/, "$1 8u").replace(/(#define VSM_SAMPLES) \\d+/, "$1 1");
  shaderSource.call(this, shader, fewer);
};
"""
# A quarter of the pixels, each as large as four: what a test looks for covers thousands of them.
_FEW_PIXELS = 'Object.defineProperty(window, "devicePixelRatio", { get: () => 0.5 });'
_REFUSED = re.compile(r"Failed to load resource: the server responded with a status of (\d+)")
_UNSEEN = re.compile(r"status of 4(04|22|29) .*/v1/jobs:preview")
"""What the form's own check says as well, or a moment decides."""
_OUTCOME = pytest.StashKey[dict[str, pytest.TestReport]]()


def chromium_path() -> str:
    """The browser's program; skips the test where there is none.

    The shell without windows comes first: each profile of the whole browser starts the page of a toolbar as well.
    """
    for name in ("chromium-headless-shell", "chromium", "chromium-browser"):
        if found := shutil.which(name):
            return found
    pytest.skip("Chromium is not installed (apt install chromium-headless-shell, or chromium)")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Let fixtures know how the test went."""
    report = yield
    item.stash.setdefault(_OUTCOME, {})[report.when] = report
    return report


class Kept:
    """What the tests of this folder share as long as they follow each other."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._made: dict[str, Any] = {}

    def get(self, name: str, make: Callable[[], AbstractContextManager[T]]) -> T:
        """Return what has the name, and make it if it is not there."""
        if name not in self._made:
            self._made[name] = self._stack.enter_context(make())
        return cast("T", self._made[name])

    def end(self) -> None:
        """End it all, the last first."""
        self._made.clear()
        self._stack.close()


_KEPT = Kept()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> Generator[None, None, None]:
    """End the browser after the last test in a row: while Playwright is there, an event loop runs in this thread."""
    yield
    if nextitem is None or Path(__file__).parent not in nextitem.path.parents:
        _KEPT.end()


@pytest.fixture(scope="session")
def kept() -> Kept:
    """What is ended after the last test in a row."""
    return _KEPT


@pytest.fixture
def browser(kept: Kept) -> Browser:
    """One Chromium for all tests in a row; each gets a profile of its own."""
    running = kept.get("browser", _launched)
    if not running.is_connected():  # it crashed: the tests after that one can do without the same fault
        kept.end()
    return kept.get("browser", _launched)


@contextmanager
def _launched() -> Iterator[Browser]:
    path = chromium_path()
    playwright_api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    with playwright_api.sync_playwright() as playwright:
        # A program that torch's threads would fight with runs beside it.
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        launched = playwright.chromium.launch(executable_path=path, args=CHROMIUM_ARGUMENTS, env=environment)
        yield launched
        launched.close()


class Watch:
    """What pages did that they should not have done; they may speak to the origin `home`."""

    def __init__(self, home: str) -> None:
        self._home = urlsplit(home).netloc
        self._faults: list[str] = []
        self._allowed: list[re.Pattern[str]] = []
        self.sent: list[str] = []
        """`METHOD /path` of every request to the service."""

    def allow(self, pattern: str) -> None:
        """Let what fits the pattern pass: the test brings it about."""
        self._allowed.append(re.compile(pattern))

    def attach(self, context: BrowserContext) -> None:
        """Watch every page of a profile."""
        context.add_init_script(_VIOLATIONS)
        context.add_init_script(_NOTES)
        context.on("console", self._on_console)
        context.on("weberror", lambda found: self._faults.append(f"a script failed: {found.error}"))
        context.on("request", self._on_request)

    def _on_console(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            where = message.location.get("url", "")
            if not _UNSEEN.search(f"{message.text} {where}"):
                self._faults.append(f"the console says: {message.text} ({where})")

    def _on_request(self, request: Request) -> None:
        parts = urlsplit(request.url)
        if parts.scheme in ("blob", "data"):
            return
        if parts.netloc != self._home:
            self._faults.append(f"a request to another host: {request.url}")
        self.sent.append(f"{request.method} {parts.path}")

    def posted(self) -> list[str]:
        """The requests so far that could have made a job."""
        return [line for line in self.sent if line == "POST /v1/jobs" or re.match(r"POST .*/(retry|branch)$", line)]

    def faults(self, context: BrowserContext) -> list[str]:
        """What is to be complained about."""
        found = list(self._faults)
        for page in context.pages:
            violations = [] if page.is_closed() else page.evaluate("window.__violations ?? []")
            found += [f"the policy refused: {violation}" for violation in violations]
        return [fault for fault in found if not any(pattern.search(fault) for pattern in self._allowed)]


@contextmanager
def watched(
    browser: Browser, base_url: str, request: pytest.FixtureRequest, folder: Path, **options: Any
) -> Iterator[tuple[Page, Watch]]:
    """A page in a profile of its own, which fails the test for whatever it does wrong."""
    # Without motion: drawing the bar of a waiting job again and again would take the processor from its worker.
    usual = {"viewport": {"width": 1280, "height": 800}, "reduced_motion": "reduce"}
    context = browser.new_context(base_url=base_url, **{**usual, **options})
    context.set_default_timeout(DEADLINE_MS)
    watch = Watch(base_url)
    watch.attach(context)
    context.add_init_script(FEW_SAMPLES)
    context.add_init_script(_FEW_PIXELS)
    if request.node.get_closest_marker("without_3d"):
        context.add_init_script(_NO_WEBGL)
    if request.node.get_closest_marker("without_pictures"):
        context.add_init_script(_NO_DRAWING)
    live = request.node.get_closest_marker("live")
    asked = (live.args or _UNREAD) if live else ()
    if answers := {name: answer for name, answer in _UNREAD.items() if name not in asked}:
        context.add_init_script(_ANSWERED % json.dumps(answers))
    page = context.new_page()
    try:
        yield page, watch
        faults = watch.faults(context)
        assert not faults, "\n".join(faults)
    finally:
        outcome = request.node.stash.get(_OUTCOME, {}).get("call")
        if outcome is None or outcome.failed:
            for number, each in enumerate(context.pages):
                picture = folder / f"page-{number}.png"
                each.screenshot(path=picture)
                print(f"picture of the page: {picture}")
        context.close()


@pytest.fixture
def watched_page(
    browser: Browser, service: Service, request: pytest.FixtureRequest, tmp_path: Path
) -> Iterator[tuple[Page, Watch]]:
    """A page on a desktop, and its watch."""
    with watched(browser, str(service.http.base_url).rstrip("/"), request, tmp_path) as found:
        yield found
    # What a failing test leaves running would let the next ones wait.
    for state in ("queued", "running"):
        for job in service.http.get("/v1/jobs", params={"state": state}).json()["jobs"]:
            service.http.post(f"/v1/jobs/{job['id']}/cancel")


@pytest.fixture
def page(watched_page: tuple[Page, Watch]) -> Page:
    """A page on a desktop."""
    return watched_page[0]


@pytest.fixture
def watch(watched_page: tuple[Page, Watch]) -> Watch:
    """The watch of `page`."""
    return watched_page[1]


@pytest.fixture(scope="session")
def small_sphere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An asset that is quick to deform."""
    from tests.acceptance.meshes import write_ellipsoid

    return write_ellipsoid(tmp_path_factory.mktemp("assets") / "sphere.obj", 1.0)


@pytest.fixture(scope="session")
def axe(repository: Path) -> str:
    """axe-core's source."""
    path = repository / "tests" / "node" / "node_modules" / "axe-core" / "axe.min.js"
    if not path.exists():
        pytest.skip("axe-core is not installed (npm install --prefix tests/node)")
    return path.read_text()
