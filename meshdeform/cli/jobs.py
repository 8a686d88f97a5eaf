"""`meshdeform jobs`: list the jobs of a service, newest first."""

from __future__ import annotations

from datetime import UTC, datetime
from itertools import islice
from typing import TYPE_CHECKING, Annotated

import typer

from meshdeform.cli.connection import connect
from meshdeform.cli.exits import clean_errors
from meshdeform.cli.options import ApiKeyFileOption, ApiKeyOption, JsonOption, UrlOption, complete_states
from meshdeform.cli.output import ago, duration, emit, table
from meshdeform.cli.request import parse_labels

if TYPE_CHECKING:
    from meshdeform.api.jobs import JobView

__all__ = ["jobs"]

_PAGE = 100


@clean_errors
def jobs(
    state: Annotated[
        str | None,
        typer.Option(help="Only jobs in this state, e.g. running.", autocompletion=complete_states, show_default=False),
    ] = None,
    label: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=TEXT", help="Only jobs with this label; repeatable.", show_default=False),
    ] = None,
    search: Annotated[
        str,
        typer.Option(
            metavar="WORDS", help="Only jobs whose prompt, file names or labels have these words.", show_default=False
        ),
    ] = "",
    limit: Annotated[int, typer.Option(min=1, help="At most this many.")] = 20,
    url: UrlOption = None,
    api_key: ApiKeyOption = None,
    api_key_file: ApiKeyFileOption = None,
    as_json: JsonOption = False,
) -> None:
    """List the jobs of a service, newest first.

    meshdeform jobs --state running --search "duck vase"
    """
    if state is not None and state not in (known := complete_states("")):
        raise typer.BadParameter(f"{state!r} is not one of {', '.join(known)}", param_hint="--state")
    with connect(url, api_key, api_key_file) as client:
        every = client.jobs(state=state, metadata=parse_labels(label or []), search=search, limit=min(limit, _PAGE))
        found = list(islice(every, limit))
    if as_json:
        emit({"jobs": [job.as_json() for job in found]})
        return
    titles = ("ID", "STATE", "PROGRESS", "LEFT", "CREATED", "ASSET", "PROMPT")
    now = datetime.now(UTC)
    typer.echo(table(titles, [_row(job, now) for job in found]))


def _row(job: JobView, now: datetime) -> tuple[str, ...]:
    from meshdeform.requests.prompts import prompt_words

    progress = job.progress
    left = "" if progress.eta_s is None or job.state.terminal else duration(progress.eta_s)
    created = ago((now - job.created_at).total_seconds())
    # `fraction` is less than 1 for a job that was canceled half way.
    share = f"{progress.fraction:.0%}" if progress.total_steps else ""
    goal = prompt_words(job.prompt, job.params) or (f"like {job.target.filename}" if job.target else "")
    # By the server: its workers leave such a job to those of another version.
    state = f"{job.state.value} (unreadable)" if job.unreadable else job.state.value
    return job.id, state, share, left, created, job.asset.filename, goal
