"""Options that several commands share, with their shell completions."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from meshdeform.cli.environment import connect

if TYPE_CHECKING:
    from meshdeform.client import Client, UploadProgress

MAX_STRENGTH = 1.5
"""As `meshdeform.runs.strength` has it, which needs torch."""
_SERVICE = "Service"
_COMPLETION_TIMEOUT_S = 1.0
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]


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

    from meshdeform.cli.output import plain

    parameters = ctx.params
    with contextlib.suppress(Exception):
        where = (parameters.get("url"), parameters.get("api_key"), parameters.get("api_key_file"))
        with connect(*where, timeout_s=_COMPLETION_TIMEOUT_S, max_retries=0) as client:
            jobs = list(islice(client.jobs(limit=50), 50))
        return [(job.id, plain(f"{job.state} {job.prompt}")) for job in jobs if job.id.startswith(incomplete)]
    return []


def output_option(text: str, **more: Any) -> Any:
    """Return the option for where the result goes."""
    return typer.Option("-o", "--output", help=text, **more)


def option(text: str, panel: str | None = None, **more: Any) -> Any:
    """Return an option by its help and the panel of the command's help that shows it."""
    return typer.Option(help=text, rich_help_panel=panel, **more)


def flag(name: str, text: str, panel: str | None = None) -> Any:
    """Return an option without a value, which is off unless it is given."""
    return typer.Option(name, help=text, rich_help_panel=panel)


def file_option(text: str, panel: str | None = None) -> Any:
    """Return an option that is a file that exists."""
    return option(text, panel, exists=True, dir_okay=False, metavar="FILE")


def file_argument(text: str) -> Any:
    """Return an argument that is a file that exists."""
    return typer.Argument(help=text, exists=True, dir_okay=False)


JsonOption = Annotated[bool, flag("--json", "Print JSON, and errors as JSON on standard error.")]
ForceOption = Annotated[bool, flag("--force", "Overwrite files, whoever wrote them.")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        "--param",
        metavar="NAME=VALUE",
        help="Any other parameter (docs/parameters.md); repeatable.",
        autocompletion=complete_parameters,
        rich_help_panel="Method",
    ),
]
TimeoutOption = Annotated[float | None, option("Wait at most this many seconds.", _SERVICE, min=0.0)]
DataDirOption = Annotated[Path | None, option("Folder of the service (MESHDEFORM_DATA_DIR; default: meshdeform-data).")]
JobIdArgument = Annotated[str, typer.Argument(metavar="ID", help="The job: job_...", autocompletion=complete_job_ids)]
JobIdsArgument = Annotated[
    list[str], typer.Argument(metavar="ID...", help="The jobs: job_...", autocompletion=complete_job_ids)
]


@dataclass(frozen=True)
class Printed:
    """Options for the output of a command."""

    as_json: JsonOption = False
    quiet: QuietOption = False

    @property
    def text(self) -> bool:
        """Whether it prints its results for people."""
        return not (self.as_json or self.quiet)


@dataclass(frozen=True)
class Where:
    """The service that a command speaks to."""

    url: Annotated[
        str | None,
        option(
            "Address of the service; default: http://127.0.0.1:8765.", _SERVICE, envvar="MESHDEFORM_URL", metavar="URL"
        ),
    ] = None
    api_key: Annotated[
        str | None,
        option(
            "API key, if the service requires one. Other users of this machine can read it here: "
            "prefer the variable or a file.",
            _SERVICE,
            envvar="MESHDEFORM_API_KEY",
            # Otherwise --help would print the key of whoever has set the variable.
            show_default=False,
            show_envvar=True,
            metavar="KEY",
        ),
    ] = None
    api_key_file: Annotated[Path | None, file_option("A file with the API key.", _SERVICE)] = None

    def connect(self, on_upload: Callable[[UploadProgress], None] | None = None) -> Client:
        """Return a client of the service, which the caller closes; nothing is sent yet."""
        return connect(self.url, self.api_key, self.api_key_file, on_upload=on_upload)


@dataclass(frozen=True)
class JobWhere(Where):
    """The service that a job may run on instead of this machine."""

    # Without the variable: the address alone decides where the job runs.
    url: Annotated[
        str | None,
        option("Run the job on this service: submit it, follow it, and save its artifacts.", _SERVICE, metavar="URL"),
    ] = None
    detach: Annotated[bool, flag("--detach", "Print the id of the job, and do not wait for it.", _SERVICE)] = False
    timeout: TimeoutOption = None

    def written(self) -> dict[str, Any]:
        """Return the options that are only for a service."""
        return {"--api-key-file": self.api_key_file, "--detach": self.detach, "--timeout": self.timeout}


@dataclass(frozen=True)
class Here:
    """How a job runs on this machine."""

    device: Annotated[str | None, option("auto, cpu, cuda or cuda:N.")] = None
    threads: Annotated[int | None, option("CPU threads; 0: all cores.", min=0)] = None
    checkpoint: Annotated[
        Path | None,
        option("Save the state to this file regularly and at Ctrl-C.", "Interrupt and resume", dir_okay=False),
    ] = None
    resume: Annotated[
        Path | None, file_option("Continue from a file that --checkpoint wrote.", "Interrupt and resume")
    ] = None
    force: Annotated[bool, flag("--force", "Overwrite files that no earlier run wrote.")] = False

    def written(self) -> dict[str, Any]:
        """Return the options that are only for this machine."""
        return {f"--{each.name}": getattr(self, each.name) for each in fields(self)}
