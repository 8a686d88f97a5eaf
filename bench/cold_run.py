"""Compare `meshdeform run --preset preview`, from shell to file, with `import torch`: ``python -m bench.cold_run``.

Prints the largest resident memory of a run (of one that compiles the kernels, where none are cached), then the median
CPU time of whole processes over that of `python -c "import torch"`, in turns, one thread each, and that of a worker's
second job. With ``--worker``, only the CPU seconds of one worker's process until it is ready, and those of the start,
the steps and the end of its first and second job of five steps on an asset whose front is searched.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from statistics import median
from time import process_time

from bench.jobs import EXAMPLES, ROOT
from meshdeform.requests.document import JobRequest
from meshdeform.runs.base import job_input
from meshdeform.settings import Settings
from worker.process import torch_engine

TURNS = 4
WARM = "from bench.cold_run import jobs; print(sum(list(jobs())[2]))"


def jobs(asset: str = "sphere.glb", **params: int) -> Iterator[list[float]]:
    """Start as a worker, run two jobs on one asset, and yield the CPU time before them, then of each part of a job."""
    engine = torch_engine(Settings())
    yield [process_time()]
    from meshdeform.runs import text_deform

    request = JobRequest.model_validate({"prompt": "a mushroom", "params": {"preset": "preview", **params}})
    content = (EXAMPLES / asset).read_bytes()
    for _ in range(2):
        times = [process_time()]
        run = text_deform.start(job_input(content, asset, request, prior=engine.load_prior("builtin")))
        times.append(process_time())
        times += [process_time() for _ in run]
        run.finish()
        yield [times[1] - times[0], times[2] - times[1], times[-1] - times[2], process_time() - times[-1]]


def cpu_s(command: list[str], environment: dict[str, str]) -> float:
    """Return the CPU time of a process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def compare() -> None:
    """Print the ratios."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # installed packages have theirs
    times: dict[str, list[float]] = {"torch": [], "run": [], "warm": []}
    with tempfile.TemporaryDirectory() as folder:
        run = [sys.executable, "-P", "-m", "meshdeform", "run", str(EXAMPLES / "sphere.glb"), "a mushroom"]
        run += ["--preset", "preview", "--quiet", "--force", "-o", f"{folder}/result.glb"]
        cpu_s(run, environment)
        most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
        print(f"run: at most {most:.2f} GB of resident memory", flush=True)
        for _ in range(TURNS):
            warm = subprocess.check_output([sys.executable, "-P", "-c", WARM], env=environment).splitlines()[-1]
            torch = cpu_s([sys.executable, "-c", "import torch"], environment)
            for name, seconds in (("torch", torch), ("run", cpu_s(run, environment)), ("warm", float(warm))):
                times[name].append(seconds)
    for name in ("run", "warm"):
        print(f"{name}: {median(times[name]) / median(times['torch']):.2f} times the CPU time of import torch")


if __name__ == "__main__":
    if sys.argv[1:] == ["--worker"]:
        for what, parts in zip(("ready", "first job", "second job"), jobs("capsule.glb", steps=5), strict=True):
            print(f"{what} {sum(parts):.2f} s", *(f"{part:.2f}" for part in parts))
    else:
        compare()
