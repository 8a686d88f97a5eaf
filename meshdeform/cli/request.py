"""Build a job's request from command-line options, and read the short forms of what is not one word or number.

A text that does not have its form is a `typer.BadParameter` at its option.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from meshdeform.cli.form import ShortForm, overlaid, written
from meshdeform.errors import ParameterError
from meshdeform.requests.choices import JobKind

if TYPE_CHECKING:
    from meshdeform.requests.document import JobRequest

_MODES = ("rigid", "similarity")
_HANDLE = "vertex=NUMBER:X,Y,Z or position=X,Y,Z:X,Y,Z, with a soft handle's @WEIGHT at the end"
_ALSO = "--also"
_WEIGHT = re.compile(r"^(.*\S)\s*:\s*(\d+(?:\.\d+)?|\.\d+)$", re.DOTALL)
_OUTSIDE = "outside:"
_PICTURE = "FILE@AZIMUTH or FILE@AZIMUTH,ELEVATION or FILE@AZIMUTH,ELEVATION,FOV, in degrees, such as front.png@0"


def split_pairs(pairs: Sequence[str], option: str, form: str = "NAME=VALUE") -> Iterator[tuple[str, str]]:
    """Yield the names and values of texts of the form NAME=VALUE."""
    for pair in pairs:
        name, equals, value = pair.partition("=")
        if not equals:
            raise typer.BadParameter(f"{pair!r} is not {form}", param_hint=option)
        yield name.strip(), value


def make_settings(pairs: Sequence[str]) -> dict[str, Any]:
    """Parse parameters written as NAME=VALUE, or GROUP.NAME=VALUE; a value that is not JSON is text."""
    parameters: dict[str, Any] = {}
    for name, value in split_pairs(pairs, "--set"):
        try:
            read = json.loads(value)
        except ValueError:
            read = value
        for step in reversed(name.split(".")):
            read = {step.strip(): read}
        parameters = overlaid(parameters, read)
    return parameters


def merge_params(ctx: typer.Context, pairs: Sequence[str] | None, **options: Any) -> dict[str, Any]:
    """Return the parameters from `--set`, overridden by the options that are not None and by those of the form.

    Parameters of a deformation may be named without their group, which they are put in.
    """
    from meshdeform.requests.groups import grouped

    values = {name: value for name, value in options.items() if value is not None}
    return overlaid(overlaid(grouped(make_settings(pairs or [])), grouped(values)), written(ctx))


def parse_labels(pairs: Sequence[str]) -> dict[str, str]:
    """Parse labels written as NAME=TEXT."""
    return dict(split_pairs(pairs, "--label", "NAME=TEXT"))


def parse_targets(paths: Sequence[Path] | None) -> dict[str, Path]:
    """Return the target meshes of a job by field."""
    from meshdeform.requests.parameters import MAX_TARGETS, TARGET_FIELDS

    if len(paths or ()) > MAX_TARGETS:
        raise typer.BadParameter(f"at most {MAX_TARGETS} meshes", param_hint="--target")
    return dict(zip(TARGET_FIELDS, paths or (), strict=False))


def parse_files(pairs: Sequence[str] | None, kind: JobKind, first: Path) -> dict[str, Path]:
    """Return the files of a job by field: `first`, and those written as PART=FILE, of fields that the kind reads."""
    from meshdeform.runs import kinds

    reads = next(each for each in kinds() if each.name == kind).reads
    others = [each.name for each in reads[1:]]
    files = {reads[0].name: first}
    for pair in pairs or []:
        field, equals, path = pair.partition("=")
        field = field.strip()
        if not equals or field not in others:
            known = ", ".join(others) or "no others"
            raise typer.BadParameter(f"{pair!r} is not PART=FILE; {kind} reads {known}", param_hint="--file")
        if not Path(path).is_file():
            raise typer.BadParameter(f"{path!r} is not a file", param_hint="--file")
        files[field] = Path(path)
    if missing := [each.name for each in reads if each.required and each.name not in files]:
        raise typer.BadParameter(f"{kind} also needs {missing[0]}=FILE", param_hint="--file")
    return files


def make_request(
    prompt: str,
    params: Mapping[str, Any],
    *,
    output: Mapping[str, Any] | None = None,
    more: Mapping[str, Any] | None = None,
) -> JobRequest:
    """Build and validate a request; parameters that are None count as left out.

    `more` are further members of the document, such as `priority`.
    """
    from pydantic import ValidationError

    from meshdeform.requests.document import JobRequest
    from meshdeform.requests.groups import in_plain_words

    document = {
        "prompt": prompt,
        "params": {name: value for name, value in params.items() if value is not None},
        "output": dict(output or {}),
        **{name: value for name, value in (more or {}).items() if value is not None},
    }
    try:
        return JobRequest.model_validate(document)
    except ValidationError as error:
        problems = in_plain_words(error.errors(), JobRequest)
        sentences = [f"{'.'.join(map(str, e['loc']))}: {e['msg'].rstrip('.')}" for e in problems]
        message = "; ".join(sentences)
        raise ParameterError(
            f"The request is not valid: {message}{'' if message.endswith('?') else '.'}",
            advice="docs/parameters.md has every parameter with its bounds, docs/http.md those of other kinds.",
            errors=problems,
        ) from error


@dataclass(frozen=True)
class Pictures:
    """The pictures of a command, and their directions: the parameter `silhouettes`."""

    paths: list[Path] = field(default_factory=list)
    views: list[dict[str, float]] = field(default_factory=list)

    @property
    def files(self) -> dict[str, Path]:
        """The pictures by the names of their fields."""
        from meshdeform.requests.parameters import SILHOUETTE_FIELDS

        return dict(zip(SILHOUETTE_FIELDS, self.paths, strict=False))


def parse_pictures(texts: Sequence[str] | None) -> Pictures:
    """Parse pictures written as FILE@AZIMUTH[,ELEVATION[,FOV]]."""
    from meshdeform.requests.parameters import MAX_SILHOUETTES

    pictures = Pictures()
    for text in texts or ():
        name, _, angles = text.rpartition("@")
        path = Path(name)
        try:
            numbers = [float(part) for part in angles.split(",")]
        except ValueError:
            numbers = []
        if not name or not 1 <= len(numbers) <= 3:
            raise typer.BadParameter(f"{text!r} is not {_PICTURE}", param_hint="--silhouette")
        if not path.is_file():
            raise typer.BadParameter(f"there is no file {name}", param_hint="--silhouette")
        pictures.paths.append(path)
        pictures.views.append(dict(zip(("azimuth", "elevation", "fov"), numbers, strict=False)))
    if len(pictures.paths) > MAX_SILHOUETTES:
        raise typer.BadParameter(f"at most {MAX_SILHOUETTES} pictures", param_hint="--silhouette")
    return pictures


def read_prompt(text: str) -> dict[str, Any]:
    """Read a prompt written as PROMPT[:WEIGHT][@[outside:]PLACE=VALUE]...; several places make one region.

    What a text of this form cannot say, such as an `@` in a name, `--set prompts=` can.
    """
    first, *selections = text.split("@")
    weighted = _WEIGHT.match(first.strip())
    words, weight = (weighted[1], float(weighted[2])) if weighted else (first.strip(), None)
    if not words:
        raise typer.BadParameter(f"{text!r} has no prompt before the weight or the place", param_hint=_ALSO)
    outside = [each.strip().startswith(_OUTSIDE) for each in selections]
    if any(outside) and not all(outside):
        raise typer.BadParameter(f"{text!r}: either all places of a prompt are {_OUTSIDE} or none", param_hint=_ALSO)
    regions = [read_selection(each.strip().removeprefix(_OUTSIDE), _ALSO) for each in selections]
    return {
        "prompt": words,
        **({"weight": weight} if weight is not None else {}),
        **({"regions": regions} if regions else {}),
        **({"outside": True} if any(outside) else {}),
    }


def read_rigid(text: str) -> dict[str, Any]:
    """Read what stays rigid, written as [MODE:]PLACE=VALUE."""
    mode, colon, rest = text.partition(":")
    if not colon or mode.strip() not in _MODES:
        mode, rest = _MODES[0], text
    return {**read_selection(rest, "--rigid"), "mode": mode.strip()}


def read_region(action: str, text: str) -> dict[str, Any]:
    """Read a region of `--keep` or `--only`, written as PLACE=VALUE."""
    return {**read_selection(text, f"--{action}"), "action": action}


def read_handle(text: str) -> dict[str, Any]:
    """Read a handle written as vertex=NUMBER:X,Y,Z[@WEIGHT] or position=X,Y,Z:X,Y,Z[@WEIGHT]."""
    point, colon, goal = text.partition(":")
    to, at, weight = goal.partition("@")
    kind, _, where = point.partition("=")
    parses: Mapping[str, Callable[[str], Any]] = {"vertex": int, "position": read_point}
    parse = parses.get(kind.strip())
    if parse is None or not colon:
        raise typer.BadParameter(f"{text!r} is not {_HANDLE}", param_hint="--handle")
    try:
        return {kind.strip(): parse(where), "to": read_point(to), **({"weight": float(weight)} if at else {})}
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not {_HANDLE}", param_hint="--handle") from None


def read_selection(text: str, option: str) -> dict[str, Any]:
    """Read a selection written as PLACE=VALUE or PLACE:VALUE."""
    at = min((text.index(sign) for sign in "=:" if sign in text), default=-1)
    name, value = text[:at].strip(), text[at + 1 :].strip()
    if at < 0 or name not in _SELECTORS or not value:
        raise typer.BadParameter(f"{text!r} is not PLACE=VALUE with PLACE {', '.join(_SELECTORS)}", param_hint=option)
    form, parse = _SELECTORS[name]
    try:
        return {name: parse(value)}
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not {name}={form}", param_hint=option) from None


def read_point(text: str) -> list[float]:
    """Read X,Y,Z; ValueError: it is something else."""
    return _numbers(text, 3)


def _numbers(text: str, *counts: int) -> list[float]:
    numbers = [float(part) for part in text.split(",")]
    if len(numbers) not in counts:
        raise ValueError
    return numbers


def read_name(text: str) -> str | int:
    """Read a name, or an index if it has digits only."""
    return int(text) if text.isascii() and text.isdecimal() else text


def _joint(text: str) -> dict[str, Any]:
    name, comma, above = text.rpartition(",")
    return {"name": read_name(name), "above": float(above)} if comma else {"name": read_name(text)}


def _color(text: str) -> dict[str, Any]:
    color = _numbers(text, 3, 4)
    return {"rgb": color[:3], **({"within": color[3]} if len(color) == 4 else {})}


def _shape(text: str, *points: str, radius: bool = True) -> dict[str, Any]:
    """Read the points of these names, and a radius, as numbers one after the other."""
    numbers = _numbers(text, 3 * len(points) + radius)
    named: dict[str, Any] = {name: numbers[3 * k : 3 * k + 3] for k, name in enumerate(points)}
    return {**named, **({"radius": numbers[-1]} if radius else {})}


def _faces(text: str) -> list[Any]:
    ranges = [[int(end) for end in part.split("-")] for part in text.split(",")]
    if any(len(ends) > 2 for ends in ranges):
        raise ValueError
    return [ends[0] if len(ends) == 1 else ends for ends in ranges]


_SELECTORS: Mapping[str, tuple[str, Callable[[str], Any]]] = {
    "node": ("NAME", read_name),
    "mesh": ("NAME", read_name),
    "material": ("NAME", read_name),
    "component": ("NUMBER", int),
    "joint": ("NAME[,WEIGHT]", _joint),
    "color": ("R,G,B[,DISTANCE]", _color),
    "box": ("X,Y,Z,X,Y,Z", lambda text: _shape(text, "min", "max", radius=False)),
    "sphere": ("X,Y,Z,RADIUS", lambda text: _shape(text, "center")),
    "capsule": ("X,Y,Z,X,Y,Z,RADIUS", lambda text: _shape(text, "start", "end")),
    "faces": ("0-99,200", _faces),
}
"""The forms of values by what they select, and what reads them."""

ALSO = {
    "prompts": [
        ShortForm(
            _ALSO,
            "PROMPT[:WEIGHT][@PLACE=VALUE]",
            'A further prompt that guides at the same time: "a rabbit:0.5" everywhere, "a rabbit@sphere=0,1,0,0.4" in '
            "a region, written as for --keep, and @outside:sphere=... outside of it; repeatable.",
            "Method",
            read_prompt,
        )
    ]
}
DEFORMATION: Mapping[str, Sequence[ShortForm]] = {
    **ALSO,
    "exclude": [
        ShortForm(
            "--exclude",
            "NODE",
            "A node that is neither drawn nor deformed, such as a ground plane: its name, or its index; repeatable.",
            "Method",
            read_name,
        )
    ],
    "rigid": [
        ShortForm(
            "--rigid",
            "[MODE:]PLACE=VALUE",
            "A part that keeps its shape: node=NAME, material=NAME or component=NUMBER (see inspect); repeatable. "
            "With similarity: in front it may scale.",
            "Method",
            read_rigid,
        )
    ],
    "regions": [
        ShortForm(
            "--keep",
            "PLACE=VALUE",
            "A region that does not move: node=, mesh=, material=, joint=NAME, component=, color=R,G,B, "
            "box=X,Y,Z,X,Y,Z, sphere=X,Y,Z,RADIUS, capsule=X,Y,Z,X,Y,Z,RADIUS or faces=0-99,200; repeatable.",
            "Control",
            partial(read_region, "keep"),
        ),
        ShortForm(
            "--only",
            "PLACE=VALUE",
            "A region outside of which nothing moves, written as for --keep; repeatable.",
            "Control",
            partial(read_region, "only"),
        ),
    ],
    "handles": [
        ShortForm(
            "--handle",
            "POINT:X,Y,Z[@WEIGHT]",
            "A point of the surface, vertex=NUMBER or position=X,Y,Z, and where it goes; repeatable. "
            "With @0.5, only half of the way.",
            "Control",
            read_handle,
        )
    ],
}
