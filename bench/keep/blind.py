"""Draw the results of several runs in one shuffled order, so that a person grades them without knowing whose they are.

    python -m bench.keep.blind OUT --seed 63 c23ea518=DIR now=DIR    OUT/sheets/01.png ..., OUT/key.json
    python -m bench.keep.blind OUT --grades grades.txt [--save]      tables of the grades, and `grades.json`
    python -m bench.keep.blind                                       the tables of `grades.json`

A run is a folder that `bench.keep` wrote. Each row has a number and the prompt, the source, and a result, from two
sides. `nothing` is added by itself: the source as it is. A line of the grades is `number a b c` (`bench.keep.grades`).
"""

from __future__ import annotations

import argparse
import json
import random
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw, ImageFont

from bench.keep.assets import SPLITS, listed
from bench.keep.grades import GRADES, Row, by_group, by_verdict, parsed, read, saved, table
from bench.keep.runs import verdict

NOTHING = "nothing"
_ON_A_SHEET, _COLUMNS, _SIDE, _LINE = 12, 2, 220, 20


def main() -> None:
    """Draw the sheets, or count the grades."""
    parser = argparse.ArgumentParser(description="Grade runs without knowing whose they are.")
    parser.add_argument("out", type=Path, nargs="?", help="a folder for sheets and key")
    parser.add_argument("runs", nargs="*", metavar="NAME=FOLDER")
    parser.add_argument("--seed", type=int, default=63, help="of the shuffle")
    parser.add_argument("--split", choices=SPLITS, help="only these assets")
    parser.add_argument("--grades", type=Path, help="lines `number a b c`")
    parser.add_argument("--save", action="store_true", help="write grades.json beside this module")
    asked = parser.parse_intermixed_args()
    if asked.out is None:
        _print(read(GRADES.read_text(encoding="utf-8")))
    elif asked.grades is not None:
        _count(asked.out, asked.grades, save=asked.save)
    else:
        _draw(asked.out, dict(run.split("=", 1) for run in asked.runs), asked.split, asked.seed)


def shuffled(runs: Mapping[str, Mapping[str, Mapping[str, Any]]], seed: int) -> list[Row]:
    """Return the rows of all runs and of doing nothing, in an order that the seed alone decides.

    Parameters
    ----------
    runs : mapping of a run's name to a mapping of a pair's name to its record
    seed : int
    """
    rows = {
        (name, pair): Row(name, each["asset"], each["split"], each["distance"], each["prompt"], verdict(each))
        for name, records in runs.items()
        for pair, each in records.items()
    }
    for (_, pair), row in list(rows.items()):
        rows.setdefault((NOTHING, pair), replace(row, run=NOTHING, verdict="none"))
    order = [rows[key] for key in sorted(rows)]
    random.Random(seed).shuffle(order)
    return order


def _draw(out: Path, folders: Mapping[str, str], split: str | None, seed: int) -> None:
    """Write the sheets, and apart from them what is on them."""
    runs = {name: _records(Path(folder), split) for name, folder in folders.items()}
    rows = shuffled(runs, seed)
    shown = [row for row in rows if row.verdict != "failed"]
    (out / "sheets").mkdir(parents=True, exist_ok=True)
    for first in range(0, len(shown), _ON_A_SHEET):
        tiles = [tile(first + number, row, folders) for number, row in enumerate(shown[first : first + _ON_A_SHEET], 1)]
        sheet(tiles).save(out / "sheets" / f"{first // _ON_A_SHEET + 1:02}.png")
    # Failed runs have no row on a sheet; they come after all numbers.
    rows = shown + [row for row in rows if row.verdict == "failed"]
    commits = {name: next(iter(records.values()))["commit"] for name, records in runs.items()}
    (out / "key.json").write_text(saved(seed, commits, rows))


def _records(folder: Path, split: str | None) -> dict[str, dict[str, Any]]:
    """Return the records of a run by the names of its pairs, without those of assets that are no longer listed."""
    known = {each.name for each in listed(split)}
    found = {path.parent.name: json.loads(path.read_text()) for path in sorted(folder.glob("*/record.json"))}
    return {name: record for name, record in found.items() if record["asset"] in known}


def tile(number: int, row: Row, folders: Mapping[str, str]) -> Image.Image:
    """Return one row: its number and prompt, the source, and the result, from two sides each."""
    folder = Path(folders.get(row.run) or next(iter(folders.values()))) / f"{row.asset}-{row.distance}"
    names = ("source", "source" if row.run == NOTHING else "result")
    image = Image.new("RGB", (4 * _SIDE, _SIDE + _LINE), "white")
    for place, name in enumerate(names):
        image.paste(Image.open(folder / f"{name}.png").resize((2 * _SIDE, _SIDE)), (place * 2 * _SIDE, _LINE))
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(15)
    draw.text((4, 1), f"{number}   {row.prompt}", "black", font)
    return image


def sheet(tiles: Sequence[Image.Image]) -> Image.Image:
    """Return tiles on one sheet."""
    rows = -(-len(tiles) // _COLUMNS)
    whole = Image.new("RGB", (_COLUMNS * tiles[0].width, rows * tiles[0].height), "white")
    for number, tile in enumerate(tiles):
        whole.paste(tile, (number % _COLUMNS * tile.width, number // _COLUMNS * tile.height))
    return whole


def _count(out: Path, grades: Path, *, save: bool) -> None:
    """Print the table of the grades of some sheets, and what has none."""
    key = json.loads((out / "key.json").read_text())
    rows = read((out / "key.json").read_text())
    shown = sum(row.verdict != "failed" for row in rows)
    given = parsed(grades.read_text(), shown)
    rows = [replace(row, grade=given.get(number)) for number, row in enumerate(rows, 1)]
    _print(rows)
    if missing := [number for number in range(1, shown + 1) if number not in given]:
        print(f"{len(missing)} of {shown} have no grade: {missing}")
    if save:
        GRADES.write_text(saved(key["seed"], key["commits"], rows), encoding="utf-8")


def _print(rows: Sequence[Row]) -> None:
    print(table(rows), by_group(rows), by_verdict(rows), sep="\n\n")


if __name__ == "__main__":
    main()
