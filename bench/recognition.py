"""Read what real assets are: ``python -m bench.recognition FOLDER [--list LIST --split SPLIT]``.

`recognition.json` names public files by repository, commit, path and SHA-256, each with its noun: that of its name, put
right by eye. Those whose name says nothing, or that show nothing of it, are left out. `--list` takes the assets of
`bench/keep` or `bench/parts` in its place. FOLDER has the files, wherever in it; nothing is fetched, and what is
missing is counted.

There is the share of assets whose noun is first, and among the first three. Then, for each probability, there is the
share of assets at or above it that are what they are taken for. Names in a file often tell what its own name does, by
which the nouns were listed: the readings are told a second time without them.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from meshdeform.assets import Limits, load_asset
from meshdeform.plain.body import loose_body
from meshdeform.reading import Reading
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.kept_readings import FolderReadings
from meshdeform.runs.reading import ReadingSource, read_source

LISTED = Path(__file__).with_suffix(".json")
FROM = (0.0, 0.5, 0.8, 0.9, 0.97, 0.99)
WAYS = ("reading", "reading without names")


@dataclass(frozen=True)
class Answer:
    """What an asset is, what it was taken for, and the three likeliest nouns."""

    name: str
    noun: str
    taken_for: str
    probability: float
    three: tuple[str, ...]

    @property
    def right(self) -> bool:
        return self.noun == self.taken_for


def entries(listed: Path, split: str = "") -> list[tuple[str, str, str]]:
    """Return name, noun and SHA-256 of each listed asset of a split, or of all."""
    document = json.loads(listed.read_text())
    if "files" in document[0]:
        return [(f"{each['repository']}/{name}", *rest) for each in document for name, *rest in each["files"]]
    return [(each["name"], each["noun"], each["sha256"]) for each in document if split in ("", each["split"])]


def answers(folder: Path, wanted: Sequence[tuple[str, str, str]]) -> Iterator[dict[str, Answer]]:
    """Ask for each listed file that is in the folder, in both ways."""
    files = {
        hashlib.sha256(path.read_bytes()).hexdigest(): path
        for path in folder.rglob("*")
        if path.suffix.lower() in (".glb", ".obj") and path.is_file()
    }
    params = resolve(DeformParams())
    with tempfile.TemporaryDirectory() as cache:
        source = ReadingSource("", "", kept=FolderReadings(Path(cache)))
        for name, noun, digest in wanted:
            if (path := files.get(digest)) is None:
                continue
            body = loose_body(load_asset(path.read_bytes(), path.name, Limits.unlimited()))
            bodies = zip(WAYS, (body, replace(body, names={})), strict=True)
            readings = {way: read_source(each, params, source) for way, each in bodies}
            yield {way: _answer(name, noun, reading) for way, reading in readings.items()}


def _answer(name: str, noun: str, reading: Reading | None) -> Answer:
    if reading is None:
        return Answer(name, noun, "", 0.0, ())
    three = sorted(reading.probabilities, key=lambda each: -reading.probabilities[each])[:3]
    return Answer(name, noun, reading.noun, reading.probability, tuple(three))


def table(found: Sequence[Answer]) -> str:
    """Return the shares that are right from each probability on, as a table."""
    lines = ["| from | assets | right | share |", "|---|---|---|---|"]
    for least in FROM:
        sure = [each for each in found if each.probability >= least]
        right = sum(each.right for each in sure)
        lines.append(f"| {least:g} | {len(sure)} | {right} | {right / max(1, len(sure)):.1%} |")
    return "\n".join(lines)


def main() -> None:
    """Print what was mistaken, the surest first, and the shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--list", type=Path, default=LISTED, dest="listed")
    parser.add_argument("--split", default="", help="tuned or last, of lists that have splits")
    arguments = parser.parse_args()
    wanted = entries(arguments.listed, arguments.split)
    found = list(answers(arguments.folder, wanted))
    print(f"{len(found)} assets of {len(wanted)} that are listed")
    for way in WAYS:
        those = [each[way] for each in found]
        first, three = sum(each.right for each in those), sum(each.noun in each.three for each in those)
        print(f"\n{way}: {first} first, {three} among three\n\n{table(those)}")
        for each in sorted(those, key=lambda each: -each.probability):
            if not each.right:
                print(f"{each.probability:.3f} {each.noun} taken for {each.taken_for}: {each.name}")


if __name__ == "__main__":
    main()
