"""Compare fits with `import torch`: ``python -m bench.cold_run [--against CHECKOUT]``.

Prints the largest resident memory of `meshdeform run`, from shell to file, and medians of CPU time over that of
`python -c "import torch"`, in turns, one thread each: of the whole process, and, in a process like a worker's, of a
second job with another prompt and of the same once more. `--against`: of another checkout too, in the same turns.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from collections import defaultdict
from functools import partial
from pathlib import Path
from statistics import median
from time import process_time

from bench.jobs import EXAMPLES, ROOT

TURNS = 4
FIRST, PROMPT = "a cat", "a mushroom"
WARM = f"from runpy import run_path; print(*run_path({str(Path(__file__))!r})['jobs']())"
TORCH = (sys.executable, "-c", "import torch")


def jobs() -> list[float]:
    """Run jobs in this process, which may be of another checkout, and return the CPU seconds of all but the first."""
    from meshdeform.requests.document import JobRequest
    from meshdeform.runs import text_deform
    from meshdeform.runs.base import job_input
    from meshdeform.settings import Settings
    from worker.process import torch_engine

    engine = torch_engine(Settings())
    content, times = (EXAMPLES / "sphere.glb").read_bytes(), []
    document = {}
    try:
        from meshdeform.runs.kept_readings import FolderReadings
    except ModuleNotFoundError:  # of a version that has no fits: its jobs are optimised
        prepared = partial(job_input, content, "sphere.glb", load_prior=engine.load_prior)
    else:
        document = {"params": {"guidance": {"kind": "exemplar"}}}
        readings = FolderReadings(Settings().cache_folder)
        prepared = partial(job_input, content, "sphere.glb", readings=readings)
    for prompt in (FIRST, PROMPT, PROMPT):
        request = JobRequest.model_validate({"prompt": prompt, **document})
        begun = process_time()
        run = text_deform.start(prepared(request))
        for _ in run:
            pass
        run.finish()
        times.append(process_time() - begun)
    return times[1:]


def cpu_s(command: tuple[str, ...], environment: dict[str, str]) -> float:
    """Return the CPU time of a process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, help="another checkout")
    parser.add_argument("--turns", type=int, default=TURNS)
    options = parser.parse_args()
    times: dict[str, list[float]] = defaultdict(list)
    environments = {}
    for root in (ROOT, *([options.against.absolute()] if options.against else [])):
        environments[root.name] = {**os.environ, "PYTHONPATH": str(root), "OMP_NUM_THREADS": "1"}
        environments[root.name].pop("PYTHONDONTWRITEBYTECODE", None)  # installed packages have theirs
    with tempfile.TemporaryDirectory() as folder:
        run: tuple[str, ...] = (sys.executable, "-P", "-m", "meshdeform", "run", str(EXAMPLES / "sphere.glb"), PROMPT)
        run += ("--quiet", "--force", "-o", f"{folder}/result.glb")
        for name, environment in environments.items():  # which compiles the kernels, and draws members, the first time
            cpu_s(run, environment)
            most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
            print(f"{name}: at most {most:.2f} GB of resident memory", flush=True)
        for _ in range(options.turns):
            times["torch"].append(cpu_s(TORCH, dict(os.environ)))
            for name, environment in environments.items():
                times[f"{name}: run"].append(cpu_s(run, environment))
                told = subprocess.check_output([sys.executable, "-P", "-c", WARM], env=environment).split()[-2:]
                times[f"{name}: a job with another prompt"].append(float(told[0]))
                times[f"{name}: the same again"].append(float(told[1]))
    torch = median(times.pop("torch"))
    print(f"import torch: {torch:.2f} s")
    for name, seconds in times.items():
        print(f"{name}: {median(seconds):.2f} s, {median(seconds) / torch:.2f} times import torch")


if __name__ == "__main__":
    main()
