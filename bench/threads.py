"""Measure what torch's threads cost on a busy and on a quiet machine: ``python -m bench.threads [--busy N]``.

Runs the builtin prior's network, two pictures at a time, in fresh processes: on one thread, and on `--threads` with
several numbers of rounds that a waiting thread spins (``GOMP_SPINCOUNT``; none: libgomp's own). `--busy` starts that
many endless loops beside them. CPU and wall time are ratios to one thread, medians of `--rounds` runs in turn.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time

_SPINS = ["", "1000", "3000", "10000", "30000"]


def measure(threads: int, passes: int) -> None:
    """Print CPU and wall milliseconds of one pass of the network, in this process."""
    import torch

    from meshdeform.priors import load_prior
    from meshdeform.rendering.cameras import fixed_cameras

    torch.set_num_threads(threads)
    prior = load_prior("builtin", device="cpu")
    texts, cameras = prior.encode_texts("a mushroom", ""), fixed_cameras(0.0, 15.0, 40.0, fitting_radius=1.0)
    picture = torch.zeros(1, 3, 128, 128)
    for number in range(passes + 1):
        if number == 1:
            cpu, wall = time.process_time(), time.perf_counter()
        prior.predict_noise(picture, torch.tensor([700]), texts, cameras)
    print((time.process_time() - cpu) / passes * 1e3, (time.perf_counter() - wall) / passes * 1e3)


def child(threads: int, spins: str, passes: int) -> tuple[float, float]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("GOMP_", "OMP_"))}
    if spins:
        environment["GOMP_SPINCOUNT"] = spins
    command = [sys.executable, "-m", "bench.threads", "--measure", "--threads", str(threads), "--passes", str(passes)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    cpu, wall = done.stdout.split()
    return float(cpu), float(wall)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--busy", type=int, default=0, help="endless loops beside the measurement")
    parser.add_argument("--passes", type=int, default=15)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        measure(arguments.threads, arguments.passes)
        return
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(arguments.busy)]
    try:
        ways = [(1, ""), *((arguments.threads, spins) for spins in _SPINS)]
        taken: dict[tuple[int, str], list[tuple[float, float]]] = {way: [] for way in ways}
        for _ in range(arguments.rounds):
            for way in ways:
                taken[way].append(child(*way, arguments.passes))
    finally:
        for loop in loops:
            loop.kill()
    medians = {way: [statistics.median(column) for column in zip(*rows, strict=True)] for way, rows in taken.items()}
    base = medians[ways[0]]
    print(f"{arguments.busy} other programs; ratios to one thread, medians of {arguments.rounds}")
    print(f"{'threads':>8}{'spins':>10}{'CPU':>8}{'wall':>8}")
    for (threads, spins), (cpu, wall) in medians.items():
        print(f"{threads:>8}{spins or 'own':>10}{cpu / base[0]:>8.2f}{wall / base[1]:>8.2f}")


if __name__ == "__main__":
    main()
