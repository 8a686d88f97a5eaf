"""Measure how long a browser's worker takes to unfold a field: the page's own scripts, in Chromium.

meshdeform surface-fit surfaces/bumpy_torus.glb --base-faces 1563 --steps 20 -o torus.ndf   # 99,968 faces at level 3
python -m bench.unfold_in_browser torus.ndf --level 3

Prints a JSON line: the faces, the milliseconds of the first time, and the least and the median of those that follow,
as the worker's clock has them. Levels come in their order first, as on the page. Weights have no effect on the time.
`prepare` is what a new worker needs to read the file, to unfold the level and to evaluate all scalars of the file at
its vertices, with every function still to be compiled; `scalars_ms` is the scalars' part of it in the last of seven.
"""

from __future__ import annotations

import argparse
import base64
import functools
import http.server
import json
import statistics
import threading
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from tests.browser.conftest import CHROMIUM_ARGUMENTS, chromium_path

WEB = Path(__file__).parents[1] / "service" / "web"
SCRIPT = """async ([text, level, rounds]) => {
  let worker = new Worker("/viewer/field-worker.js", { type: "module" });
  const ask = (given) => new Promise((resolve, reject) => {
    worker.onmessage = ({ data }) => (data.error ? reject(new Error(data.error)) : resolve(data));
    worker.onerror = () => reject(new Error("the worker did not start"));
    worker.postMessage({ id: 1, ...given });
  });
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const opened = await ask({ task: "open", bytes: bytes.slice(0) });
  const times = [];
  let faces = 0;
  for (let k = 0; k < level; k++) await ask({ task: "level", level: k });
  for (let round = 0; round < rounds; round++) {
    // The worker keeps the last level: another one in between lets it be made again.
    if (round) await ask({ task: "level", level: 0 });
    const found = await ask({ task: "level", level });
    faces = found.faces;
    times.push(found.ms);
  }
  // What someone waits for who opens the file: in new workers, with every function still to be compiled.
  const prepared = [];
  let scalars = {};
  for (let round = 0; round < Math.min(rounds, 7); round++) {
    worker.terminate();
    worker = new Worker("/viewer/field-worker.js", { type: "module" });
    await ask({ task: "level", level: 0 }).catch(() => null); // it has started
    const again = await ask({ task: "open", bytes: bytes.slice(0) });
    let prepare = again.readMs + (await ask({ task: "level", level })).ms;
    scalars = {};
    for (const [at, { name, outputs }] of again.scalars.entries())
      for (let output = 0; output < outputs; output++) {
        const { ms } = await ask({ task: "scalar", level, scalars: at, output });
        scalars[name] = (scalars[name] ?? 0) + ms;
        prepare += ms;
      }
    prepared.push(prepare);
  }
  return { bytes: opened.bytes, read_ms: opened.readMs, faces, times, prepared, scalars_ms: scalars };
}"""


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *args: Any) -> None:
        """Say nothing."""


def measure(data: bytes, level: int, rounds: int) -> dict[str, Any]:
    """Return bytes, faces and milliseconds of a field's level in Chromium."""
    handler = functools.partial(_Quiet, directory=str(WEB))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium_path(), args=CHROMIUM_ARGUMENTS)
            page = browser.new_page()
            page.goto(f"http://127.0.0.1:{server.server_port}/icons/meshdeform.svg")
            found = page.evaluate(SCRIPT, [base64.b64encode(data).decode(), level, rounds])
            version = browser.version
            browser.close()
        server.shutdown()
    first, *more = found.pop("times")
    prepared = found.pop("prepared")
    prepare = {"prepare_least_ms": min(prepared), "prepare_median_ms": statistics.median(prepared)}
    least = {"first_ms": first, "least_ms": min(more), "median_ms": statistics.median(more)}
    return {**found, **{name: round(value, 1) for name, value in (least | prepare).items()}, "chromium": version}


def main() -> None:
    """Measure one field."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("field", type=Path)
    parser.add_argument("--level", type=int, default=3)
    parser.add_argument("--rounds", type=int, default=20)
    given = parser.parse_args()
    print(json.dumps(measure(given.field.read_bytes(), given.level, given.rounds)))


if __name__ == "__main__":
    main()
