"""Ask the judge, and read, what real assets are: ``python -m bench.recognition FOLDER``.

`recognition.json` names public files by repository, commit, path and SHA-256, each with its noun: that of its name, put
right by eye. Those whose name says nothing, or that show nothing of it, are left out. FOLDER has the files, wherever in
it; nothing is fetched, and what is missing is counted. For each probability there is the share of assets at or above it
that are what they are taken for. `if called so` is that of descriptions which call the asset what it is taken for, if
as many describe another thing as describe the asset, and one in five of these names just the noun of the same group
that the asset is mistaken for. The table of readings is printed a second time without what the names of nodes and
materials tell.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from collections.abc import Iterator, Sequence
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


@dataclass(frozen=True)
class Answer:
    """What an asset is, and what it was taken for."""

    name: str
    noun: str
    taken_for: str
    probability: float

    @property
    def right(self) -> bool:
        return self.noun == self.taken_for

    @property
    def near(self) -> bool:
        """Whether it was mistaken for something of its own group."""
        return not self.right and GROUP[self.noun] == GROUP[self.taken_for]


def files_by_digest(folder: Path) -> dict[str, Path]:
    """Return the assets in a folder by their SHA-256."""
    return {
        hashlib.sha256(path.read_bytes()).hexdigest(): path
        for path in folder.rglob("*")
        if path.suffix.lower() in (".glb", ".obj") and path.is_file()
    }


WAYS = ("judge", "reading", "reading without names")


def answers(folder: Path) -> Iterator[dict[str, Answer]]:
    """Ask for each listed file that is in the folder, in all ways."""
    files = {
        hashlib.sha256(path.read_bytes()).hexdigest(): path
        for path in folder.rglob("*")
        if path.suffix.lower() in (".glb", ".obj") and path.is_file()
    }
    params = resolve(DeformParams())
    with tempfile.TemporaryDirectory() as cache:
        source = Source("", "", kept=FolderReadings(Path(cache)))
        for repository in json.loads(LISTED.read_text()):
            for name, noun, digest in repository["files"]:
                if (path := files.get(digest)) is None:
                    continue
                body = loose_body(load_asset(path.read_bytes(), path.name, Limits.unlimited()))
                mesh = TriangleMesh(torch.from_numpy(body.points), torch.from_numpy(body.faces))
                judged = recognise(mesh, None, [joint.name for joint in body.joints])
                readings = (read_source(each, params, source) for each in (body, replace(body, names={})))
                found = (judged, *(judged.with_reading(reading) for reading in readings))
                yield {
                    way: Answer(f"{repository['repository']}/{name}", noun, each.noun, each.probability)
                    for way, each in zip(WAYS, found, strict=True)
                }


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
    found = list(answers(parser.parse_args().folder))
    listed = sum(len(repository["files"]) for repository in json.loads(LISTED.read_text()))
    print(f"{len(found)} assets of {listed} that are listed")
    for way in WAYS:
        those = [each[way] for each in found]
        print(f"\n{way}\n\n{table(those)}")
        for each in sorted(those, key=lambda each: -each.probability):
            if not each.right:
                print(f"{each.probability:.3f} {each.noun} taken for {each.taken_for}: {each.name}")


if __name__ == "__main__":
    main()
