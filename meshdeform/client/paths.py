"""Build paths of the service, escaping each of the caller's values as one segment."""

from __future__ import annotations

from urllib.parse import quote

from meshdeform.api.jobs import JobView

__all__ = ["JobLike", "artifact_path", "identity", "job_path", "segment"]

JobLike = str | JobView
"""A job, or its id."""


def identity(job: JobLike) -> str:
    """Return a job's id.

    Raises
    ------
    ValueError
        It is empty, which would address all jobs.
    """
    found = job.id if isinstance(job, JobView) else job
    if not found:
        raise ValueError("The job's id is empty.")
    return found


def segment(text: str) -> str:
    """Return a text escaped as one segment of a path."""
    quoted = quote(text, safe="")
    return {".": "%2E", "..": "%2E%2E"}.get(quoted, quoted)


def job_path(job: JobLike, *rest: str | int) -> str:
    """Return the path of a job, or of something below it."""
    return "/".join(["/v1/jobs", *(segment(str(part)) for part in (identity(job), *rest))])


def artifact_path(job: JobLike, name: str, strength: float | None = None) -> str:
    """Return the path of an artifact, with the query for another strength."""
    query = "" if strength is None else f"?strength={strength:.10g}"
    return job_path(job, "artifacts", name) + query
