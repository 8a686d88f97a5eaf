"""Compare `meshdeform run --preset preview`, from shell to file, with `import torch`: ``python -m bench.cold_run``.

Prints the median CPU time of whole processes over that of `python -c "import torch"`, in turns, one thread each, and
that of a worker's second job. With ``--against CHECKOUT``, a whole process of another working copy as well. Kernels are
compiled before the first turn that counts.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[1]
WARM = "from bench.start import jobs; print(sum(list(jobs())[2]))"


def environment_of(source: Path) -> dict[str, str]:
    """Return the environment of a process that imports Meshdeform from a working copy."""
    environment = {**os.environ, "PYTHONPATH": str(source), "OMP_NUM_THREADS": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # installed packages have theirs
    return environment


def cpu_s(command: list[str], source: Path) -> float:
    """Return the CPU time of a process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environment_of(source), check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description="Compare a cold run with the import of torch.")
    parser.add_argument("--turns", type=int, default=4)
    parser.add_argument("--against", type=Path, help="another working copy")
    options = parser.parse_args()
    sources = {"this": ROOT, **({"other": options.against.resolve()} if options.against else {})}
    times: dict[str, list[float]] = {name: [] for name in ("torch", *sources, "warm")}
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(options.turns + 1):
            taken = {"torch": cpu_s([sys.executable, "-c", "import torch"], ROOT)}
            for name, source in sources.items():
                run = [sys.executable, "-P", "-m", "meshdeform", "run", str(ROOT / "examples/sphere.glb"), "a mushroom"]
                more = ["--preset", "preview", "--quiet", "--force", "-o", f"{folder}/{name}.glb"]
                taken[name] = cpu_s([*run, *more], source)
            warm = [sys.executable, "-P", "-c", WARM]
            taken["warm"] = float(subprocess.check_output(warm, env=environment_of(ROOT)).splitlines()[-1])
            for name, seconds in taken.items():
                times[name] += [seconds] if turn else []
    for name in (*sources, "warm"):
        print(f"{name}: {median(times[name]) / median(times['torch']):.2f} times the CPU time of import torch")


if __name__ == "__main__":
    main()
