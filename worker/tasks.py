"""What RQ calls by name: ``worker.tasks.run_job(job_id)``. Redis holds nothing but the id."""

from __future__ import annotations

from worker.runner import JobRunner

__all__ = ["run_job", "use"]

_runner: JobRunner | None = None


def use(runner: JobRunner) -> None:
    """Let this runner run the jobs of this process."""
    global _runner
    _runner = runner


def run_job(job_id: str) -> None:
    """Run one job; see `worker.runner.JobRunner.run`."""
    if _runner is None:
        raise RuntimeError("run_job is for the worker process: python -m worker.process")
    _runner.run(job_id)
