"""Count the grades of `grades.json`, which a person gave from the sheets.

{split: {way: {"code": digest, "grades": {asset: {part: grade}}}}}: `given` is the way with noun and front given,
`alone` without. Every part that `assets.json` lists has a grade:

    2     this part, and little else
    1     recognisably this part, with much of it missing or much too much
    0     not found
    0w    something carries its name and is another thing

Right is the share of parts with 2, half that with 1, wrong that with 0w, and points are the sum of grades over twice
the number of parts. What was found and is not listed counts nowhere. A part that is listed under a word that says the
same (`stem` of a lamp for its pole, `crown` of a tree for its leaves) is found; under a name that only its author would
know (`second glass` for a shelf), or in pieces (thighs and shins beside the rest of the legs), it is half found.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from bench.parts.assets import Listed, listed

GRADES = Path(__file__).with_name("grades.json")
_POINTS = {"2": 2, "1": 1, "0": 0, "0w": 0}
_ROOT = Path(__file__).resolve().parents[2] / "meshdeform"
_DECIDE = ("reading", "nouns", "plain")


@dataclass(frozen=True)
class Share:
    """How many parts were found."""

    parts: int
    right: float
    half: float
    wrong: float
    points: float


def code_digest() -> str:
    """Return twelve digits of the SHA-256 of the code that finds parts."""
    every = hashlib.sha256()
    for path in sorted(each for folder in _DECIDE for each in (_ROOT / folder).rglob("*.py")):
        every.update(path.relative_to(_ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return every.hexdigest()[:12]


def share(grades: Iterable[str]) -> Share:
    """Return the shares of grades. Raises KeyError: one is none of the four; ValueError: there are none."""
    counted = Counter(grades)
    total = counted.total()
    if not total:
        raise ValueError("there are no grades")
    points = sum(_POINTS[grade] * count for grade, count in counted.items())
    return Share(total, counted["2"] / total, counted["1"] / total, counted["0w"] / total, points / (2 * total))


def ungraded(grades: dict[str, dict[str, str]], assets: Iterable[Listed]) -> list[str]:
    """Return what is listed and has no grade, or has one and is not listed."""
    wanted = {(each.name, part) for each in assets for part in each.parts}
    given = {(name, part) for name, parts in grades.items() for part in parts}
    return [f"{name}: {part}" for name, part in sorted(wanted ^ given)]


def print_table() -> None:
    """Print the shares of each split and way, and what lacks a grade."""
    now = code_digest()
    print(f"{'split':6} {'way':6} parts  right  half  wrong  points  code")
    for split, ways in json.loads(GRADES.read_text()).items():
        for way, kept in ways.items():
            of = share(grade for parts in kept["grades"].values() for grade in parts.values())
            known = "as it stands" if kept["code"] == now else "older"
            print(
                f"{split:6} {way:6} {of.parts:5} {of.right:6.1%} {of.half:5.1%} {of.wrong:6.1%} {of.points:7.1%}"
                f"  {kept['code']} ({known})"
            )
            for each in ungraded(kept["grades"], listed(split)):
                print(f"  not as listed: {each}")
