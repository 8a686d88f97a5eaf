"""Measure how a worker's process starts: its CPU time until it is ready, and that of its first and second job.

    OMP_NUM_THREADS=1 python -m bench.start

The jobs are five steps of `preview` on `examples/sphere.glb`. Another checkout is measured by running this file there.
"""

from __future__ import annotations

from pathlib import Path
from time import process_time

from meshdeform.requests.document import JobRequest
from meshdeform.runs.base import job_input
from meshdeform.settings import Settings
from worker.process import torch_engine

WHAT = ("preparation", "first step", "other steps", "result")
SPHERE = Path(__file__).parents[1] / "examples/sphere.glb"


def main() -> None:
    """Start, run both jobs, and print what each part took."""
    engine = torch_engine(Settings())
    print(f"ready after {process_time():.2f} s")
    from meshdeform.runs import text_deform

    request = JobRequest.model_validate({"prompt": "a mushroom", "params": {"preset": "preview", "steps": 5}})
    for name in ("first", "second"):
        times = [process_time()]
        run = text_deform.start(
            job_input(
                asset=SPHERE.read_bytes(), filename=SPHERE.name, request=request, prior=engine.load_prior("builtin")
            )
        )
        times.append(process_time())
        times += [process_time() for _ in run]
        run.finish()
        parts = (times[1] - times[0], times[2] - times[1], times[-1] - times[2], process_time() - times[-1])
        print(
            name, *(f"{what} {took:.2f} s" for what, took in zip(WHAT, parts, strict=True)), f"all {sum(parts):.2f} s"
        )


if __name__ == "__main__":
    main()
