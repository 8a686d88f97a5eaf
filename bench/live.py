"""Time previews of a real service, as somebody types: ``python -m bench.live [--browser] [--turns N] [--faces N]``.

Starts a service in a temporary folder, reads an asset (the painted animal with 10,000 faces), and asks for prompts one
after the other, whose nouns were drawn before: how long the first takes, the next ones, of a large asset after a draft,
five more seeds of each, and the file of one that was seen. `import torch` is timed between them, by the clock and by
the processor, which counts on a busy machine. With ``--browser``, Chromium types on the page: from the end of its pause
of .3 s to the frame after the shape has come.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

import httpx
import numpy as np

from bench.jobs import ROOT
from meshdeform.assets import build_glb, load_asset
from meshdeform.reading.banks import bank_of
from meshdeform.runs.kept_readings import samples_in
from meshdeform.settings import Settings
from tests.servers import free_port

PROMPTS = ("a giraffe", "a dog", "a horse", "an elephant", "a pig", "a rhino", "a cow", "a camel", "a sheep", "a lion")
PAUSE_S, READY_S = 0.3, 300.0
LARGE = 20_000
"""Faces above which previews have drafts."""


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
            if (process / "cmdline").read_bytes().endswith(b"\0copies\0"):
                total += sum(map(int, (process / "stat").read_text().rpartition(")")[2].split()[11:13]))
    return total / os.sysconf("SC_CLK_TCK")


def by_http(url: str, asset: bytes, turns: int, *, large: bool) -> dict[str, list[tuple[float, float]]]:
    """Return the seconds of what is asked, by what it is: of the clock and of the processor."""
    times: dict[str, list[tuple[float, float]]] = {"import torch": []}
    with httpx.Client(base_url=url, timeout=600) as client:

        def ask(what: str, document: dict[str, object], **query: str) -> None:
            begun, used = time.perf_counter(), used_s()
            named = "asset" in document
            sent = {"asset": ("animal.glb", asset), "request": (None, json.dumps(document))}
            answer = client.post("/v1/jobs:preview", params=query, **({"json": document} if named else {"files": sent}))
            times.setdefault(what, []).append((time.perf_counter() - begun, used_s() - used))
            if answer.status_code != 503:  # it took too long
                answer.raise_for_status()

        ask("reading it, and a change", {"prompt": "longer legs"})
        kept = {"asset": {"sha256": hashlib.sha256(asset).hexdigest()}}
        ask("first prompt", {**kept, "prompt": PROMPTS[0]})
        for number in range(turns):
            times["import torch"].append(import_torch())
            prompt = PROMPTS[(number + 1) % len(PROMPTS)]
            if large:
                ask("next prompt, a draft", {**kept, "prompt": prompt}, draft="true")
            ask("next prompt", {**kept, "prompt": prompt})
            ask("its file", {**kept, "prompt": prompt}, **{"as": "glb"})
            ask("five more seeds", {**kept, "prompt": prompt, "seeds": [0, 1, 2, 3, 4, 5]})
            ask("a change", {**kept, "prompt": f"legs longer by {10 + number} %"})
    return times


def by_browser(url: str, asset: Path, turns: int) -> dict[str, list[tuple[float, float]]]:
    """Return the seconds from the end of the pause to the shape and to the last of six, on the page."""
    from playwright.sync_api import sync_playwright

    from tests.browser.conftest import CHROMIUM_ARGUMENTS, FEW_SAMPLES, chromium_path

    names = ("first prompt on the page", "next prompt on the page", "six on it")
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=CHROMIUM_ARGUMENTS)
        page = browser.new_page()
        page.set_default_timeout(600_000)
        page.add_init_script(FEW_SAMPLES)
        page.goto(url)
        page.set_input_files("#asset-file", asset)
        page.locator("#asset-facts", has_text=asset.name).wait_for()
        page.locator(".parts[aria-busy='false']").wait_for(state="attached")
        for number, prompt in enumerate(PROMPTS[:turns]):  # what it has shown the page does not ask for again
            with page.expect_response(lambda answer: "as=glb" in answer.url and answer.status == 200) as found:
                begun, used = time.perf_counter() + PAUSE_S, used_s()
                page.locator("#prompt").fill(prompt)
            found.value.finished()
            page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            times[names[min(number, 1)]].append((time.perf_counter() - begun, used_s() - used))
            page.locator(".live-member:nth-child(6) img[src]").wait_for(state="attached")
            times[names[2]].append((time.perf_counter() - begun, used_s() - used))
        browser.close()
    return times


def told(times: dict[str, list[tuple[float, float]]], torch: tuple[float, float]) -> None:
    """Print the medians and the 95th percentiles, in seconds and beside `import torch`."""
    for what, seconds in times.items():
        if seconds:
            clock, used = zip(*seconds, strict=True)
            print(
                f"{what:26} {len(seconds):3}  p50 {median(clock):6.2f} s ({median(clock) / torch[0]:5.2f})"
                f"  p95 {float(np.percentile(clock, 95)):6.2f} s"
                f"  processor {median(used):6.2f} s ({median(used) / torch[1]:5.2f})",
                flush=True,
            )


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--browser", action="store_true", help="also type on the page, in Chromium")
    parser.add_argument("--turns", type=int, default=10, help="prompts (default: %(default)s)")
    parser.add_argument("--faces", type=int, default=10_000, help="of the asset (default: %(default)s)")
    arguments = parser.parse_args()
    asset = asset_of(arguments.faces)
    for prompt in PROMPTS[: arguments.turns + 1]:  # once a machine, whoever asks first
        bank_of(prompt.split()[1], samples_in(Settings().cache_folder), ())
    with tempfile.TemporaryDirectory() as folder, service(Path(folder) / "data") as url:
        times = by_http(url, asset, arguments.turns, large=arguments.faces > LARGE)
        clock, used = zip(*times["import torch"], strict=True)
        torch = median(clock), median(used)
        told(times, torch)
        if arguments.browser:
            file = Path(folder) / "animal-10k.glb"
            file.write_bytes(asset)
            told(by_browser(url, file, arguments.turns), torch)


if __name__ == "__main__":
    main()
