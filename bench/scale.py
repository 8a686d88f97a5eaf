"""Measure the cost of large meshes: ``python -m bench.scale [--faces N ...] [--components N] [--steps N]``.

Each size is a bumpy sphere (or several) written as a GLB with normals and deformed from file to file by the builtin
prior ("a mushroom", preset `balanced`), in a process of its own. Prints CPU seconds:

* check: the child process of `check_asset_subprocess`, with its default limits raised to the size
* prepare: reading, welding, simplifying, factoring
* step: mean, the guard's checks included, as milliseconds and as a ratio to the first size
* snapshot: the result at a step, which places all vertices and writes a GLB
* finish: result, picture, quality measures and report
* checkpoint: megabytes; peak: resident memory of the process, including the prior and all imports
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

from bench.jobs import prior, start
from meshdeform.assets import build_glb
from meshdeform.assets.check import check_asset_subprocess
from meshdeform.assets.limits import Limits
from meshdeform.geometry.mesh import TriangleMesh, safe_normalize
from meshdeform.geometry.shapes import join
from training.shapes import box


def bumpy_sphere(faces: int) -> TriangleMesh:
    """Return a sphere with large and small bumps, of at least so many faces."""
    cube = box(math.ceil(math.sqrt(faces / 12)))
    round_ = safe_normalize(np.tan(cube.verts * math.pi / 2))
    x, y, z = round_.T
    radius = 1 + 0.03 * np.sin(20 * x) * np.sin(20 * y) * np.cos(20 * z) + 0.005 * np.sin(150 * x) * np.sin(150 * y)
    return TriangleMesh(round_ * radius[:, None], cube.faces)


def write(path: Path, faces: int, components: int) -> None:
    parts = [bumpy_sphere(faces // components) for _ in range(components)]
    shift = np.array([2.5, 0.0, 0.0])
    mesh = join(*(TriangleMesh(part.verts + k * shift, part.faces) for k, part in enumerate(parts)))
    verts = mesh.verts
    normals = verts - np.round(verts[:, :1] / 2.5) * shift
    path.write_bytes(build_glb(verts, mesh.faces, normals=normals / np.linalg.norm(normals, axis=1)[:, None]))


def measure(path: Path, steps: int) -> dict[str, float]:
    """Run one file in this process; return its figures."""
    torch.set_num_threads(1)
    limits = Limits(max_triangles=10_000_000, max_bytes=2**30)
    prior()
    found, last = {}, time.process_time()

    def lap(name: str) -> None:
        nonlocal last
        found[name], last = time.process_time() - last, time.process_time()

    document = {"prompt": "a mushroom", "params": {"preset": "balanced", "steps": steps}}
    run = start(document, {"asset": (path.read_bytes(), path.name)}, limits)
    lap("prepare")
    ran = iter(run)
    for _ in range(5):
        next(ran)
    lap("warm-up")
    for _ in ran:
        pass
    lap("steps")
    found["step_ms"] = found["steps"] / (steps - 5) * 1000
    found["checkpoint_mb"] = len(run.checkpoint()) / 1e6
    lap("checkpoint")
    run.snapshot()
    lap("snapshot")
    files = run.finish()
    lap("finish")
    report = json.loads(files["report.json"].data)
    found |= {name: float(report["quality"][name]) for name in ("flipped_faces", "self_intersecting_faces_after")}
    found["moved"] = report["movement"]["rms"]
    found["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--faces", type=int, nargs="+", default=[5_000, 100_000, 1_000_000])
    parser.add_argument("--components", type=int, default=1)
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        print(json.dumps(measure(arguments.measure, arguments.steps)))
        return
    first = 0.0
    for faces in arguments.faces:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "sphere.glb"
            write(path, faces, arguments.components)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            check_asset_subprocess(path, limits=Limits(max_triangles=10_000_000))
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            command = [sys.executable, "-m", "bench.scale", "--steps", str(arguments.steps), "--measure", str(path)]
            found = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
        found["check"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        first = first or found["step_ms"]
        found["step_ratio"] = found["step_ms"] / first
        print(f"{faces:>9}  " + "  ".join(f"{name} {value:.3g}" for name, value in found.items()), flush=True)


if __name__ == "__main__":
    main()
