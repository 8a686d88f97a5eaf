"""Fuzz the asset reader: ``python -m bench.fuzz [--minutes M | --mutants N] [--kind K] [--seed N] [--keep FOLDER]``.

Generated files are damaged in many ways (`mutations.py`) and then processed like an upload to the service: the
inspection inside the API, then the full decoding under the memory limit of the check. Accepted files are written back
in both ways and read again. The outcome must be an asset or a `MeshdeformError` with a status below 500: no other
exception, no signal, no hang, and no memory beyond the limit, which the kernel enforces.

A child process handles some hundred mutants, because one process per mutant would limit the rate to ten per second. If
it dies, the mutant that killed it is known, and the next child continues after it. Mutant `i` of a seed is always the
same: ``--seed S --only I --keep FOLDER`` recreates and saves it.
"""

from __future__ import annotations

import argparse
import collections
import faulthandler
import json
import os
import resource
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import Any

from bench.mutations import LARGEST, ROOT, corpus, mutant

MUTANT_S = 20
"""Time limit for one mutant, in seconds."""
_BATCH = 500


def outcome(name: str, data: bytes) -> str:
    """Process a file like the service and the worker; return `accepted` or the code of the refusal.

    Raises
    ------
    Exception
        A defect: anything that the service would report as a server error.
    """
    import numpy as np

    from meshdeform.assets import Limits, inspect_asset, load_asset
    from meshdeform.assets.check import has_area
    from meshdeform.errors import AssetError, MeshdeformError

    limits = Limits()
    try:
        if not data:
            return "asset_truncated"  # an empty file cannot be mapped; the check refuses it without reading
        inspect_asset(data, name, limits)
    except AssetError as error:
        return str(error.code)
    try:
        asset = load_asset(data, name, limits)
        if not has_area(asset.surface):
            return "asset_no_triangles"
    except MemoryError:
        return "asset_too_large"  # as in the check
    except MeshdeformError as error:
        if error.status >= 500:
            raise
        return str(error.code)
    surface = asset.surface
    asset.replace(surface.positions * 0.5, jacobians=np.tile(0.5 * np.eye(3), (len(surface.positions), 1, 1)))
    for morph in (False, True):
        result = asset.replace(surface.positions, surface.normals, surface.tangents, morph=morph)
        again = load_asset(result, "result.glb", Limits.unlimited()).surface
        if again.triangles.tobytes() != surface.triangles.tobytes():
            raise AssertionError("the triangles read back differ")
    return "accepted"


def child(seed: int, first: int, last: int, kind: str) -> None:
    """Process mutants `first` to `last - 1` of a kind; print each number before and each outcome after processing."""
    from meshdeform.assets import Limits
    from meshdeform.children.protocol import bound_memory

    faulthandler.enable()
    corpus()
    bound_memory(Limits().memory_bytes(LARGEST))
    signal.signal(signal.SIGALRM, signal.SIG_DFL)  # ends the process, whatever it is doing
    for number in range(first, last):
        name, data = mutant(seed, number, kind)
        print(number, end=" ", flush=True)
        signal.alarm(MUTANT_S)
        try:
            start = time.process_time()
            print(outcome(name, data), f"{time.process_time() - start:.2f}", flush=True)
        except Exception:
            print("DEFECT", json.dumps(traceback.format_exc()), flush=True)
        signal.alarm(0)
    print("peak", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024, flush=True)


def run(seed: int, *, mutants: int | None = None, seconds: float | None = None, kind: str = "") -> dict[str, Any]:
    """Run the fuzz for a number of mutants or a time.

    Returns
    -------
    `outcomes` (counts), `defects` (number, description), `peak_bytes` (the largest resident set of a child) and
    `slowest_s` (the longest time that a mutant took).
    """
    outcomes: collections.Counter[str] = collections.Counter()
    defects: list[tuple[int, str]] = []
    peak, number, slowest = 0, 0, 0.0
    end = None if seconds is None else time.monotonic() + seconds
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
    while (mutants is None or number < mutants) and (end is None or time.monotonic() < end):
        last = number + _BATCH if mutants is None else min(number + _BATCH, mutants)
        numbers = ["--seed", str(seed), "--child", str(number), str(last)]
        command = [sys.executable, "-m", "bench.fuzz", *numbers, "--kind", kind]
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        begun = number
        for line in done.stdout.splitlines():
            head, _, rest = line.partition(" ")
            if head == "peak":
                peak, begun = max(peak, int(rest)), last
            elif head.isdigit():
                begun = int(head)
                result, _, detail = rest.partition(" ")
                if result == "DEFECT":
                    defects.append((begun, json.loads(detail)))
                elif detail:
                    slowest = max(slowest, float(detail))
                outcomes[result or "DEFECT"] += 1
        if begun < last:
            defects.append((begun, f"the process ended with {done.returncode}\n{done.stderr[-3000:]}"))
            begun += 1
        number = begun
    counts = dict(outcomes.most_common())
    return {"mutants": number, "outcomes": counts, "defects": defects, "peak_bytes": peak, "slowest_s": slowest}


def main() -> int:
    """Run the fuzz and print the outcomes; return 1 if there was a defect."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--mutants", type=int, help="number of mutants, instead of a time")
    parser.add_argument("--kind", default="", help="only files of this kind: obj, ply, stl, 3mf, zip, glb or gltf")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--only", type=int, help="process one mutant, in this process")
    parser.add_argument("--keep", type=Path, help="folder for the files that revealed a defect")
    parser.add_argument("--child", type=int, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        first, last = options.child
        child(options.seed, first, last, options.kind)
        return 0
    if options.only is not None:
        found: dict[str, Any] = {"defects": [(options.only, "requested")]}
    else:
        seconds = None if options.mutants else 60 * options.minutes
        found = run(options.seed, mutants=options.mutants, seconds=seconds, kind=options.kind)
        print(
            f"seed {options.seed}: {found['mutants']} mutants, largest process {found['peak_bytes'] / 2**20:.0f} MiB, "
            f"slowest {found['slowest_s']:.1f} s of the processor"
        )
        for kind, count in found["outcomes"].items():
            print(f"{count:9}  {kind}")
    for number, what in found["defects"]:
        print(f"\nmutant {number} of seed {options.seed}: {what}")
        if options.keep:
            options.keep.mkdir(parents=True, exist_ok=True)
            name, data = mutant(options.seed, number, options.kind)
            kept = options.keep / f"{options.seed}-{number}{Path(name.replace(chr(0), '_')).suffix}"
            kept.write_bytes(data)
            print(f"saved as {kept}")
    if options.only is not None:
        print(outcome(*mutant(options.seed, options.only, options.kind)))
        return 0
    return 1 if found["defects"] else 0


if __name__ == "__main__":
    sys.exit(main())
