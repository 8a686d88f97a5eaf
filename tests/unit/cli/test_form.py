"""Options that are made of the schema: each says in the request what its parameter says."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import typer
from pydantic import BaseModel, Field
from typer.testing import CliRunner

from meshdeform.cli.app import app
from meshdeform.cli.form import Form, ShortForm, form_command, overlaid, written
from meshdeform.cli.request import make_settings
from tests.cases import each_case


class Prompted(BaseModel):
    """One choice of guidance."""

    kind: Literal["sds"] = "sds"
    scale: float = Field(7.5, description="How strongly it pulls. More.")
    views: list[dict[str, float]] = Field(default_factory=list)


class Fitted(BaseModel):
    """Another."""

    kind: Literal["target"] = "target"
    align: bool = True


class Params(BaseModel):
    """Parameters with a choice among groups."""

    steps: int = Field(10, description="Iterations.")
    noun: str | None = None
    front: Literal["auto"] | float = "auto"
    tags: list[str] = Field(default_factory=list)
    guidance: Annotated[Prompted | Fitted, Field(discriminator="kind")] = Prompted()


def _view(text: str) -> dict[str, float]:
    return {"deg": float(text)}


def said(*arguments: str) -> dict[str, Any]:
    """What a command with these options reads from them."""
    read: list[dict[str, Any]] = []
    own = typer.Typer()

    seen = [ShortForm(f"--{side}", "DEG", f"A view from the {side}.", "Method", _view) for side in ("left", "right")]

    @own.command(cls=form_command(Form("params", lambda: Params, "Method", short={"views": seen})))
    def command(ctx: typer.Context) -> None:
        read.append(written(ctx))

    result = CliRunner().invoke(own, arguments)
    assert result.exit_code == 0, result.output
    return read[0]


def test_groups_and_choices_among_them_are_descended_into() -> None:
    assert said() == {}
    several = said("--steps", "3", "--noun", "12", "--front", "90", "--tags", "a", "--tags", "b")
    assert several == {"steps": 3, "noun": "12", "front": 90, "tags": ["a", "b"]}
    assert said("--guidance.kind", "target", "--no-align") == {"guidance": {"kind": "target", "align": False}}
    assert said("--scale", "9") == said("--guidance.scale", "9") == {"guidance": {"scale": 9.0}}


def test_short_forms_of_one_parameter_are_joined() -> None:
    joined = said("--right", "3", "--left", "1", "--left", "2")
    assert joined == {"guidance": {"views": [{"deg": 1}, {"deg": 2}, {"deg": 3}]}}


def test_what_is_set_by_name_may_be_in_a_group() -> None:
    assert make_settings(["a.b=1", "a.c=word", "d=[1]"]) == {"a": {"b": 1, "c": "word"}, "d": [1]}
    assert overlaid({"a": {"b": 1}, "d": 2}, {"a": {"c": 3}, "d": {"e": 4}}) == {"a": {"b": 1, "c": 3}, "d": {"e": 4}}


@each_case(("name", "command"), typer.main.get_command(app).commands.items())  # type: ignore[attr-defined]
def test_no_two_options_of_a_command_have_one_name_and_each_says_what_it_is_for(name: str, command: Any) -> None:
    options = command.get_params(typer.Context(command))
    flags = [flag for option in options for flag in (*option.opts, *option.secondary_opts)]
    assert len(flags) == len(set(flags)), name
    for leaf in getattr(command, "_leaves", None) or ():
        assert leaf.option.help, leaf.path
