"""Count what a step does, without a clock: ``python -m bench.step_counts [--write]``.

For a sphere of 5,120 faces, the builtin prior and the defaults, on one thread:

* `preparation`: making the `Deformation`;
* `steps`: five steps after it, a check of the guard included.

Of each: `operations`, calls of torch's kernels (those that autograd makes too); `megabytes`, the sizes of their outputs
that are no views; `megaflops` of convolutions and products of matrices; `calls`, calls of functions in Python and C.
What compiled kernels (numba, QDLDL) do inside is not seen. The counts are the same on every run, so a test compares
them with ``bench/step_counts.json``, which ``--write`` makes again (`tests/unit/deformation/test_step_counts.py`).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from types import FrameType
from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves
from torch.utils.flop_counter import FlopCounterMode

from meshdeform.deformation.loop import Deformation
from meshdeform.geometry.shapes import icosphere
from meshdeform.guidance.sds import ScoreDistillation
from meshdeform.priors import load_prior
from meshdeform.requests.document import DeformParams, resolve

__all__ = ["EXPECTED", "STEPS", "count_step", "counted"]

EXPECTED = Path(__file__).with_suffix(".json")
STEPS = 5
Counts = dict[str, float]


class _Operations(TorchDispatchMode):  # type: ignore[no-untyped-call]
    """Count torch's kernels and the bytes of what they make."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.number, self.made = 0, 0

    def __torch_dispatch__(
        self, func: Any, types: Sequence[type], args: Sequence[Any] = (), kwargs: Mapping[str, Any] | None = None
    ) -> Any:
        result = func(*args, **(kwargs or {}))
        self.number += 1
        known = {t.untyped_storage().data_ptr() for t in tree_leaves((args, kwargs)) if isinstance(t, torch.Tensor)}
        for leaf in tree_leaves(result):
            if isinstance(leaf, torch.Tensor) and leaf.untyped_storage().data_ptr() not in known:
                self.made += leaf.numel() * leaf.element_size()
        return result


def counted(work: Callable[[], object], again: Callable[[], object]) -> Counts:
    """Return the counts of a piece of work.

    Parameters
    ----------
    work, again : callable
        The same work twice: once under torch's counters, which make calls of their own, and once for the calls.
    """
    operations, flops = _Operations(), FlopCounterMode(display=False)
    with flops, operations:
        work()
    calls = 0

    def count(_: FrameType, event: str, __: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    previous = sys.getprofile()
    sys.setprofile(count)
    try:
        again()
    finally:
        sys.setprofile(previous)
    return {
        "operations": operations.number,
        "megabytes": round(operations.made / 1e6, 2),
        "megaflops": round(flops.get_total_flops() / 1e6, 1),
        "calls": calls,
    }


def count_step() -> dict[str, Counts]:
    """Return the counts of the preparation and of five steps."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        prior, mesh = load_prior("builtin", device="cpu", dtype="float32"), icosphere(4, 0.6)
        params = resolve(DeformParams.model_validate({"steps": 50_000, "guidance": {"orientation": "keep"}}))
        guidance = ScoreDistillation(prior, "a mushroom", guidance_scale=params.guidance_scale)
        runs: list[Deformation] = []

        def begin() -> None:
            runs.append(Deformation(mesh, guidance, params))

        def walk(run: Deformation) -> Callable[[], object]:
            return lambda: list(islice(run, STEPS))

        # Modules loaded on first use are not counted.
        walk(
            Deformation(
                icosphere(1, 0.6),
                guidance,
                resolve(DeformParams.model_validate({"steps": STEPS, "guidance": {"orientation": "keep"}})),
            )
        )()
        preparation = counted(begin, begin)
        return {"preparation": preparation, "steps": counted(walk(runs[0]), walk(runs[1]))}
    finally:
        torch.set_num_threads(threads)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--write", action="store_true", help="make the expected counts again")
    arguments = parser.parse_args()
    found, expected = count_step(), json.loads(EXPECTED.read_text()) if EXPECTED.exists() else {}
    if arguments.write:
        EXPECTED.write_text(json.dumps({"torch": torch.__version__, **found}, indent=2) + "\n")
    print(f"{'part':<13}{'count':<12}{'found':>12}{'expected':>12}{'ratio':>8}")
    for part, counts in found.items():
        for name, value in counts.items():
            before = expected.get(part, {}).get(name)
            ratio = f"{before:>12}{value / before:>8.3f}" if before else ""
            print(f"{part:<13}{name:<12}{value:>12}{ratio}")


if __name__ == "__main__":
    main()
