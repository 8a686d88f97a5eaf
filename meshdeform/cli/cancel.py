"""`meshdeform cancel`: cancel jobs."""

from __future__ import annotations

import typer

from meshdeform.cli.connection import connect
from meshdeform.cli.exits import clean_errors, report
from meshdeform.cli.options import ApiKeyFileOption, ApiKeyOption, JobIdsArgument, JsonOption, UrlOption
from meshdeform.cli.output import emit
from meshdeform.errors import ConflictError, MeshdeformError, NotFoundError

__all__ = ["cancel"]


@clean_errors
def cancel(
    job_ids: JobIdsArgument,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """Cancel jobs.

    A running job stops after its current step; a job that has ended stays as it is.

    meshdeform cancel job_01kg9zqk2xf3v8c5m7n9p1r4t6
    """
    jobs, failures = [], list[MeshdeformError]()
    with connect(url, api_key, api_key_file) as client:
        for job_id in dict.fromkeys(job_ids):
            try:
                job = client.cancel(job_id)
            except (ConflictError, NotFoundError) as error:
                # Cancel the others even if one has ended or does not exist.
                failures.append(error)
                continue
            jobs.append(job)
            if not as_json:
                typer.echo(f"{job.id}  {job.state}")
    if as_json:
        emit({"jobs": [job.as_json() for job in jobs]})
    for failure in failures[:-1]:
        report(failure, as_json=as_json)
    if failures:
        raise failures[-1]
