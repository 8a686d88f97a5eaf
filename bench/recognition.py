"""Ask the judge, and read, what real assets are: ``python -m bench.recognition FOLDER [--list LIST --split SPLIT]``.

`recognition.json` names public files by repository, commit, path and SHA-256, each with its noun: that of its name, put
right by eye. Those whose name says nothing, or that show nothing of it, are left out. `--list` takes the assets of
`bench/keep` or `bench/parts` in its place. FOLDER has the files, wherever in it; nothing is fetched, and what is
missing is counted.

For each way of asking there is the share of assets whose noun is first, and among the first three. Then, for each
probability, there is the share of assets at or above it that are what they are taken for. `if called so` is that of
descriptions which call the asset what it is taken for, if as many describe another thing as describe the asset, and one
in five of these names just the noun of the same group that the asset is mistaken for. Names in a file often tell what
its own name does, by which the nouns were listed: the readings are told a second time without them.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from meshdeform.assets import Limits, load_asset
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.plain.body import loose_body
from meshdeform.priors.builtin.vocabulary import NOUN_GROUPS
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.kept_readings import FolderReadings
from meshdeform.runs.reading import Source, read_source
from meshdeform.runs.recognition import recognise

LISTED = Path(__file__).with_suffix(".json")
FROM = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.96, 0.97, 0.98, 0.99)
MISTAKEN = 0.2
GROUP = {noun: group for group, nouns in NOUN_GROUPS.items() for noun in nouns}
WAYS = ("judge", "reading", "reading without names")


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

    @property
    def near(self) -> bool:
        """Whether it was mistaken for something of its own group."""
        return not self.right and GROUP[self.noun] == GROUP[self.taken_for]


def entries(listed: Path, split: str = "") -> list[tuple[str, str, str]]:
    """Return name, noun and SHA-256 of each listed asset of a split, or of all."""
    document = json.loads(listed.read_text())
    if "files" in document[0]:
        return [(f"{each['repository']}/{name}", *rest) for each in document for name, *rest in each["files"]]
    return [(each["name"], each["noun"], each["sha256"]) for each in document if split in ("", each["split"])]


def answers(folder: Path, wanted: Sequence[tuple[str, str, str]]) -> Iterator[dict[str, Answer]]:
    """Ask for each listed file that is in the folder, in all ways."""
    files = {
        hashlib.sha256(path.read_bytes()).hexdigest(): path
        for path in folder.rglob("*")
        if path.suffix.lower() in (".glb", ".obj") and path.is_file()
    }
    params = resolve(DeformParams())
    with tempfile.TemporaryDirectory() as cache:
        source = Source("", "", kept=FolderReadings(Path(cache)))
        for name, noun, digest in wanted:
            if (path := files.get(digest)) is None:
                continue
            body = loose_body(load_asset(path.read_bytes(), path.name, Limits.unlimited()))
            mesh = TriangleMesh(torch.from_numpy(body.points), torch.from_numpy(body.faces))
            judged = recognise(mesh, None, [joint.name for joint in body.joints])
            found = {WAYS[0]: Answer(name, noun, judged.noun, judged.probability, _three(judged.nouns))}
            for way, each in zip(WAYS[1:], (body, replace(body, names={})), strict=True):
                reading = read_source(each, params, source)
                read = judged.with_reading(reading)
                likely = judged.nouns if reading is None else reading.probabilities
                found[way] = Answer(name, noun, read.noun, read.probability, _three(likely))
            yield found


def _three(probabilities: Mapping[str, float]) -> tuple[str, ...]:
    return tuple(sorted(probabilities, key=lambda noun: -probabilities[noun])[:3])


def table(found: Sequence[Answer]) -> str:
    """Return the shares that are right from each probability on, as a table."""
    lines = ["| from | assets | right | share | if called so |", "|---|---|---|---|---|"]
    for least in FROM:
        sure = [each for each in found if each.probability >= least]
        right, near = sum(each.right for each in sure), sum(each.near for each in sure)
        shares = right / max(1, len(sure)), right / max(1.0, right + MISTAKEN * near)
        lines.append(f"| {least:g} | {len(sure)} | {right} | {shares[0]:.1%} | {shares[1]:.1%} |")
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
