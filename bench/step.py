"""Measure what a step costs, part by part, in CPU time: ``python bench/step.py [--against CHECKOUT]``.

Prints how long a step of a run with the builtin prior lasts, and each part's share of its CPU time. The parts are
timed where they are called, in the run itself: *drawing, backward* is what is left of the backward pass when the parts
that are timed apart are taken off.

With ``--against CHECKOUT`` (another working copy of Meshdeform; also this one), prints the ratio of this code's CPU
time of a step to that one's instead: two processes walk through the same steps in turns, so that what else the machine
does meets both alike.
"""

from __future__ import annotations

import argparse
import os
import pkgutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from statistics import median
from typing import Any
from unittest import mock

from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.priors import load_prior
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.devices import use_threads

WARM = 10
PARTS = {
    "network": "meshdeform.priors.builtin.prior.BuiltinPrior.predict_noise",
    "guidance": "meshdeform.guidance.sds.ScoreDistillation.loss",
    "drawing, forward": "meshdeform.rendering.shading.Renderer.render",
    "solve": "meshdeform.deformation.variables.JacobianField.solve",
    "solve, backward": "meshdeform.deformation.poisson.PoissonSystem.solve_transposed",
    "jacobian": "meshdeform.deformation.regularizers.Regularizers.jacobian",
    "laplacian": "meshdeform.deformation.regularizers.Regularizers.laplacian",
    "normal": "meshdeform.deformation.regularizers.Regularizers.normal",
    "dirichlet": "meshdeform.deformation.regularizers.Regularizers.dirichlet",
    "backward": "torch.Tensor.backward",
    "guard": "meshdeform.deformation.surface_guard.SurfaceGuard.correct",
    "optimiser": "meshdeform.deformation.variables.Adam.step",
}


class Clock:
    """CPU seconds of nested parts, each without what it calls of the others."""

    def __init__(self) -> None:
        self.taken = dict.fromkeys([*PARTS, "the rest"], 0.0)
        self._running = ["the rest"]
        self._since = time.process_time()

    def switch(self) -> None:
        now = time.process_time()
        self.taken[self._running[-1]] += now - self._since
        self._since = now

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function with its time added to a part."""

        def call(*args: Any, **kwargs: Any) -> Any:
            self.switch()
            self._running.append(name)
            try:
                return function(*args, **kwargs)
            finally:
                self.switch()
                self._running.pop()

        return call


@contextmanager
def measured() -> Iterator[Clock]:
    """Time the parts of the steps within."""
    clock = Clock()
    with ExitStack() as stack:
        for name, path in PARTS.items():
            owner, _, method = path.rpartition(".")
            holder = pkgutil.resolve_name(owner)
            stack.enter_context(mock.patch.object(holder, method, clock.timed(name, getattr(holder, method))))
        yield clock
        clock.switch()


def run_of(options: argparse.Namespace) -> Iterator[object]:
    """Return the steps of a run."""
    use_threads(options.threads)
    params = resolve(DeformParams.model_validate({"steps": 50_000, "guidance": {"orientation": "keep"}}))
    prior = load_prior("builtin", device="cpu")
    guidance = ScoreDistillation(prior, "a mushroom", guidance_scale=params.guidance_scale)
    return iter(Deformation(icosphere(4, 0.6), guidance, params))


def table(options: argparse.Namespace) -> None:
    """Print the parts of a step."""
    steps = run_of(options)
    list(islice(steps, WARM))
    begun = time.perf_counter()
    list(islice(steps, options.steps))
    wall = time.perf_counter() - begun
    with measured() as clock:
        list(islice(steps, options.steps))
    whole = sum(clock.taken.values())
    lasts = f"{options.threads} threads: a step in {wall / options.steps * 1e3:.1f} ms"
    print(f"5,120 faces, {lasts}; its CPU time:")
    print(f"{'part':<20}{'ms':>8}{'share':>8}{'/ network':>11}")
    for name, value in clock.taken.items():
        name = {"backward": "drawing, backward"}.get(name, name)
        print(
            f"{name:<20}{value / options.steps * 1e3:>8.2f}{value / whole:>8.1%}{value / clock.taken['network']:>11.2f}"
        )
    print(f"{'step':<20}{whole / options.steps * 1e3:>8.2f}{1:>8.1%}{whole / clock.taken['network']:>11.2f}")


def serve(options: argparse.Namespace) -> None:
    """Take as many steps as each line of the standard input asks for; answer with their CPU seconds."""
    steps = run_of(options)
    list(islice(steps, WARM))
    for line in sys.stdin:
        begun = time.process_time()
        list(islice(steps, int(line)))
        print(time.process_time() - begun, flush=True)


def compare(options: argparse.Namespace) -> None:
    """Print the ratio of this code's time of a step to that of another checkout, in turns of five steps."""
    sides = []
    for root in (Path(options.against), Path(__file__).parents[1]):
        command = [sys.executable, __file__, "--serve", "--threads", str(options.threads)]
        environment = {**os.environ, "PYTHONPATH": str(root.resolve())}
        sides.append(
            subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        )
    taken: list[list[float]] = []
    for _ in range(options.steps // 5):
        turn = []
        for side in sides:
            assert side.stdin is not None
            assert side.stdout is not None
            print(5, file=side.stdin, flush=True)
            turn.append(float(side.stdout.readline()))
        taken.append(turn)
    for side in sides:
        side.communicate()
    ratios = [new / old for old, new in taken]
    old, new = (sum(column) for column in zip(*taken, strict=True))
    print(f"CPU time of a step, this over {options.against}: {new / old:.3f} (median of turns {median(ratios):.3f})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--against", metavar="CHECKOUT", help="compare with this working copy")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    action = serve if options.serve else compare if options.against else table
    action(options)


if __name__ == "__main__":
    main()
