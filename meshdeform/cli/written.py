"""Parse the short forms in which the command line takes parameters that are not one word or number."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import typer

__all__ = [
    "Pictures",
    "parse_also",
    "parse_anchors",
    "parse_exclude",
    "parse_handles",
    "parse_pictures",
    "parse_regions",
    "parse_rigid",
    "parse_selection",
]

_MODES = ("rigid", "similarity")
_HANDLE = "vertex=NUMBER:X,Y,Z or position=X,Y,Z:X,Y,Z, with a soft handle's @WEIGHT at the end"
_ALSO = "--also"
_WEIGHT = re.compile(r"^(.*\S)\s*:\s*(\d+(?:\.\d+)?|\.\d+)$", re.DOTALL)
_OUTSIDE = "outside:"
_PICTURE = "FILE@AZIMUTH or FILE@AZIMUTH,ELEVATION or FILE@AZIMUTH,ELEVATION,FOV, in degrees, such as front.png@0"


@dataclass(frozen=True)
class Pictures:
    """The pictures of a command, and their directions.

    Attributes
    ----------
    paths : list of Path
    views : list of dict
        The parameter `silhouettes`.
    """

    paths: list[Path] = field(default_factory=list)
    views: list[dict[str, float]] = field(default_factory=list)

    @property
    def parts(self) -> dict[str, Path]:
        """The pictures by the names of their parts."""
        from meshdeform.requests.silhouettes import SILHOUETTE_PARTS

        return dict(zip(SILHOUETTE_PARTS, self.paths, strict=False))


def parse_pictures(texts: Sequence[str] | None) -> Pictures:
    """Parse pictures written as FILE@AZIMUTH[,ELEVATION[,FOV]].

    Raises
    ------
    typer.BadParameter
        A text does not have this form, there is no such file, or there are too many.
    """
    from meshdeform.requests.silhouettes import MAX_SILHOUETTES

    found = Pictures()
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
        found.paths.append(path)
        found.views.append(dict(zip(("azimuth", "elevation", "fov"), numbers, strict=False)))
    if len(found.paths) > MAX_SILHOUETTES:
        raise typer.BadParameter(f"at most {MAX_SILHOUETTES} pictures", param_hint="--silhouette")
    return found


def parse_also(texts: Sequence[str] | None) -> list[dict[str, Any]] | None:
    """Parse prompts written as PROMPT[:WEIGHT][@[outside:]PLACE=VALUE]...; None if there are none.

    Several places make one region. What a text of this form cannot say, such as an `@` in a name, `--set prompts=` can.

    Raises
    ------
    typer.BadParameter
        A text does not have this form.
    """
    return [_prompt(text) for text in texts] if texts else None


def _prompt(text: str) -> dict[str, Any]:
    first, *places = text.split("@")
    weighted = _WEIGHT.match(first.strip())
    words, weight = (weighted[1], float(weighted[2])) if weighted else (first.strip(), None)
    if not words:
        raise typer.BadParameter(f"{text!r} has no prompt before the weight or the place", param_hint=_ALSO)
    outside = [place.strip().startswith(_OUTSIDE) for place in places]
    if any(outside) and not all(outside):
        raise typer.BadParameter(f"{text!r}: either all places of a prompt are {_OUTSIDE} or none", param_hint=_ALSO)
    regions = [parse_selection(place.strip().removeprefix(_OUTSIDE), _ALSO) for place in places]
    return {
        "prompt": words,
        **({"weight": weight} if weight is not None else {}),
        **({"regions": regions} if regions else {}),
        **({"outside": True} if any(outside) else {}),
    }


def parse_exclude(texts: Sequence[str] | None) -> list[str | int] | None:
    """Parse nodes, of which those of digits are indices; None if there are none."""
    return [int(text) if text.isascii() and text.isdecimal() else text for text in texts] if texts else None


def parse_anchors(texts: Sequence[str] | None) -> list[dict[str, list[float]]] | None:
    """Parse pairs of points written as X,Y,Z:X,Y,Z; None if there are none.

    Raises
    ------
    typer.BadParameter
        A text does not have this form.
    """
    return [_anchor(text) for text in texts] if texts else None


def _anchor(text: str) -> dict[str, list[float]]:
    try:
        base, surface = (_point(point) for point in text.split(":"))
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} is not X,Y,Z:X,Y,Z", param_hint="--anchor") from error
    return {"base": base, "surface": surface}


def parse_rigid(texts: Sequence[str] | None) -> list[dict[str, Any]] | None:
    """Parse parts written as [MODE:]PLACE=VALUE; None if there are none.

    Raises
    ------
    typer.BadParameter
        A text does not have this form.
    """
    return [_rigid(text) for text in texts] if texts else None


def parse_regions(keep: Sequence[str] | None, only: Sequence[str] | None) -> list[dict[str, Any]] | None:
    """Parse the regions of `--keep` and `--only`, each written as PLACE=VALUE; None if there are none.

    Raises
    ------
    typer.BadParameter
        A text does not have this form.
    """
    given = {"keep": keep or (), "only": only or ()}
    found = [{**parse_selection(text, f"--{action}"), "action": action} for action in given for text in given[action]]
    return found or None


def parse_handles(texts: Sequence[str] | None) -> list[dict[str, Any]] | None:
    """Parse handles written as vertex=NUMBER:X,Y,Z[@WEIGHT] or position=X,Y,Z:X,Y,Z[@WEIGHT]; None if there are none.

    Raises
    ------
    typer.BadParameter
        A text does not have this form.
    """
    return [_handle(text) for text in texts] if texts else None


def _rigid(text: str) -> dict[str, Any]:
    mode, colon, rest = text.partition(":")
    if not colon or mode.strip() not in _MODES:
        mode, rest = _MODES[0], text
    return {**parse_selection(rest, "--rigid"), "mode": mode.strip()}


def parse_selection(text: str, option: str) -> dict[str, Any]:
    """Return a selection written as PLACE=VALUE or PLACE:VALUE.

    Raises
    ------
    typer.BadParameter
        The text does not have this form.
    """
    at = min((text.index(sign) for sign in "=:" if sign in text), default=-1)
    place, value = text[:at].strip(), text[at + 1 :].strip()
    parse = _PLACES.get(place)
    if at < 0 or parse is None or not value:
        raise typer.BadParameter(f"{text!r} is not PLACE=VALUE with PLACE {', '.join(_PLACES)}", param_hint=option)
    try:
        return {place: parse(value)}
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not {place}={_FORMS[place]}", param_hint=option) from None


def _handle(text: str) -> dict[str, Any]:
    point, colon, goal = text.partition(":")
    to, at, weight = goal.partition("@")
    kind, _, where = point.partition("=")
    parses: Mapping[str, Callable[[str], Any]] = {"vertex": int, "position": _point}
    parse = parses.get(kind.strip())
    if parse is None or not colon:
        raise typer.BadParameter(f"{text!r} is not {_HANDLE}", param_hint="--handle")
    try:
        return {kind.strip(): parse(where), "to": _point(to), **({"weight": float(weight)} if at else {})}
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not {_HANDLE}", param_hint="--handle") from None


def _point(text: str) -> list[float]:
    return _numbers(text, 3)


def _numbers(text: str, *counts: int) -> list[float]:
    found = [float(part) for part in text.split(",")]
    if len(found) not in counts:
        raise ValueError
    return found


def _name(text: str) -> str | int:
    return int(text) if text.isascii() and text.isdecimal() else text


def _joint(text: str) -> dict[str, Any]:
    name, comma, above = text.rpartition(",")
    return {"name": _name(name), "above": float(above)} if comma else {"name": _name(text)}


def _color(text: str) -> dict[str, Any]:
    found = _numbers(text, 3, 4)
    return {"rgb": found[:3], **({"within": found[3]} if len(found) == 4 else {})}


def _box(text: str) -> dict[str, Any]:
    found = _numbers(text, 6)
    return {"min": found[:3], "max": found[3:]}


def _sphere(text: str) -> dict[str, Any]:
    found = _numbers(text, 4)
    return {"center": found[:3], "radius": found[3]}


def _capsule(text: str) -> dict[str, Any]:
    found = _numbers(text, 7)
    return {"start": found[:3], "end": found[3:6], "radius": found[6]}


def _faces(text: str) -> list[Any]:
    ranges = [[int(end) for end in part.split("-")] for part in text.split(",")]
    if any(len(ends) > 2 for ends in ranges):
        raise ValueError
    return [ends[0] if len(ends) == 1 else ends for ends in ranges]


_PLACES: Mapping[str, Callable[[str], Any]] = {
    "node": _name,
    "mesh": _name,
    "material": _name,
    "component": int,
    "joint": _joint,
    "color": _color,
    "box": _box,
    "sphere": _sphere,
    "capsule": _capsule,
    "faces": _faces,
}
_FORMS: Mapping[str, str] = {
    "component": "NUMBER",
    "joint": "NAME[,WEIGHT]",
    "color": "R,G,B[,DISTANCE]",
    "box": "X,Y,Z,X,Y,Z",
    "sphere": "X,Y,Z,RADIUS",
    "capsule": "X,Y,Z,X,Y,Z,RADIUS",
    "faces": "0-99,200",
}
