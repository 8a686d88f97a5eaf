"""Deform difficult input meshes from file to file: ``python -m bench.inputs [--steps N] [--only NAME]``.

Each input is generated (`bench/input_meshes.py`) and written as a GLB or another file (`bench/input_files.py`). The
builtin prior deforms it from start to end ("a mushroom", preset `preview`, safeguard `intersections`), and it is read
back. Prints a table and fails when an invariant of any input does.

* prepare, step: processor time of reading and preparing, and of a step, as ratios to the plain sphere of the same run
* moved: root mean square displacement over the diagonal; an input that does not move fails
* peak: resident memory of the input's process, including the prior and all imports

Times are processor times, because other processes may run; each input has its own process, for a separate peak.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import sys
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import torch

from bench.input_files import FILES
from bench.input_meshes import INPUTS, Input
from bench.jobs import prior
from meshdeform.assets import build_glb, load_asset
from meshdeform.assets.document import Document
from meshdeform.assets.limits import Limits
from meshdeform.geometry.intersections import intersecting_faces
from meshdeform.geometry.mesh import connected_components
from meshdeform.geometry.quality import measure
from meshdeform.geometry.weld import weld
from meshdeform.priors.base import Prior
from meshdeform.requests.document import JobRequest
from meshdeform.requests.groups import grouped
from meshdeform.runs import text_deform
from meshdeform.runs.base import job_input

__all__ = ["Outcome", "glb", "outcome"]


def glb(made: Input) -> bytes:
    """Return the file, with UVs, so that their return can be checked."""
    box_low = made.verts.min(0)
    uvs = (made.verts - box_low)[:, :2] / max(float(np.ptp(made.verts, axis=0).max()), 1e-300)
    data = build_glb(made.verts, made.faces, uvs=uvs, material="clay")
    if not any(made.translation):
        return FILES[made.file](data)
    document = Document.parse(data, Limits(), glb=True)
    document.root["nodes"][0]["translation"] = list(made.translation)
    return document.to_bytes()


@dataclass
class Outcome:
    """Result of one input.

    Times are of the processor; `flipped` and `cuts` count faces that were fine at rest, `broken` names the invariants
    that fail.
    """

    vertices: int = 0
    faces: int = 0
    components: int = 0
    prepare_s: float = 0.0
    step_s: float = 0.0
    moved: float = 0.0
    flipped: int = 0
    cuts: int = 0
    peak_mb: float = 0.0
    broken: list[str] = field(default_factory=list)


def outcome(made: Input, guide: Prior, steps: int, **changes: object) -> Outcome:
    """Deform an input, with `changes` to the benchmark's parameters, and check the result."""
    asset = glb(made)
    params = grouped({"preset": "preview", "steps": steps, "seed": 0, "safeguard": "intersections", **changes})
    request = JobRequest.model_validate({"prompt": "a mushroom", "params": params})
    start = time.process_time()
    run = text_deform.start(job_input(asset=asset, filename="input", request=request, prior=guide))
    prepared = time.process_time()
    for _ in run:
        pass
    stepped = time.process_time() - prepared
    artifacts = run.finish()
    found = _checked(asset, artifacts["result.glb"].data, meets=made.meets)
    found.prepare_s, found.step_s = prepared - start, stepped / steps
    found.peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return found


def _checked(asset: bytes, result: bytes, *, meets: bool) -> Outcome:
    before, after = load_asset(asset), load_asset(result)
    old, new = before.surface, after.surface
    welded = weld(old.positions, old.triangles)
    rest, faces = welded.mesh.verts, welded.mesh.faces
    found = Outcome(len(old.positions), len(old.triangles))
    labels = connected_components(welded.mesh.faces, len(rest))
    found.components = int(labels.max()) + 1
    invariants = {
        "vertex count": len(old.positions) == len(new.positions),
        "faces": np.array_equal(old.triangles, new.triangles),
        "UVs": before.texture_coordinates() == after.texture_coordinates() != {},
        "finite": bool(np.isfinite(new.positions).all()),
    }
    if all(invariants.values()):
        used = welded.vertex_map >= 0
        invariants["unreferenced vertices unmoved"] = np.array_equal(old.positions[~used], new.positions[~used])
        verts = np.zeros_like(rest)
        verts[welded.vertex_map[used]] = new.positions[used]
        radius = float(np.linalg.norm(np.ptp(rest, axis=0))) / 2
        invariants["bounds"] = bool(np.abs(verts - (rest.max(0) + rest.min(0)) / 2).max() < 3 * radius)
        found.moved = float(np.sqrt(((verts - rest) ** 2).sum(1).mean()) / (2 * radius))
        invariants["moved"] = found.moved > 1e-4
        found.flipped = measure(rest, faces, verts).flipped_faces
        part = labels[faces[:, 0]]
        alone = [faces[part == k] for k in range(found.components)] if meets else [faces]
        found.cuts = sum(int((intersecting_faces(verts, f) & ~intersecting_faces(rest, f)).sum()) for f in alone)
        invariants["flipped"], invariants["cuts"] = found.flipped == 0, found.cuts == 0
    found.broken = [name for name, held in invariants.items() if not held]
    return found


def _safely(name: str, size: float, steps: int) -> Outcome:
    try:
        return outcome(INPUTS[name](size), prior(), steps)
    except Exception as error:  # any error is a result of this input
        traceback.print_exc()
        return Outcome(broken=[f"{type(error).__name__}: {error}"])


def _outcomes(names: list[str], size: float, steps: int) -> Iterator[tuple[str, Outcome]]:
    _safely("sphere", 0.3, 2)  # so that compiling and loading at first use count for no input
    context = multiprocessing.get_context("fork")
    for name in names:
        with context.Pool(1) as pool:
            yield name, pool.apply(_safely, (name, size, steps))


def main() -> int:
    """Print the table; return 1 if an input failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument("--only", action="append", choices=list(INPUTS), help="an input; may be repeated")
    parser.add_argument("--size", type=float, default=1.0, help="less than 1 for coarser meshes")
    options = parser.parse_args()
    torch.set_num_threads(1)
    names = ["sphere", *(n for n in INPUTS if n != "sphere" and (not options.only or n in options.only))]
    print("| input | special | vertices | faces | components | prepare | step | moved | peak | checks |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    failed, base = 0, Outcome(prepare_s=1.0, step_s=1.0)
    for name, found in _outcomes(names, options.size, options.steps):
        base = found if name == "sphere" else base
        failed += bool(found.broken)
        print(
            f"| `{name}` | {INPUTS[name](0.1).special} | {found.vertices:,} | {found.faces:,} | {found.components:,} "
            f"| {found.prepare_s / base.prepare_s:.1f} | {found.step_s / base.step_s:.2f} "
            f"| {found.moved:.1%} | {found.peak_mb:.0f} MB "
            f"| {'; '.join(found.broken) or 'holds'} |",
            flush=True,
        )
    print(f"\n{len(names) - failed} of {len(names)} hold, {options.steps} steps each")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
