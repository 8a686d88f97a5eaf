"""Options that several commands share, with their shell completions."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = [
    "MAX_STRENGTH",
    "AlsoOption",
    "ApiKeyFileOption",
    "ApiKeyOption",
    "CheckpointOption",
    "DetachOption",
    "ExcludeOption",
    "ForceOption",
    "HandleOption",
    "JobIdArgument",
    "JobIdsArgument",
    "JsonOption",
    "KeepOption",
    "LabelOption",
    "OnlyOption",
    "OverwriteOption",
    "QuietOption",
    "ResumeOption",
    "RigidOption",
    "SetOption",
    "SilhouetteOption",
    "ThreadsOption",
    "TimeoutOption",
    "UrlOption",
    "complete_job_ids",
    "complete_parameters",
    "complete_states",
]

MAX_STRENGTH = 1.5
"""As `meshdeform.runs.strength` has it, which needs torch."""
_SERVICE = "Service"
_COMPLETION_TIMEOUT_S = 1.0


def complete_states(incomplete: str) -> list[str]:
    """Complete the states of a job."""
    from meshdeform.api.states import JobState

    return [state.value for state in JobState if state.value.startswith(incomplete)]


def complete_parameters(incomplete: str) -> Iterator[str]:
    """Complete names of parameters up to the `=`, then the values of those that are a choice."""
    from meshdeform.cli.form import parameter_choices

    name, equals, value = incomplete.partition("=")
    choices = parameter_choices()
    if not equals:
        yield from (f"{known}=" for known in choices if known.startswith(name))
        return
    yield from (f"{name}={choice}" for choice in choices.get(name, ()) if choice.startswith(value))


def complete_job_ids(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """Complete the newest jobs of the service if it responds within a second."""
    from itertools import islice

    from meshdeform.cli.environment import connect
    from meshdeform.cli.output import plain

    given = ctx.params
    with contextlib.suppress(Exception):
        places = (given.get("url"), given.get("api_key"), given.get("api_key_file"))
        with connect(*places, timeout_s=_COMPLETION_TIMEOUT_S, max_retries=0) as client:
            jobs = list(islice(client.jobs(limit=50), 50))
        return [(job.id, plain(f"{job.state} {job.prompt}")) for job in jobs if job.id.startswith(incomplete)]
    return []


def _set_option(**more: Any) -> Any:
    return typer.Option(
        "--set",
        "--param",
        metavar="NAME=VALUE",
        help="Any other parameter (docs/parameters.md); repeatable.",
        autocompletion=complete_parameters,
        **more,
    )


JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON, and errors as JSON on standard error.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
UrlOption = Annotated[
    str | None,
    typer.Option(
        envvar="MESHDEFORM_URL",
        metavar="URL",
        help="Address of the service; default: http://127.0.0.1:8765.",
        rich_help_panel=_SERVICE,
        show_default=False,
    ),
]
ApiKeyOption = Annotated[
    str | None,
    typer.Option(
        envvar="MESHDEFORM_API_KEY",
        # Otherwise --help would print the key of whoever has set the variable.
        show_envvar=True,
        show_default=False,
        metavar="KEY",
        help="API key, if the service requires one. Other users of this machine can read it here: "
        "prefer the variable or a file.",
        rich_help_panel=_SERVICE,
    ),
]
ApiKeyFileOption = Annotated[
    Path | None,
    typer.Option(
        exists=True, dir_okay=False, help="A file with the API key.", rich_help_panel=_SERVICE, show_default=False
    ),
]
ExcludeOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NODE",
        help="A node that is neither drawn nor deformed, such as a ground plane: its name, or its index; repeatable.",
        rich_help_panel="Method",
        show_default=False,
    ),
]
ForceOption = Annotated[bool, typer.Option("--force", help="Overwrite files, whoever wrote them.")]
RigidOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[MODE:]PLACE=VALUE",
        help="A part that keeps its shape: node=NAME, material=NAME or component=NUMBER (see inspect); repeatable. "
        "With similarity: in front it may scale.",
        rich_help_panel="Method",
        show_default=False,
    ),
]
AlsoOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PROMPT[:WEIGHT][@PLACE=VALUE]",
        help='A further prompt that guides at the same time: "a rabbit:0.5" everywhere, "a rabbit@sphere=0,1,0,0.4" in '
        "a region, written as for --keep, and @outside:sphere=... outside of it; repeatable.",
        rich_help_panel="Method",
        show_default=False,
    ),
]
KeepOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PLACE=VALUE",
        help="A region that does not move: node=, mesh=, material=, joint=NAME, component=, color=R,G,B, "
        "box=X,Y,Z,X,Y,Z, sphere=X,Y,Z,RADIUS, capsule=X,Y,Z,X,Y,Z,RADIUS or faces=0-99,200; repeatable.",
        rich_help_panel="Control",
        show_default=False,
    ),
]
OnlyOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PLACE=VALUE",
        help="A region outside of which nothing moves, written as for --keep; repeatable.",
        rich_help_panel="Control",
        show_default=False,
    ),
]
HandleOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="POINT:X,Y,Z[@WEIGHT]",
        help="A point of the surface, vertex=NUMBER or position=X,Y,Z, and where it goes; repeatable. "
        "With @0.5, only half of the way.",
        rich_help_panel="Control",
        show_default=False,
    ),
]
SilhouetteOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="FILE@AZIMUTH",
        help="A picture whose silhouette the result should have, seen from an azimuth in degrees: 0 from +Z, 90 from "
        "+X; a mask, or an object in front of a plain background; up to four. With a prompt, both guide.",
        rich_help_panel="Method",
        show_default=False,
    ),
]
SetOption = Annotated[list[str] | None, _set_option(rich_help_panel="Method", show_default=False)]
CheckpointOption = Annotated[
    Path | None,
    typer.Option(
        help="Save the state to this file regularly and at Ctrl-C.",
        dir_okay=False,
        rich_help_panel="Interrupt and resume",
        show_default=False,
    ),
]
ResumeOption = Annotated[
    Path | None,
    typer.Option(
        help="Continue from a file that --checkpoint wrote.",
        exists=True,
        dir_okay=False,
        rich_help_panel="Interrupt and resume",
        show_default=False,
    ),
]
LabelOption = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME=TEXT", help="A label of the job; repeatable.", rich_help_panel=_SERVICE),
]
DetachOption = Annotated[
    bool, typer.Option("--detach", help="Print the id of the job, and do not wait for it.", rich_help_panel=_SERVICE)
]
TimeoutOption = Annotated[
    float | None, typer.Option(min=0.0, help="Wait at most this many seconds.", rich_help_panel=_SERVICE)
]
OverwriteOption = Annotated[bool, typer.Option("--force", help="Overwrite files that no earlier run wrote.")]
ThreadsOption = Annotated[int | None, typer.Option(min=0, help="CPU threads; 0: all cores.")]
JobIdArgument = Annotated[
    str, typer.Argument(metavar="ID", help="The job: job_...", autocompletion=complete_job_ids, show_default=False)
]
JobIdsArgument = Annotated[
    list[str],
    typer.Argument(metavar="ID...", help="The jobs: job_...", autocompletion=complete_job_ids, show_default=False),
]
