"""Draw results of several runs of a suite in one shuffled order, so that a person grades them without knowing whose.

    python -m bench.blind --seed 7 --out sheets old=RUN new=RUN      sheets/sheet-01.png ..., sheets/key.json
    python -m bench.blind --out sheets --grades grades.txt           a table of the grades by run

Each row of a sheet is a number, the prompt, the source and a result, from two sides. `stretch` is added by itself: the
source stretched along its axes as the judge likes best. A line of the grades is: number a b c, each 0 to 5, where a:
reads as the noun, b: is still the asset, c: an artist would keep it.
"""

from __future__ import annotations

import argparse
import io
import json
import random
import statistics
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw
from training.evaluation.delivered import stretched_picture

ROWS = 12
VIEWS = (0, 1)
"""Front and left of `preview.png`, whose views are squares of half its height."""


def main() -> None:
    """Draw the sheets, or read the grades."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="*", metavar="NAME=FOLDER")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--grades", type=Path)
    given = parser.parse_args()
    if given.grades:
        print(table(given.out, given.grades))
        return
    rows = [row for run in given.runs for row in results(*run.split("=", 1))]
    rows += results("stretch", given.runs[0].split("=", 1)[1])
    random.Random(given.seed).shuffle(rows)
    given.out.mkdir(parents=True, exist_ok=True)
    for first in range(0, len(rows), ROWS):
        sheet(rows[first : first + ROWS], first + 1).save(given.out / f"sheet-{first // ROWS + 1:02d}.png")
    key = [{name: row[name] for name in ("run", "item", "prompt")} for row in rows]
    (given.out / "key.json").write_text(json.dumps({"seed": given.seed, "rows": key}, indent=1) + "\n")


def results(name: str, folder: str) -> list[dict[str, Any]]:
    """Return the rows of one run; those of `stretch` have the best stretch of each item of the run."""
    found = []
    for path in sorted(Path(folder).glob("items/*/record.json")):
        record = json.loads(path.read_text())
        if record["failed"]:
            continue
        if name == "stretch":
            picture = stretched_picture(record["source"], tuple(record["states"][-1]["kept"]["stretch"]))
        else:
            picture = (path.parent / "preview.png").read_bytes()
        found.append({"run": name, "item": path.parent.name, "prompt": record["prompt"], "picture": picture})
    return found


def sheet(rows: list[dict[str, Any]], first: int) -> Image.Image:
    """Return a sheet of rows, numbered from `first`."""
    tiles = [halves(row["picture"]) for row in rows]
    side = tiles[0][0].height
    image = Image.new("RGB", (2 * len(VIEWS) * side, (side + 18) * len(rows)), "white")
    draw = ImageDraw.Draw(image)
    for number, (row, (source, result)) in enumerate(zip(rows, tiles, strict=True)):
        top = number * (side + 18)
        draw.text((6, top + 3), f"{first + number}   {row['prompt']}", fill="black")
        image.paste(source, (0, top + 18))
        image.paste(result, (len(VIEWS) * side, top + 18))
    return image


def halves(png: bytes) -> tuple[Image.Image, Image.Image]:
    """Return the chosen views of the source and of the result, side by side."""
    picture = Image.open(io.BytesIO(png))
    side = picture.height // 2
    parts = []
    for row in range(2):
        part = Image.new("RGB", (len(VIEWS) * side, side))
        for place, view in enumerate(VIEWS):
            part.paste(picture.crop((view * side, row * side, (view + 1) * side, (row + 1) * side)), (place * side, 0))
        parts.append(part.resize((len(VIEWS) * side * 5 // 8, side * 5 // 8)))
    return parts[0], parts[1]


def table(folder: Path, grades: Path) -> str:
    """Return the means of the grades, and the shares of c >= 3 and a >= 3, by run."""
    key = json.loads((folder / "key.json").read_text())["rows"]
    by_run: dict[str, list[tuple[int, int, int]]] = {}
    for line in grades.read_text().splitlines():
        number, a, b, c = (int(part) for part in line.split()[:4])
        by_run.setdefault(key[number - 1]["run"], []).append((a, b, c))
    lines = ["| run | results | a | b | c | a >= 3 | c >= 3 |", "|---|---|---|---|---|---|---|"]
    for run, graded in sorted(by_run.items()):
        means = " | ".join(f"{statistics.fmean(each[k] for each in graded):.1f}" for k in range(3))
        shares = (statistics.fmean(each[k] >= 3 for each in graded) for k in (0, 2))
        lines.append(f"| {run} | {len(graded)} | {means} | " + " | ".join(f"{100 * s:.0f} %" for s in shares) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
