"""Measure what jobs cost, and how good estimates are: ``python -m bench.estimates FILE [--assets FOLDER]``.

Runs jobs of several kinds, presets, steps and meshes (`examples/`, balls of up to 320,000 faces and 200 parts, and the
GLB and OBJ files of a folder) by `meshdeform.runs.start_run`, one after the other in this process on one thread, as a
worker does. FILE gets the CPU seconds of each, a line of JSON; what it has already does not run again.

Then it fits `meshdeform.runs.costs.MEASURED`, and prints for every kind how many estimates are within a factor of 1.5
of what was measured. The jobs of an asset are estimated by those of the other assets, costs and pace alike.
"""

from __future__ import annotations

import argparse
import io
import json
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw
from scipy.optimize import nnls

from bench.scale import write
from meshdeform.assets import load_asset
from meshdeform.errors import MeshdeformError
from meshdeform.priors import load_prior
from meshdeform.requests.document import JobRequest, resolve
from meshdeform.runs import start_run
from meshdeform.runs.base import InputFile, RunInput
from meshdeform.runs.costs import Costs, Seconds, features, pace_of
from meshdeform.runs.devices import use_threads
from meshdeform.runs.kept_readings import FolderReadings, Readings

Row = dict[str, Any]
EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
_BALLS = [(320, 1), (1300, 1), (5000, 1), (5000, 4), (11000, 1), (20000, 1), (20000, 16), (20000, 200), (80000, 1)]
_BALLS += [(80000, 40), (320000, 1)]
_NOUNS = ("a mushroom", "a chair", "a cat", "a car", "a duck", "a bottle", "a house")
_STEPS = (20, 40, 80, 120, 200)


def disc() -> bytes:
    """Return a PNG of a white disc on black: the silhouette of something round."""
    picture = Image.new("L", (128, 128))
    ImageDraw.Draw(picture).ellipse((24, 34, 104, 114), fill=255)
    file = io.BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()


def assets(folder: Path, more: Path | None) -> Iterator[tuple[str, bytes]]:
    for faces, parts in _BALLS:
        write(folder / f"ball-{faces}-{parts}.glb", faces, parts)
    for place in (folder, EXAMPLES, *([more] if more else [])):
        for path in sorted(place.rglob("*")):
            if path.suffix in (".glb", ".obj"):
                yield path.name, path.read_bytes()


def requests(number: int) -> Iterator[tuple[str, Row]]:
    """Yield three documents for an asset, such that all combinations come about."""
    steps = _STEPS[number % len(_STEPS)]
    prompt = _NOUNS[number % len(_NOUNS)]
    silhouettes = {"kind": "silhouettes", "silhouettes": [{"azimuth": 0}]}
    of_all: list[tuple[str, Row]] = [
        ("preview", {"prompt": prompt, "params": {"preset": "preview", "steps": steps}}),
        ("balanced", {"prompt": prompt, "params": {"preset": "balanced", "steps": steps}}),
        ("target", {"params": {"preset": "preview", "steps": steps, "guidance": {"kind": "target"}}}),
        ("paper", {"prompt": prompt, "params": {"preset": "paper", "steps": steps}}),
        ("surface_fit", {"kind": "surface_fit", "params": {"steps": 3 * steps, "base_faces": 500}}),
        ("silhouettes", {"params": {"preset": "balanced", "steps": steps, "guidance": silhouettes}}),
    ]
    yield of_all[number % 6]
    yield of_all[(number + 3) % 6]
    yield "exemplar", {"prompt": prompt, "params": {"guidance": {"kind": "exemplar"}}}


def measured(filename: str, asset: bytes, document: Row, prior: Any, readings: Readings) -> Row:
    request = JobRequest.model_validate(document)
    kind, guidance = request.workload.split("/")[:2]
    files = {"asset": InputFile(asset, filename)}
    if guidance == "target":
        files["target"] = InputFile((EXAMPLES / "vase.glb").read_bytes(), "vase.glb")
    if guidance == "silhouettes":
        files["silhouette_1"] = InputFile(disc(), "disc.png")
    summary = load_asset(asset, filename).summary
    safeguard = resolve(request.params).safeguard.value if kind == "text_deform" else None
    began = time.process_time()
    run = start_run(RunInput(request=request, files=files, load_prior=lambda _model: prior, readings=readings))
    started = time.process_time()
    for _ in run:
        pass
    stepped = time.process_time()
    run.finish()
    start, end = started - began, time.process_time() - stepped
    return {
        "kind": f"{kind}/{guidance}", "mesh": (summary.triangles, summary.meshes, safeguard), "steps": run.total_steps,
        "once": start + end, "end": end, "step": (stepped - started) / run.total_steps,
    }  # fmt: skip


def fitted(rows: Sequence[Row]) -> Costs:
    """Return the costs that are nearest to these jobs, relative to what they took, and right for half of them."""
    mesh = np.array([features(*row["mesh"]) for row in rows])
    one = np.ones(len(rows))
    once, step = (np.array([row[name] for row in rows]) for name in ("once", "step"))
    costs = []
    for known, took in ((mesh[:, :1], once), (mesh[:, 1:], step)):
        shares = np.column_stack([one, known]) / took[:, None]
        found = nnls(shares, one)[0]
        costs += [float(f"{cost:.3g}") for cost in found / np.median(shares @ found)]
    return Costs(*costs)


def ratio(row: Row, others: Sequence[Row]) -> float:
    """Return how many times the measured seconds the estimate of a job by others is."""
    costs = fitted(others)
    pace = pace_of([(costs.seconds(*each["mesh"]), Seconds(each["once"], each["step"])) for each in others])
    took = Seconds(row["once"], row["step"]).of(row["steps"])
    return costs.seconds(*row["mesh"]).times(pace).of(row["steps"]) / took


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("file", type=Path)
    parser.add_argument("--assets", type=Path, help="a folder with further meshes")
    options = parser.parse_args()
    use_threads(1)
    prior = load_prior("builtin", device="cpu")
    options.file.touch()
    rows = [json.loads(line) for line in options.file.read_text().splitlines()]
    known = {(row["asset"], row["job"]) for row in rows}
    with tempfile.TemporaryDirectory() as folder, options.file.open("a") as file:
        readings, sphere = FolderReadings(Path(folder) / "cache"), (EXAMPLES / "sphere.glb").read_bytes()
        measured("sphere.glb", sphere, {"prompt": "a cat", "params": {"steps": 2}}, prior, readings)
        for noun in _NOUNS:  # whose tables are drawn once a machine
            measured(
                "sphere.glb", sphere, {"prompt": noun, "params": {"guidance": {"kind": "exemplar"}}}, prior, readings
            )
        for number, (name, asset) in enumerate(assets(Path(folder), options.assets)):
            for job, document in requests(number):
                if (name, job) in known:
                    continue
                try:
                    rows.append({"asset": name, "job": job, **measured(name, asset, document, prior, readings)})
                except MeshdeformError as error:
                    print(f"{name}, {job}: {error}")
                    continue
                file.write(json.dumps(rows[-1]) + "\n")
                file.flush()
    print(f"share of the end in start and end: {np.median([row['end'] / row['once'] for row in rows]):.2f}")
    every = []
    for kind in sorted({row["kind"] for row in rows}):
        alike = [row for row in rows if row["kind"] == kind]
        off = [ratio(row, [each for each in alike if each["asset"] != row["asset"]]) for row in alike]
        every += off
        print(f"{kind}: {fitted(alike)}; {_summary(off)}")
    print(f"all: {_summary(every)}")


def _summary(ratios: Sequence[float]) -> str:
    factors = [max(each, 1 / each) for each in ratios]
    near = 100 * np.mean(np.array(factors) < 1.5)
    return f"{len(ratios)} jobs, {near:.0f} % within 1.5, median {np.median(factors):.2f}, worst {max(factors):.1f}"


if __name__ == "__main__":
    main()
