"""Parse what says on the command line where an asset may deform: selections, regions and handles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import typer

__all__ = ["parse_handles", "parse_regions", "parse_rigid", "parse_selection"]

_MODES = ("rigid", "similarity")
_HANDLE = "vertex=NUMBER:X,Y,Z or position=X,Y,Z:X,Y,Z, with a soft handle's @WEIGHT at the end"


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
