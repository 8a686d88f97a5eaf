"""The command line: `meshdeform COMMAND`, one module of `meshdeform.cli` for each.

Nothing heavy is imported before a command needs it, so `--help` answers at once. Every expected error is one line and
its advice on standard error; the exit code gives its kind (`meshdeform.cli.exits`).
"""

from __future__ import annotations

import platform
import re
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import meshdeform
from meshdeform.cli.batch import batch
from meshdeform.cli.doctor import doctor
from meshdeform.cli.exits import ExitCode, OutcomeError, report
from meshdeform.cli.form import form_command
from meshdeform.cli.help import commands_by_panel
from meshdeform.cli.inspect import inspect
from meshdeform.cli.jobs import branch, cancel, delete, fetch, jobs, retry, wait, watch
from meshdeform.cli.models import models
from meshdeform.cli.options import JsonOption
from meshdeform.cli.output import emit
from meshdeform.cli.results import animate, apply, convert
from meshdeform.cli.run import run
from meshdeform.cli.servers import api, keys, mcp, serve, worker
from meshdeform.requests.kind_folders import kind_modules, kind_table
from meshdeform.support.memory import quick_end
from meshdeform.support.threads import limit_waiting

# From the click that typer uses, which may be a copy of its own.
_UsageError: type[Exception] = typer.BadParameter.__base__ or Exception
_CHOICE = re.compile(r"'([^']*)' is not one of (.*)", re.DOTALL)
_CLIENT, _SERVICE, _MACHINE = "A service's jobs", "Running a service", "This machine"


def _message(error: Exception) -> str:
    formatted = getattr(error, "format_message", None)
    return str(formatted() if formatted else error)


def _in_plain_words(message: str) -> str:
    """Return a message about an option without the words of the libraries that read it."""
    from meshdeform.requests.problems import meant, reason

    plain = reason({"type": "value_error", "msg": message})
    if found := _CHOICE.fullmatch(plain):
        return plain.rstrip(".") + "." + meant(found[1], re.findall(r"[\w.-]+", found[2]))
    return plain


def _print_version(requested: bool) -> None:
    """Print the version and exit, for the option `--version`."""
    if requested:
        typer.echo(meshdeform.__version__)
        raise typer.Exit


def version(as_json: JsonOption = False) -> None:
    """Print the version."""
    if as_json:
        emit({"meshdeform": meshdeform.__version__, "python": platform.python_version()})
        return
    typer.echo(meshdeform.__version__)


class _Commands(TyperGroup):
    """The commands. With --json, a usage error is a problem document on standard error like every other error."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands by their panels."""
        commands_by_panel(self, ctx, formatter)

    def invoke(self, ctx: Any) -> Any:
        """Run the command; a wrong choice is named in plain words, with the one that was probably meant."""
        try:
            return super().invoke(ctx)
        except _UsageError as error:
            error.message = _in_plain_words(error.message)  # type: ignore[attr-defined]
            raise

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Run the command that the arguments name, and exit."""
        arguments = sys.argv[1:] if args is None else list(args)
        as_json = standalone_mode and "--json" in arguments
        try:
            code = super().main(
                args, prog_name, complete_var, standalone_mode and not as_json, windows_expand_args, **extra
            )
        except _UsageError as error:
            if not as_json:
                raise
            advice = "Run the command with --help to see what it takes."
            report(
                OutcomeError(ExitCode.USAGE, "usage", _message(error), advice),
                as_json=True,
            )
            code = ExitCode.USAGE
        if as_json:
            sys.exit(int(code or 0))
        return code


app = typer.Typer(
    name="meshdeform",
    cls=_Commands,
    help="Reshape 3D assets with a prompt: the same asset comes out with a new shape.\n\n"
    'On this machine: meshdeform run examples/sphere.glb "a mushroom". '
    "As a service: meshdeform serve, then run --url, jobs and fetch. To check the installation: meshdeform doctor.",
    epilog="Exit codes: 0 done, 1 internal error, 2 wrong usage, 3 bad input, 4 something required is missing, "
    "5 the job failed, 6 it was canceled or expired, 7 timed out, 8 some rows of a batch failed, 9 not authorised, "
    "10 over a limit, 130 interrupted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    pass


for _panel, _commands in {
    _MACHINE: (
        *(run, batch, apply, convert, animate),
        *(command for module in kind_modules("commands") for command in getattr(module, "COMMANDS", ())),
        *(inspect, models, doctor, version),
    ),
    _CLIENT: (watch, wait, fetch, cancel, retry, branch, delete, jobs, mcp),
    _SERVICE: (serve, api, worker),
}.items():
    for _each in _commands:
        _class = form_command(*getattr(_each, "forms", ()), usual=getattr(_each, "usual", ()))
        app.command(cls=_class, rich_help_panel=_panel)(_each)
for _name, _group in kind_table("commands", "GROUPS").items():
    app.add_typer(_group, name=_name, rich_help_panel=_MACHINE)
app.add_typer(keys, name="keys", rich_help_panel=_SERVICE)


def main() -> None:
    """Run the command that the arguments name, and exit."""
    limit_waiting()  # before a command imports torch
    with quick_end():
        app()
