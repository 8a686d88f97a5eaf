"""Measure the verdict of runs on pairs of assets and prompts against grades by eye.

    python -m bench.verdict --runs FOLDER                         how often `good` and `keep_source` are right
    python -m bench.verdict --runs FOLDER --sheets OUT --seed 7   shuffled sheets of pictures, to grade them blindly
    python -m bench.verdict --runs FOLDER --grades grades.txt     put the grades into bench/verdict.json

`bench/verdict.json` lists the pairs and where their assets are from, by repository, commit, path and SHA-256; nothing
is fetched here. Every prompt was written before it was run. A first rule was chosen on the assets of the split
`tuning`, and tried on `first_held_out`, by the seed half of the others; then the present one was chosen on both, before
those of `held_out` were run. FOLDER has ID/report.json and ID/preview.png of each
pair, as `meshdeform run` writes them with the preset `balanced`. The verdict is computed anew from each report.

A line of grades is: ID a b c, each 0 to 5, where a: reads as what was asked for, b: is still the asset, c: an artist
who paid for it would keep it. From 3 on c counts as worth keeping.
"""

from __future__ import annotations

import argparse
import json
import math
import random
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw

from meshdeform.runs.worth import Shape, Source, of_noun, of_target, verdict_of_change
from meshdeform.verdicts import Verdict

LIST = Path(__file__).with_suffix(".json")
KEPT = 3
"""Grade c from which a result is worth keeping."""
ROWS, SIDE, CAPTION = 8, 200, 16
SPLITS = ("tuning", "first_held_out", "held_out")
VIEWS = ((0, 0), (1, 0), (0, 1), (1, 1), (2, 1), (3, 1))
"""Column and row of `preview.png`: two of the source, four of the result."""
SURE = 1.96


@dataclass(frozen=True)
class Judged:
    """A pair with its grades, and the verdict of its result."""

    pair: Mapping[str, Any]
    split: str
    value: Verdict

    @property
    def kept(self) -> bool:
        """Whether it is worth keeping by eye."""
        return bool(self.pair["grades"][2] >= KEPT)


def main() -> None:
    """Print the table, draw the sheets, or take the grades."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, required=True)
    parser.add_argument("--sheets", type=Path)
    parser.add_argument("--grades", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    listed = json.loads(LIST.read_text())
    if given.grades:
        take_grades(listed, given.grades)
    elif given.sheets:
        draw_sheets(listed["pairs"], given.runs, given.sheets, given.seed)
    else:
        print(table(judged(listed, given.runs)))


def judged(listed: Mapping[str, Any], runs: Path) -> list[Judged]:
    """Return the graded pairs that were run, with their verdicts."""
    splits = {asset["name"]: asset["split"] for asset in listed["assets"]}
    found = []
    for pair in listed["pairs"]:
        path = runs / pair["id"] / "report.json"
        if pair.get("grades") and path.is_file():
            value = Verdict(verdict_of(json.loads(path.read_text()))["value"])
            found.append(Judged(pair, splits[pair["asset"]], value))
    return found


def verdict_of(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the verdict that the rule gives a report, of whichever version."""
    quality = report["quality"]
    cuts = (quality["self_intersections_added"] or 0) / report["mesh"]["welded_faces"]
    counted = {"cut_share": cuts, "flipped_faces": quality["flipped_faces"]}
    structure = {**counted, **((report.get("verdict") or {}).get("structure") or {})}
    if report["way"] == "change":
        return verdict_of_change(structure, of_parts=all(each["part"] != "whole" for each in report["changes"]))
    shape = Shape.of(structure, quality, report["movement"], fitted="fit" in report)
    if "fit" in report:
        return of_target(report["fit"], shape)
    round_one = report["carrier"].get("mirror") == "xz"
    return of_noun(report["prompt"], report["likeness"], shape, Source(round=round_one))  # none is convex


def table(rows: Iterable[Judged]) -> str:
    """Return how often `good` and `keep_source` are right, and how much of what is worth keeping is called good."""
    graded = list(rows)
    lines = [
        "| split | way | pairs | worth keeping | good | right | of what is worth keeping | keep_source right |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for split in SPLITS:
        for way in ("prompt", "target", "all"):
            chosen = [each for each in graded if each.split == split and way in ("all", _way(each))]
            if chosen:
                lines.append(_line(split, way, chosen))
    return "\n".join(lines)


def _way(each: Judged) -> str:
    return "target" if "target" in each.pair else "prompt"


def _line(split: str, way: str, rows: list[Judged]) -> str:
    good = [each for each in rows if each.value is Verdict.GOOD]
    kept = [each for each in rows if each.kept]
    worse = [each for each in rows if each.value is Verdict.KEEP_SOURCE]
    right = sum(each.kept for each in good)
    shares = (
        share(right, len(good)),
        share(right, len(kept)),
        share(sum(not each.kept for each in worse), len(worse)),
    )
    return f"| {split} | {way} | {len(rows)} | {len(kept)} | {len(good)} | {' | '.join(shares)} |"


def share(part: int, whole: int) -> str:
    """Return a share with its Wilson interval at 95 %."""
    if not whole:
        return "-"
    rate = part / whole
    middle = rate + SURE**2 / (2 * whole)
    spread = SURE * math.sqrt(rate * (1 - rate) / whole + SURE**2 / (4 * whole**2))
    low, high = ((middle + sign * spread) / (1 + SURE**2 / whole) for sign in (-1, 1))
    return f"{part} of {whole}, {rate:.0%} ({max(low, 0):.0%} to {min(high, 1):.0%})"


def draw_sheets(pairs: Iterable[Mapping[str, Any]], runs: Path, out: Path, seed: int) -> None:
    """Draw sheets of shuffled rows: the id, what was asked for, the source, and the result."""
    rows = [pair for pair in pairs if (runs / pair["id"] / "preview.png").is_file()]
    random.Random(seed).shuffle(rows)
    out.mkdir(parents=True, exist_ok=True)
    for first in range(0, len(rows), ROWS):
        _sheet(rows[first : first + ROWS], runs).save(out / f"sheet-{first // ROWS + 1:02d}.png")


def _sheet(rows: list[Mapping[str, Any]], runs: Path) -> Image.Image:
    image = Image.new("RGB", (len(VIEWS) * SIDE, (SIDE + CAPTION) * len(rows)), "white")
    draw = ImageDraw.Draw(image)
    for number, pair in enumerate(rows):
        top = number * (SIDE + CAPTION)
        draw.text((6, top + 2), f"{pair['id']}   {pair.get('prompt', 'as the target')}", fill="black")
        picture = Image.open(runs / pair["id"] / "preview.png").convert("RGB")
        side = picture.height // 2
        for place, (column, row) in enumerate(VIEWS):
            view = picture.crop((column * side, row * side, (column + 1) * side, (row + 1) * side))
            image.paste(view.resize((SIDE, SIDE)), (place * SIDE, top + CAPTION))
    return image


def take_grades(listed: dict[str, Any], grades: Path) -> None:
    """Write the grades of a file into the list."""
    given = {line.split()[0]: [int(part) for part in line.split()[1:4]] for line in grades.read_text().splitlines()}
    for pair in listed["pairs"]:
        if pair["id"] in given:
            pair["grades"] = given[pair["id"]]
    LIST.write_text(written(listed))


def written(listed: Mapping[str, Any]) -> str:
    """Return the list as JSON, one asset or pair a line."""
    parts = [
        f' "{name}": [\n' + ",\n".join("  " + json.dumps(each, ensure_ascii=False) for each in listed[name]) + "\n ]"
        for name in ("assets", "pairs")
    ]
    return "{\n" + ",\n".join([f' "seed": {listed["seed"]}', *parts]) + "\n}\n"


if __name__ == "__main__":
    main()
