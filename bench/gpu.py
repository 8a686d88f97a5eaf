"""Check and measure everything that a GPU does, in one command: ``python -m bench.gpu``.

* compares the device with the CPU (`tests/unit/devices`)
* steps of the builtin prior at 5,000, 20,000 and 80,000 triangles, on the device and on the CPU; how often a step
  waits for the device; the largest memory
* the same run on the device and on the CPU: how far the results differ
* Stable Diffusion 2.1 base of true size with random weights (`bench/true_size.py`), in bfloat16, float16 and float32

Times are the device's own. ``--device cpu --small`` goes the same way in seconds on a machine without a GPU.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import torch

from bench.true_size import Clock, build, measure, report
from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.priors import load_prior
from meshdeform.priors.stable_diffusion import StableDiffusionPrior
from meshdeform.requests.document import DeformParams, resolve

ROOT = Path(__file__).resolve().parents[1]
LEVELS = {4: "5,120", 5: "20,480", 6: "81,920"}
SEED = 1


def run(level: int, device: str, steps: int) -> Deformation:
    """Return a run of the builtin prior on a sphere."""
    guidance = ScoreDistillation(load_prior("builtin", device=device), "a mushroom", guidance_scale=7.5)
    params = resolve(DeformParams.model_validate({"steps": steps, "seed": SEED, "guidance": {"orientation": "keep"}}))
    return Deformation(icosphere(level, 0.6), guidance, params, device=device)


def waits(deformation: Deformation) -> int:
    """Return how often one step waits for the device: torch warns of each operation that does."""
    if not torch.cuda.is_available():
        return 0
    steps = iter(deformation)
    next(steps)
    torch.cuda.set_sync_debug_mode("warn")
    try:
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            next(steps)
    finally:
        torch.cuda.set_sync_debug_mode("default")
    return sum("synchroniz" in str(warning.message) for warning in found)


def steps(device: str, levels: dict[int, str], repeats: int) -> None:
    """Print milliseconds of a step on the device and the ratio to the CPU's."""
    print("\n| triangles | ms of a step | the CPU's, ratio | waits for the device | GB of the device |")
    print("|---|---|---|---|---|")
    for level, faces in levels.items():
        times = {}
        for where in (device, "cpu"):
            advance = iter(run(level, where, 10_000))
            for _ in range(3):
                next(advance)
            if where != "cpu":
                torch.cuda.synchronize()
            begun = time.perf_counter()
            for _ in range(repeats):
                next(advance)
            if where != "cpu":
                torch.cuda.synchronize()
            times[where] = (time.perf_counter() - begun) / repeats
        on_gpu = device != "cpu"
        shown = f"{1e3 * times[device]:.1f}" if on_gpu else "only a GPU's are shown"
        memory = f"{torch.cuda.max_memory_allocated() / 2**30:.2f}" if on_gpu else "-"
        count = waits(run(level, device, 10_000)) if on_gpu else 0
        print(f"| {faces} | {shown} | {times['cpu'] / times[device]:.2f} | {count} | {memory} |", flush=True)


def same_result(device: str, count: int) -> None:
    """Print how far the result of the device lies from the CPU's."""
    shapes = {}
    for where in (device, "cpu"):
        deformation = run(4, where, count)
        for _ in deformation:
            pass
        shapes[where] = deformation.verts()
    rest = torch.from_numpy(icosphere(4, 0.6).verts)
    apart = (shapes[device] - shapes["cpu"]).norm(dim=1)
    moved = (shapes["cpu"] - rest).norm(dim=1)
    print(
        f"\n{count} steps on {device} and on the CPU: vertices {float(apart.mean()):.2e} apart on average, "
        f"{float(apart.max()):.2e} at most, of {float(moved.mean()):.2e} that they moved"
    )


def stable_diffusion(device: str, model: str, peak: float, repeats: int) -> None:
    """Print the tables of a model of true size in each precision."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = str(build(model, Path(scratch)))
        for dtype in ("float32",) if device == "cpu" else ("bfloat16", "float16", "float32"):
            print()
            prior = StableDiffusionPrior(folder, device=device, dtype=dtype)
            report(prior, measure(prior, repeats), peak)


def main() -> None:
    """Check and measure a device."""
    parser = argparse.ArgumentParser(prog="python -m bench.gpu", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--small", action="store_true", help="the same way with small meshes and a tiny model")
    parser.add_argument("--peak", type=float, default=989.0, help="TFLOP/s in bfloat16 (default: an H100's or H200's)")
    options = parser.parse_args()
    if options.device != "cpu" and not torch.cuda.is_available():
        parser.error("no CUDA device was found; to go the same way without one: --device cpu --small")
    if options.device != "cpu":
        print(torch.cuda.get_device_name(options.device))
    if not options.small:
        tests = [sys.executable, "-m", "pytest", "-q", "-n0", str(ROOT / "tests" / "unit" / "devices")]
        print(f"\nThe device against the CPU: {'agrees' if not subprocess.call(tests) else 'differs, see above'}")
    Clock(torch.device(options.device)).seconds(lambda: None)
    steps(options.device, {2: "320"} if options.small else LEVELS, 2 if options.small else 50)
    same_result(options.device, 2 if options.small else 80)
    model = "tiny" if options.small else "2.1-base"
    stable_diffusion(options.device, model, options.peak, 1 if options.small else 20)


if __name__ == "__main__":
    main()
