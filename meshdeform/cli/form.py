"""Options of commands that are generated from the models of a request, when a command is first looked at.

Every parameter that is one word or number becomes an option with the name of the parameter, its help and its choices:
`steps` is `--steps`. A group of parameters, or a choice among groups, is descended into: `scale` in `guidance` is
`--guidance.scale`, and also `--scale` unless something else has that name. Parameters that are not simple are written
by NAME=VALUE (`--set`) or in the short forms of `meshdeform.cli.request`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from inspect import Parameter, Signature
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeVar, Union, get_args, get_origin

import typer

if TYPE_CHECKING:
    from pydantic import BaseModel
    from pydantic.fields import FieldInfo

from meshdeform.cli.environment import complete_models
from meshdeform.cli.help import HelpfulCommand

_F = TypeVar("_F", bound=Callable[..., None])
_META = "meshdeform.forms"
_SENTENCE = re.compile(r"(?<=[a-z0-9)])\. |(?<=[a-z0-9)]{6}): ")


@dataclass(frozen=True)
class ShortForm:
    """An option for a parameter that is a list of what is no word or number; repeatable, each text read by `read`."""

    option: str
    metavar: str
    help: str
    panel: str
    read: Callable[[str], Any]


@dataclass(frozen=True)
class Form:
    """Options for the members of one model.

    They write the member `name` of the request (`params`, `output`). The model is imported when the command is looked
    at. `only` names the members, or GROUP.MEMBER, that get an option; `hidden` those for which the command has one of
    its own; `short` the options by the last name of a parameter that is written in a short form.
    """

    name: str
    model: Callable[[], type[BaseModel]]
    panel: str
    only: Collection[str] | None = None
    hidden: Collection[str] = ()
    short: Mapping[str, Sequence[ShortForm]] = field(default_factory=dict)


@dataclass(frozen=True)
class _Leaf:
    """A parameter with an option: its path in the model, and how its text is read."""

    form: str
    path: tuple[str, ...]
    option: Any
    read: Callable[[Any], Any]


def of_kind(kind: str, panel: str = "Method", **more: Any) -> Form:
    """Return the form of the parameters of a kind of job."""

    def model() -> type[BaseModel]:
        from meshdeform.runs import kinds

        return next(each.params for each in kinds() if each.name == kind)

    return Form("params", model, panel, **more)


def of_request(name: str, panel: str, **more: Any) -> Form:
    """Return the form of a group of the request such as `output`, or of the request's own members (`job`)."""

    def model() -> type[BaseModel]:
        from meshdeform.requests.document import JobRequest, OutputParams

        return OutputParams if name == "output" else JobRequest

    return Form(name, model, panel, **more)


def form_command(*forms: Form, usual: Sequence[str] = ()) -> type[HelpfulCommand]:
    """Return a class of commands that have the options of these forms beside their own; `--help` shows the usual."""

    class Command(_FormCommand):
        FORMS = forms
        USUAL = usual

    return Command


def with_options(*forms: Form, usual: str = "") -> Callable[[_F], _F]:
    """Give a command the options of these forms beside its own; `usual` are those that `--help` shows."""

    def add(command: _F) -> _F:
        command.forms, command.usual = forms, usual.split()  # type: ignore[attr-defined]
        return command

    return add


def written(ctx: typer.Context, name: str = "params") -> dict[str, Any]:
    """Return the values of a form's options, nested as in the request, without those that were not written."""
    forms: dict[str, dict[str, Any]] = ctx.meta.get(_META, {})
    return forms.get(name, {})


def overlaid(low: Mapping[str, Any], high: Mapping[str, Any]) -> dict[str, Any]:
    """Return `low` with the members of `high` over it; groups are joined."""
    joined = dict(low)
    for name, value in high.items():
        below = joined.get(name)
        groups = isinstance(value, Mapping) and isinstance(below, Mapping)
        joined[name] = overlaid(below, value) if groups else value  # type: ignore[arg-type]
    return joined


def parameter_choices() -> dict[str, list[str]]:
    """Return the values that a deformation's parameters may have, where they are choices, without their groups."""
    from meshdeform.requests.document import DeformParams

    return {
        path[-1]: [
            str(choice.value)
            for each in _members(member.annotation)
            if isinstance(each, type) and issubclass(each, Enum)
            for choice in each
        ]
        for path, member in _fields(DeformParams, ())
    }


class _FormCommand(HelpfulCommand):
    FORMS: ClassVar[Sequence[Form]] = ()
    _leaves: list[_Leaf] | None = None

    def all_params(self, ctx: Any) -> list[Any]:
        own = super().all_params(ctx)
        if self._leaves is None:
            used = {text for option in own for text in (*option.opts, *option.secondary_opts)}
            self._leaves = [leaf for form in self.FORMS for leaf in _leaves_of(form, used)]
        return [*own[:-1], *(leaf.option for leaf in self._leaves), *own[-1:]]

    def invoke(self, ctx: Any) -> Any:
        forms: dict[str, dict[str, Any]] = {}
        for leaf in self._leaves or ():
            value = ctx.params.pop(leaf.option.name, None)
            if value is None or value == [] or value == ():
                continue
            group = forms.setdefault(leaf.form, {})
            for name in leaf.path[:-1]:
                group = group.setdefault(name, {})
            read = leaf.read(value)
            # Several options may write one list.
            group[leaf.path[-1]] = [*group.get(leaf.path[-1], ()), *read] if isinstance(read, map) else read
        ctx.meta[_META] = forms
        return super().invoke(ctx)


def _leaves_of(form: Form, used: set[str]) -> list[_Leaf]:
    leaves, infos = list[tuple[str, tuple[str, ...], Callable[[Any], Any]]](), list[Parameter]()

    def add(path: tuple[str, ...], names: list[str], info: Any, kind: Any, read: Callable[[Any], Any]) -> None:
        used.update(names)
        name = "_".join(("form", form.name, *path, str(len(leaves))))
        leaves.append((name, path, read))
        infos.append(Parameter(name, Parameter.KEYWORD_ONLY, default=info, annotation=kind | None))

    for path, member in _fields(form.model(), ()):
        if path[0] in form.hidden or (form.only is not None and not {path[0], ".".join(path)} & set(form.only)):
            continue
        for short in form.short.get(path[-1], ()):
            if short.option not in used:
                add(path, [short.option], _short_option(short), list[str], partial(map, short.read))
        kind, read = _kind_of(member)
        if kind is not None and (names := [name for name in _names(path, member) if name not in used]):
            add(path, names, _option(form, path, member, kind, names), kind, read)
    options = _click_options(infos)
    return [_Leaf(form.name, path, options[name], read) for name, path, read in leaves]


def _short_option(short: ShortForm) -> Any:
    return typer.Option(None, short.option, metavar=short.metavar, help=short.help, rich_help_panel=short.panel)


def _click_options(infos: Sequence[Parameter]) -> dict[str, Any]:
    """Return the options that typer makes of parameters of a function."""

    def nothing(**_values: Any) -> None:
        """Do nothing: only the options of this command are used."""

    nothing.__signature__ = Signature(infos)  # type: ignore[attr-defined]
    nothing.__annotations__ = {info.name: info.annotation for info in infos}
    app = typer.Typer(add_completion=False)
    app.command()(nothing)
    return {str(option.name): option for option in typer.main.get_command(app).params}


def _fields(model: type[BaseModel], above: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], FieldInfo]]:
    """Yield the parameters of a model and of the groups in it; groups of a choice may share some."""
    for name, member in model.model_fields.items():
        groups = [each for each in _members(member.annotation) if _is_model(each)]
        if not groups:
            yield (*above, name), member
        for group in groups:
            yield from _fields(group, (*above, name))


def _members(annotation: Any) -> list[Any]:
    """Return the members of a union, without None and without what annotates them."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _members(get_args(annotation)[0])
    if origin in (Union, UnionType):
        return [each for part in get_args(annotation) for each in _members(part)]
    return [] if annotation is NoneType else [annotation]


def _is_model(annotation: Any) -> bool:
    from pydantic import BaseModel

    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _kind_of(field: FieldInfo) -> tuple[Any, Callable[[Any], Any]]:
    """Return the type that the command line reads for a parameter, None if it is not simple, and what reads it."""
    members = _members(field.annotation)
    if len(members) == 1 and get_origin(members[0]) is list:
        items = _members(get_args(members[0])[0])
        return (list[str], list) if items == [str] else (None, list)
    if not members or not all(_is_word(each) for each in members):
        return None, str
    if len(members) == 1 and get_origin(members[0]) is not Literal:
        (kind,) = members
        return kind, (lambda text: getattr(text, "value", text))
    return str, _json_or_text


def _is_word(annotation: Any) -> bool:
    if get_origin(annotation) is Literal:
        return True
    return annotation in (int, float, str, bool) or (isinstance(annotation, type) and issubclass(annotation, Enum))


def _json_or_text(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _names(path: tuple[str, ...], field: FieldInfo) -> list[str]:
    """Return the names of an option: with its groups, and the short one that the schema declares or its own."""
    whole = ".".join(path).replace("_", "-")
    extra = field.json_schema_extra
    short = extra.get("x-option") if isinstance(extra, dict) else None
    return list(dict.fromkeys([f"--{whole}", f"--{short or path[-1].replace('_', '-')}"]))


def _option(form: Form, path: tuple[str, ...], field: FieldInfo, kind: Any, names: list[str]) -> Any:
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    flags = [f"{name}/--no-{name[2:]}" for name in names] if kind is bool else names
    return typer.Option(
        None,
        *flags,
        help=_help(field),
        rich_help_panel=form.panel,
        # Parameters that only presets set, and no form shows, are for experts.
        hidden="x-of-preset" in extra and "x-form" not in extra,
        autocompletion=complete_models if path[-1] == "model" else None,
    )


def _help(field: FieldInfo) -> str:
    """Return the first sentence of a description, without its marks, and the default."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", (field.description or "").replace("`", ""))
    first = _SENTENCE.split(text, maxsplit=1)[0].rstrip(".") + "."
    default = field.get_default(call_default_factory=False)
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    if "x-of-preset" in extra:
        return f"{first} Default: the preset's."
    shown = getattr(default, "value", default)
    named = isinstance(shown, int | float | str) and shown is not False and shown != ""
    return f"{first} Default: {shown}." if named else first
