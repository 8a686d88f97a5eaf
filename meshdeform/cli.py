"""The command line: `meshdeform run | eval | serve | api | worker | keys | version`.

Nothing heavy is imported before a command needs it, so `--help` answers at once. Every expected error is one line and
its advice on standard error; the exit code says what kind it was (`meshdeform.commands.exits`).
"""

from __future__ import annotations

import typer

from meshdeform.commands.evaluate import evaluate
from meshdeform.commands.keys import keys
from meshdeform.commands.run import run
from meshdeform.commands.servers import api, serve, worker
from meshdeform.commands.version import version

__all__ = ["app", "main"]

app = typer.Typer(
    name="meshdeform",
    help="Deform 3D assets by text: a GLB and a prompt go in, the same asset with a new shape comes out.",
    epilog="Exit codes: 0 done, 1 internal error, 2 wrong usage, 3 bad input, "
    "4 something that is needed is not there, 130 interrupted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(run)
app.command("eval")(evaluate)
app.command()(serve)
app.command()(api)
app.command()(worker)
app.add_typer(keys, name="keys")
app.command()(version)


def main() -> None:
    """Run the command that the arguments name, and exit."""
    app()
