"""Measure how a worker's process starts: its CPU time until it is ready, and that of its first and second job.

    OMP_NUM_THREADS=1 python -m bench.start

The jobs are five steps of `preview` on `examples/sphere.glb`. Another checkout is measured by running this file there.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from time import process_time

from meshdeform.requests.document import JobRequest
from meshdeform.runs.base import job_input
from meshdeform.settings import Settings
from worker.process import torch_engine

WHAT = ("preparation", "first step", "other steps", "result")
SPHERE = Path(__file__).parents[1] / "examples/sphere.glb"


def jobs(**params: int) -> Iterator[list[float]]:
    """Start, run both jobs, and yield the CPU time before them and then that of each part of a job."""
    engine = torch_engine(Settings())
    yield [process_time()]
    from meshdeform.runs import text_deform

    request = JobRequest.model_validate({"prompt": "a mushroom", "params": {"preset": "preview", **params}})
    for _ in range(2):
        times = [process_time()]
        run = text_deform.start(
            job_input(
                asset=SPHERE.read_bytes(), filename=SPHERE.name, request=request, prior=engine.load_prior("builtin")
            )
        )
        times.append(process_time())
        times += [process_time() for _ in run]
        run.finish()
        yield [times[1] - times[0], times[2] - times[1], times[-1] - times[2], process_time() - times[-1]]


def main() -> None:
    """Print what each part took."""
    (ready,), *both = jobs(steps=5)
    print(f"ready after {ready:.2f} s")
    for name, parts in zip(("first", "second"), both, strict=True):
        print(
            name, *(f"{what} {took:.2f} s" for what, took in zip(WHAT, parts, strict=True)), f"all {sum(parts):.2f} s"
        )


if __name__ == "__main__":
    main()
