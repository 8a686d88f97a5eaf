"""Look at twelve members of every noun without its title.

    python -m bench.nouns.grids draw FOLDER [--seed SEED] [NOUN ...]    sheets of eight nouns, and FOLDER/key.json
    python -m bench.nouns.grids                                         how many were told

Whoever looks writes what each grid shows before the key is opened; names that mean the noun count. `grids.json` has of
the first look, at all nouns, what those that were not told were called, `another` name, and which were `doubted`: told
only because the list of nouns was known. These were drawn otherwise, with some more, and looked at `again` among
others. `members`: those, from 0, that do not read, of nouns that do. One grader, who knows the list.
"""

from __future__ import annotations

import argparse
import json
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from bench.keep.grades import share
from bench.label_sheets import picture, sheet
from meshdeform.nouns.families import FAMILIES
from meshdeform.reading.banks import candidate_member

LOOKED = Path(__file__).with_name("grids.json")
SEED, COUNT = 65, 12
_ON_A_SHEET = 8


def grid(noun: str, number: int) -> Image.Image:
    """Return twelve members of a noun, of all its kinds in turn, under a number."""
    members = [candidate_member(noun, each, ()) for each in range(COUNT)]
    views = [picture(one.verts, one.faces, [""] * len(one.faces), room=1.0) for one in members]
    image = sheet([view.crop((0, 0, view.height, view.height - 12)) for view in views], 6)
    ImageDraw.Draw(image).text((4, 2), str(number), "black", ImageFont.load_default(20))
    return image


def draw(folder: Path, nouns: Sequence[str], seed: int) -> None:
    """Write sheets of nouns in an order that the seed decides, and the key apart."""
    order = sorted(nouns)
    random.Random(seed).shuffle(order)
    folder.mkdir(parents=True, exist_ok=True)
    for first in range(0, len(order), _ON_A_SHEET):
        grids = [grid(noun, first + k) for k, noun in enumerate(order[first : first + _ON_A_SHEET])]
        sheet(grids, 2).save(folder / f"{first // _ON_A_SHEET:02}.png")
    (folder / "key.json").write_text(json.dumps(dict(enumerate(order))), encoding="utf-8")


def told(look: dict[str, Any], among: Sequence[str]) -> list[str]:
    """Return the nouns that were told in a look, and not doubted."""
    return [noun for noun in among if noun not in look["another"] and noun not in look["doubted"]]


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the sheets, or print what was told."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", nargs="?", choices=["draw"])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("nouns", nargs="*")
    parser.add_argument("--seed", type=int, default=SEED)
    asked = parser.parse_args(arguments)
    if asked.step:
        draw(asked.folder, asked.nouns or list(FAMILIES), asked.seed)
        return
    looked = json.loads(LOOKED.read_text(encoding="utf-8"))
    nouns, again = list(FAMILIES), looked["again"]["nouns"]
    first, second = told(looked["first"], nouns), told(looked["again"], again)
    now = {*first, *second} - (set(again) - set(second))
    print(f"at first {share(len(first), len(nouns))}; of those drawn again {share(len(second), len(again))}")
    print(f"now {share(len(now), len(nouns))}; not: {', '.join(sorted(set(nouns) - now))}")
    print(f"members that do not read: {int(np.sum([len(each) for each in looked['members'].values()]))}")


if __name__ == "__main__":
    main()
