"""Time previews of a real service, as somebody types: ``python -m bench.live [--browser] [--turns N] [--faces N]``.

Starts a service in a temporary folder, reads an asset (the painted animal with 10,000 faces), and asks for prompts one
after the other, whose nouns were drawn before: how long the draft takes, the exact shape, its file, drafts of five more
seeds, and a plain change. `import torch` is timed between them, by the clock and by the processor, which counts on a
busy machine. With ``--browser``, Chromium types on the page: from the end of its pause of .3 s to the frame after the
first shape and the exact one have come, and to the last of six designs; and it drags the slider of a part.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import httpx
import numpy as np

from bench.jobs import ROOT
from meshdeform.assets import build_glb, load_asset
from meshdeform.reading.banks import bank_of
from meshdeform.runs.kept_readings import samples_in
from meshdeform.settings import Settings
from tests.servers import free_port

if TYPE_CHECKING:
    from playwright.sync_api import Page

PROMPTS = ("a giraffe", "a dog", "a horse", "an elephant", "a pig", "a rhino", "a cow", "a camel", "a sheep", "a lion")
PAUSE_S, READY_S = 0.3, 300.0
TORCH = "import torch"
WAIT_MS = 90_000
TWO_FRAMES = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
FRAMES = 120
DRAG = """async (count) => {
  const slider = document.querySelector(".parts input[type=range]");
  const [frames, scripts] = [[], []];
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  let last = await frame();
  for (let k = 0; k < count; k++) {
    const begun = performance.now();
    slider.value = String(Math.round(30 + 25 * Math.sin(k / 8)));
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    scripts.push(performance.now() - begun);
    const now = await frame();
    frames.push(now - last);
    last = now;
  }
  return [frames, scripts];
}"""


def asset_of(faces: int) -> bytes:
    """Return the painted animal with about so many faces, without its paint."""
    import trimesh

    surface = load_asset((ROOT / "service/web/examples/animal.glb").read_bytes(), "animal.glb").surface
    mesh = trimesh.Trimesh(surface.positions, surface.triangles, process=True).subdivide()
    while len(mesh.faces) < faces:
        mesh = mesh.subdivide()
    mesh = mesh.simplify_quadric_decimation(face_count=faces)
    return build_glb(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64))


@contextmanager
def service(folder: Path, **more: str) -> Iterator[str]:
    """Run a service with one worker, and return its address; `more`: of its environment."""
    url = f"http://127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "meshdeform", "serve", "--port", url.rpartition(":")[2], "--data-dir", str(folder)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", **more}
    with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            until = time.monotonic() + READY_S
            while time.monotonic() < until:
                try:
                    if httpx.get(f"{url}/readyz").status_code == 200:
                        break
                except httpx.TransportError:
                    pass
                time.sleep(0.1)
            else:
                raise SystemExit(f"{url} was not ready within {READY_S} s")
            yield url
        finally:
            process.terminate()


def import_torch() -> tuple[float, float]:
    """Return the seconds that another process takes to import torch, by the clock and of the processor."""
    begun, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", "import torch"], env={**os.environ, "OMP_NUM_THREADS": "1"}, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - begun, used_s


def used_s() -> float:
    """Return the processor's seconds of the processes that make previews."""
    total = 0
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if b"preview_work" in (process / "cmdline").read_bytes():
                total += sum(map(int, (process / "stat").read_text().rpartition(")")[2].split()[11:13]))
    return total / os.sysconf("SC_CLK_TCK")


class Times:
    """Seconds of what was asked, of the clock and of the processor; each is printed as it comes."""

    def __init__(self) -> None:
        self.by_name: dict[str, list[tuple[float, float]]] = {}

    def add(self, what: str, clock_s: float, processor_s: float) -> None:
        """Add a measurement, and print it."""
        self.by_name.setdefault(what, []).append((clock_s, processor_s))
        print(f"  {what:26} {clock_s:6.2f} s  processor {processor_s:6.2f} s", flush=True)

    def add_torch(self) -> None:
        """Time `import torch`, which the others stand beside."""
        self.add(TORCH, *import_torch())

    def told(self) -> None:
        """Print the medians and the 95th percentiles, in seconds and beside `import torch`."""
        torch = [median(each) for each in zip(*self.by_name[TORCH], strict=True)]
        for what, seconds in self.by_name.items():
            clock, used = zip(*seconds, strict=True)
            print(
                f"{what:26} {len(seconds):3}  p50 {median(clock):6.2f} s ({median(clock) / torch[0]:5.2f})"
                f"  p95 {float(np.percentile(clock, 95)):6.2f} s"
                f"  processor {median(used):6.2f} s ({median(used) / torch[1]:5.2f})",
                flush=True,
            )


def by_http(url: str, asset: bytes, turns: int) -> Times:
    """Ask for previews, prompt after prompt."""
    times = Times()
    with httpx.Client(base_url=url, timeout=600) as client:

        def ask(what: str, document: dict[str, object], **query: str) -> None:
            begun, used = time.perf_counter(), used_s()
            named = "asset" in document
            sent = {"asset": ("animal.glb", asset), "request": (None, json.dumps(document))}
            answer = client.post("/v1/jobs:preview", params=query, **({"json": document} if named else {"files": sent}))
            times.add(what, time.perf_counter() - begun, used_s() - used)
            if answer.status_code != 503:  # it took too long
                answer.raise_for_status()

        ask("reading it, and a change", {"prompt": "longer legs"})
        kept = {"asset": {"sha256": hashlib.sha256(asset).hexdigest()}}
        ask("first prompt", {**kept, "prompt": PROMPTS[0]})
        for number in range(turns):
            times.add_torch()
            prompt = PROMPTS[(number + 1) % len(PROMPTS)]
            ask("next prompt, a draft", {**kept, "prompt": prompt}, draft="true")
            ask("exactly", {**kept, "prompt": prompt})
            ask("its file", {**kept, "prompt": prompt}, **{"as": "glb"})
            ask("drafts of five more seeds", {**kept, "prompt": prompt, "seeds": [0, 1, 2, 3, 4, 5]}, draft="true")
            ask("a change", {**kept, "prompt": f"legs longer by {10 + number} %"})
    return times


def by_browser(url: str, asset: Path, turns: int) -> None:
    """Type on the page: from the end of its pause to the first shape, the exact one, and pictures of six."""
    from playwright.sync_api import sync_playwright

    from tests.browser.conftest import CHROMIUM_ARGUMENTS, FEW_SAMPLES, chromium_path

    times = Times()

    def typed(page: Page, prompt: str, which: str) -> None:
        with (
            page.expect_response(lambda answer: "as=glb&draft=false" in answer.url) as exact,
            page.expect_response(lambda answer: "as=glb&draft=true" in answer.url) as first,
        ):
            begun, used = time.perf_counter() + PAUSE_S, used_s()
            page.locator("#prompt").fill(prompt)
            first.value.finished()
            page.evaluate(TWO_FRAMES)
            times.add(f"{which} prompt, first shape", time.perf_counter() - begun, used_s() - used)
        exact.value.finished()
        page.evaluate(TWO_FRAMES)
        times.add(f"{which} prompt, exactly", time.perf_counter() - begun, used_s() - used)
        page.locator(".live-member:nth-child(6) img[src]").wait_for(state="attached")
        times.add(f"{which} prompt, six designs", time.perf_counter() - begun, used_s() - used)

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=CHROMIUM_ARGUMENTS)
        page = browser.new_page()
        page.set_default_timeout(WAIT_MS)
        page.add_init_script(FEW_SAMPLES)
        page.goto(url)
        begun, used = time.perf_counter(), used_s()
        page.set_input_files("#asset-file", asset)
        page.locator("#asset-facts", has_text=asset.name).wait_for()
        page.locator(".parts[aria-busy='false']").wait_for(state="attached")
        times.add("reading it", time.perf_counter() - begun, used_s() - used)
        times.add_torch()
        for number, prompt in enumerate(PROMPTS[:turns]):  # what it has shown the page does not ask for again
            times.add_torch()
            typed(page, prompt, "next" if number else "first")
        times.told()
        slide(page)
        browser.close()


def slide(page: Page) -> None:
    """Drag the slider of a part, and print how long frames take, and what of it the page's scripts do."""
    parts = page.locator(".parts")
    parts.get_by_role("button", name=re.compile("legs$")).first.click()
    with page.expect_response(lambda answer: "jobs:preview" in answer.url and answer.status == 200):
        parts.get_by_role("button", name="longer", exact=True).click()
    page.wait_for_timeout(2000)
    page.route("**/v1/jobs:preview*", lambda route: route.abort())  # what moves then moves without the server
    viewer = page.locator(".asset-panel .viewer").first
    before = viewer.screenshot()
    frames, scripts = page.evaluate(DRAG, FRAMES)
    if viewer.screenshot() == before:
        raise SystemExit("the slider moves nothing")
    page.unroute("**/v1/jobs:preview*")
    for what, each in (("frames", frames), ("of which the scripts", scripts)):
        p50, p95 = np.percentile(each, (50, 95))
        print(f"  a slider of a part, {what}: p50 {p50:.1f} ms, p95 {p95:.1f} ms", flush=True)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--browser", action="store_true", help="type on the page instead, in Chromium")
    parser.add_argument("--turns", type=int, default=5, help="prompts (default: %(default)s)")
    parser.add_argument("--faces", type=int, default=10_000, help="of the asset (default: %(default)s)")
    arguments = parser.parse_args()
    asset = asset_of(arguments.faces)
    for prompt in PROMPTS[: arguments.turns + 1]:  # once a machine, whoever asks first
        bank_of(prompt.split()[1], samples_in(Settings().cache_folder), ())
    with tempfile.TemporaryDirectory() as folder, service(Path(folder) / "data") as url:
        if arguments.browser:
            file = Path(folder) / "typed.glb"  # not the name of an example
            file.write_bytes(asset)
            by_browser(url, file, arguments.turns)
        else:
            by_http(url, asset, arguments.turns).told()


if __name__ == "__main__":
    main()
