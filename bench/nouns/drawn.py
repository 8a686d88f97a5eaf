"""Make forty nouns, drawn by a seed from those after the first 149, from a sphere and from a real asset each.

    python -m bench.nouns.drawn                               the nouns, as `SEED` draws them
    python -m bench.nouns.drawn run FOLDER OUT                the runs, as a user would
    python -m bench.nouns.drawn sheets OUT                    OUT/sphere.png ..., OUT/asset-1.png ..., OUT/key.json
    python -m bench.nouns.drawn count OUT named.txt grades.txt    `drawn_grades.json`
    python -m bench.nouns.drawn tables                            what they come to

`drawn.json` has an asset of a plausible kind for each noun, by authors that nothing here was made with; seed and assets
were committed before any of them was run. FOLDER has the files, wherever in it, beside what they refer to. `titles` are
three nouns for which a result from a sphere may be taken: its tile has four titles in an order that the seed alone
decides, and whoever looks writes `number title`, or `number -` for what reads as none. Rows of assets are mixed with
the assets as they are; their grades are those of `bench.keep`: a, it reads as the noun, b, it is still the asset, c, an
artist would keep it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from PIL import Image, ImageDraw, ImageFont

from bench.keep.assets import Pair
from bench.keep.blind import NOTHING, sheet, shuffled, tile
from bench.keep.grades import KEPT, parsed, read, saved, share
from bench.keep.runs import ROOT, Code, ran
from bench.parts.assets import Listed
from meshdeform.assets import Limits
from meshdeform.assets.bundle import read_with_files
from meshdeform.priors.builtin.vocabulary import NOUNS as FIRST
from meshdeform.vocabulary.nouns import NOUNS

SEED, COUNT = 65, 40
READS = 3
"""The least `a` of what reads as its noun."""
GRADES = Path(__file__).with_name("drawn_grades.json")
_LIST = Path(__file__).with_name("drawn.json")
_SPHERE = ROOT / "examples" / "sphere.glb"
_ON_A_SHEET, _SIDE = 12, 200
_STEPS = {"run": ("folder", "out"), "sheets": ("out",), "count": ("out", "named", "grades"), "tables": ()}
"""What the command does, with the paths that it needs."""


def drawn() -> list[str]:
    """Return the nouns that the seed draws, by the alphabet."""
    return sorted(random.Random(SEED).sample(sorted(set(NOUNS) - set(FIRST)), COUNT))


def _entries() -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = json.loads(_LIST.read_text(encoding="utf-8"))
    return entries


def _assets() -> list[Listed]:
    """Return the assets, named for the noun that is asked of them."""
    return [Listed(**{key: each[key] for key in each if key != "titles"}) for each in _entries()]


def _run(folder: Path, out: Path) -> None:
    """Run each noun from the sphere and on its asset, and print a line for each."""
    files = {hashlib.sha256(path.read_bytes()).hexdigest(): path for path in folder.rglob("*") if path.is_file()}
    code = Code.of(ROOT)
    (out / "assets").mkdir(parents=True, exist_ok=True)
    for asset in _assets():
        path = files[asset.sha256]
        packed = out / "assets" / f"{asset.name}{path.suffix.replace('.gltf', '.glb')}"
        packed.write_bytes(read_with_files(path, Limits.unlimited()))
        for kind, source in (("sphere", _SPHERE), ("asset", packed)):
            pair = Pair(replace(asset, front=0.0 if kind == "sphere" else asset.front), "near")
            record = ran(pair, source, out / kind / pair.name, code, None)
            print(f"{kind:6} {asset.name:12} {record['cpu_seconds']:6.1f} s  {record['problem'] or ''}", flush=True)


def _records(out: Path, kind: str) -> dict[str, dict[str, Any]]:
    return {path.parent.name: json.loads(path.read_text()) for path in sorted((out / kind).glob("*/record.json"))}


def titles() -> list[tuple[str, list[str]]]:
    """Return the nouns in the order of the sphere's tiles, each with the titles to choose from."""
    chance = random.Random(SEED)
    rows = [(each["name"], [each["name"], *each["titles"]]) for each in _entries()]
    chance.shuffle(rows)
    for _, four in rows:
        chance.shuffle(four)
    return rows


def _sheets(out: Path) -> None:
    """Write the sheets, and apart from those of the assets what is on them."""
    tiles = []
    for number, (noun, four) in enumerate(titles(), 1):
        image = Image.new("RGB", (2 * _SIDE, _SIDE + 20), "white")
        view = Image.open(out / "sphere" / f"{noun}-near" / "result.png")
        image.paste(view.resize((2 * _SIDE, _SIDE)), (0, 20))
        ImageDraw.Draw(image).text((4, 1), f"{number}  {' '.join(four)}", "black", ImageFont.load_default(15))
        tiles.append(image)
    for first in range(0, len(tiles), _ON_A_SHEET):
        sheet(tiles[first : first + _ON_A_SHEET]).save(out / f"sphere-{first // _ON_A_SHEET + 1}.png")
    records = _records(out, "asset")
    rows = shuffled({"now": records}, SEED)
    rows = [row for row in rows if row.verdict != "failed"]
    folders = {"now": str(out / "asset")}
    tiles = [tile(number, row, folders) for number, row in enumerate(rows, 1)]
    for first in range(0, len(tiles), _ON_A_SHEET):
        sheet(tiles[first : first + _ON_A_SHEET]).save(out / f"asset-{first // _ON_A_SHEET + 1}.png")
    (out / "key.json").write_text(saved(SEED, {"now": next(iter(records.values()))["commit"]}, rows))


def _count(out: Path, named: Path, grades: Path) -> None:
    """Save what was named from a sphere, and the grades of the assets."""
    said = dict(line.split()[:2] for line in named.read_text().splitlines() if line.strip())
    key = json.loads((out / "key.json").read_text())
    rows = read((out / "key.json").read_text())
    given = parsed(grades.read_text(), len(rows))
    rows = [replace(row, grade=given[number]) for number, row in enumerate(rows, 1)]
    told = {noun: said.get(str(number), "-") for number, (noun, _) in enumerate(titles(), 1)}
    document = saved(SEED, key["commits"], rows).replace("{\n", f'{{\n "named": {json.dumps(told)},\n', 1)
    GRADES.write_text(document, encoding="utf-8")


def _tables() -> None:
    """Print how many are recognised, and how the assets are graded."""
    document = GRADES.read_text(encoding="utf-8")
    named, rows = json.loads(document)["named"], read(document)
    right = [noun for noun, said in named.items() if said == noun]
    print(f"from a sphere: {share(len(right), COUNT)}; not: {', '.join(sorted(set(named) - set(right)))}")
    for run in ("now", NOTHING):
        those = [row for row in rows if row.run == run and row.grade]
        for verdict in dict.fromkeys(["", *(row.verdict for row in those)]):
            graded = [(row.asset, row.grade) for row in those if row.grade and verdict in ("", row.verdict)]
            reads = [noun for noun, grade in graded if grade[0] >= READS]
            means = ", ".join(f"{sum(grade[k] for _, grade in graded) / len(graded):.1f}" for k in range(3))
            kept = share(sum(grade[2] >= KEPT for _, grade in graded), len(graded))
            print(f"{run} {verdict}: reads as the noun {share(len(reads), len(graded))}; kept {kept}; a, b, c {means}")
            if run != NOTHING and not verdict:
                print(f"  reads: {', '.join(sorted(reads))}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the nouns, run them, draw the sheets, or count what was seen."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    steps = parser.add_subparsers(dest="step")
    for name, paths in (
        ("run", ("folder", "out")),
        ("sheets", ("out",)),
        ("count", ("out", "named", "grades")),
        ("tables", ()),
    ):
        step = steps.add_parser(name)
        for path in paths:
            step.add_argument(path, type=Path)
    asked = parser.parse_args(arguments)
    if asked.step == "run":
        _run(asked.folder, asked.out)
    elif asked.step == "sheets":
        _sheets(asked.out)
    elif asked.step == "count":
        _count(asked.out, asked.named, asked.grades)
    elif asked.step == "tables":
        _tables()
    else:
        print(*drawn())


if __name__ == "__main__":
    main()
