"""Help as plain text of at most 80 columns, in which no name is cut. Long commands show their usual options only.

typer's own help is a table, whose columns cut the names of options in a narrow terminal.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from copy import copy
from typing import Any, ClassVar

import typer
from typer.core import TyperArgument, TyperCommand

__all__ = ["HelpfulCommand", "commands_by_panel"]

_BEGINNING = re.compile(r"(?<=[a-z0-9\")])[.:;] (?![^()]*\))")
_NAMES_WIDTH = 26
_ALL = "--help-all"
_ALWAYS = ("--json", "--quiet", _ALL, "--help")
_ARGUMENTS, _OPTIONS = "Arguments", "Options"
_PANEL = "rich_help_panel"


class HelpfulCommand(TyperCommand):
    """A command whose `--help` fits one screen, and whose `--help-all` has every option."""

    USUAL: ClassVar[Collection[str]] = ()
    """The options of `--help`; none: all are."""

    def all_params(self, ctx: Any) -> list[Any]:
        """Return the command's parameters, with `--help-all` where `--help` leaves some out."""
        own: list[Any] = super().get_params(ctx)
        return [*own[:-1], _help_all(), own[-1]] if self.USUAL and own else own

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the command's parameters."""
        params = self.all_params(ctx)
        for param in params:
            if getattr(param, "is_flag", False):
                param.metavar = ""  # help would say "<bool>" of what takes no value
        return params

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the parameters, each group with its title; what is alone in its group is among the options."""
        brief = bool(self.USUAL) and not ctx.meta.get(_ALL)
        sections: dict[str, list[tuple[str, str]]] = {_ARGUMENTS: [], _OPTIONS: []}
        for title, params in self._panels(ctx, brief=brief):
            shown = [_brief(param) if brief else _long(param) for param in params]
            rows = [row for param in shown if (row := param.get_help_record(ctx)) is not None]
            alone = brief and len(rows) == 1 and title != _ARGUMENTS
            sections.setdefault(_OPTIONS if alone else title, []).extend(rows)
        sections[_OPTIONS] = sections.pop(_OPTIONS)  # at the end, which stays on the screen
        for title, rows in sections.items():
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows, col_max=_NAMES_WIDTH)

    def _panels(self, ctx: Any, *, brief: bool) -> list[tuple[str, list[Any]]]:
        panels: dict[str, list[Any]] = {}
        last = []
        for param in self.get_params(ctx):
            title = _ARGUMENTS if isinstance(param, TyperArgument) else getattr(param, _PANEL, None) or _OPTIONS
            if title != _ARGUMENTS and set(_ALWAYS) & set(param.opts):
                last.append(param)
            elif not brief or title == _ARGUMENTS or set(self.USUAL) & set(param.opts):
                panels.setdefault(title, []).append(param)
        return [*panels.items(), *((_OPTIONS, [param]) for param in last)]


def commands_by_panel(group: Any, ctx: Any, formatter: Any) -> None:
    """Write the commands of a group, each panel with its title, and of each its first sentence."""
    panels: dict[str, list[tuple[str, str]]] = {}
    for name in group.list_commands(ctx):
        command = group.get_command(ctx, name)
        if command is not None and not command.hidden:
            rows = panels.setdefault(getattr(command, _PANEL, None) or "Commands", [])
            about = " ".join((command.help or "").strip().partition("\n\n")[0].split())
            rows.append((name, about.partition(". ")[0].rstrip(".") + "."))
    for title, rows in panels.items():
        with formatter.section(title):
            formatter.write_dl(rows)


def _brief(param: Any) -> Any:
    """Return a parameter as one screen has room for it: its shortest names, and what its help begins with."""
    shown = copy(param)
    if not isinstance(param, TyperArgument):
        words = min((name for name in param.opts if name.startswith("--")), key=len)
        shown.opts = [*(name for name in param.opts if not name.startswith("--")), words]
        shown.secondary_opts = []
    shown.help = _BEGINNING.split(param.help or "", maxsplit=1)[0].rstrip(".") + "."
    return shown


def _long(param: Any) -> Any:
    """Return a parameter without the long form of the name that turns it off, which follows from the others."""
    shown = copy(param)
    if getattr(param, "secondary_opts", None):
        shown.opts, shown.secondary_opts = [*param.opts, min(param.secondary_opts, key=len)], []
    return shown


def _help_all() -> Any:
    def show(ctx: typer.Context, wanted: bool) -> None:
        if wanted:
            ctx.meta[_ALL] = True
            typer.echo(ctx.get_help(), color=ctx.color)
            raise typer.Exit

    def nothing(
        help_all: bool = typer.Option(False, _ALL, is_eager=True, callback=show, help="Show every option."),
    ) -> None:
        """Do nothing: only its option is used."""

    app = typer.Typer(add_completion=False)
    app.command()(nothing)
    option = typer.main.get_command(app).params[0]
    option.expose_value = False
    return option
