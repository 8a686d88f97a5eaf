"""Help: one screen, of 80 columns, in which nothing is cut; all options on request; wrong choices are named plainly."""

from __future__ import annotations

from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from docs.generation.cli import parts
from meshdeform.cli.app import app
from tests.cases import each_case

SCREEN = 40
LONG = ("run", "batch", "branch")
COMMANDS = dict(parts())


def helped(name: str, option: str = "--help") -> list[str]:
    result = CliRunner().invoke(app, [*name.split(), option], env={"COLUMNS": "80"}, prog_name="meshdeform")
    assert result.exit_code == 0, result.output
    return result.output.splitlines()


@each_case("name", list(COMMANDS))
def test_help_has_every_option_uncut_in_80_columns(name: str) -> None:
    lines = helped(name, "--help-all" if name in LONG else "--help")
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert "…" not in text
    assert "<bool>" not in text
    for option in COMMANDS[name].get_params(typer.Context(COMMANDS[name])):
        if not getattr(option, "hidden", False):
            assert all(each in text for each in option.opts if each.startswith("-")), option.opts


@each_case("name", LONG)
def test_long_commands_fit_one_screen_and_say_where_the_rest_is(name: str) -> None:
    lines = helped(name)
    assert len(lines) <= SCREEN
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert "--help-all" in text
    for option in COMMANDS[name].USUAL:
        assert option in text
    assert len(helped(name, "--help-all")) > 2 * len(lines)


def test_the_list_of_commands_has_them_in_groups() -> None:
    text = "\n".join(helped(""))
    assert "This machine:" in text
    assert "<bool>" not in text
    assert all(name.partition(" ")[0] in text for name in COMMANDS)


@each_case(
    ("arguments", "said"),
    [
        (["run", "a.glb", "a vase", "--preset", "prevew"], "'balanced', 'paper'. Did you mean 'preview'?"),
        (["run", "a.glb", "a vase", "--preset", "xyz"], "'balanced', 'paper'."),
        (["run", "a.glb", "a vase", "--rig", "folow"], "Did you mean 'follow'?"),
        (["run", "a.glb", "a vase", "--kind", "famly_fit"], "Did you mean 'family_fit'?"),
        (["run", "a.glb", "a vase", "--guidance", "exmplar"], "Did you mean 'exemplar'?"),
        (["run", "a.glb", "a vase", "--set", "preset=papr"], "Did you mean 'paper'?"),
        (["run", "a.glb", "a vase", "--set", "stepz=3"], "Did you mean 'steps'?"),
        (["run", "a.glb", "a vase", "--stepz", "3"], "--steps"),
        (["jobs", "--state", "runing"], "Did you mean 'running'?"),
        (["rnu"], "Did you mean 'run'?"),
        (["keys", "lst"], "Did you mean 'list'?"),
    ],
)
def test_what_was_probably_meant_is_named(
    arguments: list[str], said: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.glb").write_bytes(b"glTF")
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code in (2, 3)
    assert said in result.output
    assert "Value error" not in result.output
    assert "GuidanceKind" not in result.output
