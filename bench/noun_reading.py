"""Measure how the nouns of public assets are read: ``python -m bench.noun_reading FOLDER [--cache FOLDER]``.

The assets are those of `bench.recognition`, and FOLDER has their files. For the judge alone, and for what judge, shape
and names decide together (`meshdeform.reading.deciding`), there is the share of assets whose noun is first, and among
the first three; then, by the probability that was told, how many are right. Names in a file often tell what its own
name does, by which the nouns were listed, so that assets with and without such names are counted apart.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from bench.recognition import LISTED, files_by_digest
from meshdeform.assets import Limits, load_asset
from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.judge import Judge
from meshdeform.plain.body import loose_body
from meshdeform.plain.evidence import evidence_of
from meshdeform.reading.choice import Surface
from meshdeform.reading.deciding import decide
from meshdeform.reading.evidence import nouns_named

FROM = (0.0, 0.3, 0.5, 0.7, 0.9, 0.97)


@dataclass(frozen=True)
class Told:
    """What an asset is, the nouns that the judge and the reading tell, the surest first, and whether it is named."""

    name: str
    noun: str
    judged: tuple[str, ...]
    read: tuple[str, ...]
    probability: float
    named: bool
    seconds: float


def read_all(folder: Path, cache: Path | None) -> Iterator[Told]:
    """Read the noun of each listed file that is in the folder."""
    files, judge = files_by_digest(folder), Judge()
    for repository in json.loads(LISTED.read_text()):
        for name, noun, digest in repository["files"]:
            if (path := files.get(digest)) is None:
                continue
            body = loose_body(load_asset(path.read_bytes(), path.name, Limits.unlimited()))
            judged = judge.noun_probabilities(TriangleMesh(torch.from_numpy(body.points), torch.from_numpy(body.faces)))
            surface = Surface(body.points, body.faces)
            named, near = nouns_named(evidence_of(body), surface.faces, surface.areas)
            start = time.process_time()
            read = decide(surface, judged, named, near, None, cache).probabilities
            seconds = time.process_time() - start
            order = sorted(judged, key=lambda noun: -judged[noun])
            yield Told(name, noun, tuple(order), tuple(read), read[next(iter(read))], bool(named), seconds)


def shares(told: Sequence[Told], title: str) -> str:
    """Return a line with the shares of assets whose noun is first, and among three."""
    count = max(1, len(told))
    first = [sum(each.noun == order(each)[0] for each in told) / count for order in (_judged, _read)]
    three = [sum(each.noun in order(each)[:3] for each in told) / count for order in (_judged, _read)]
    return f"| {title} | {len(told)} | {first[0]:.1%} | {three[0]:.1%} | {first[1]:.1%} | {three[1]:.1%} |"


def _judged(told: Told) -> tuple[str, ...]:
    return told.judged


def _read(told: Told) -> tuple[str, ...]:
    return told.read


def main() -> None:
    """Print the shares, and how many are right by the probability that was told."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cache", type=Path, help="keep samples of members here (meshdeform.reading.banks)")
    arguments = parser.parse_args()
    told = list(read_all(arguments.folder, arguments.cache))
    for each in told:
        if each.noun != each.read[0]:
            print(f"{each.probability:.3f} {each.noun} read as {each.read[0]}, judged {each.judged[0]}: {each.name}")
    print("\n| | assets | judge first | among three | reading first | among three |\n|---|---|---|---|---|---|")
    print(shares(told, "all"))
    for named in (True, False):
        print(shares([each for each in told if each.named is named], "named" if named else "not named"))
    print("\n| probability from | assets | told on average | right |\n|---|---|---|---|")
    for low, high in zip(FROM, [*FROM[1:], 2.0], strict=True):
        within = [each for each in told if low <= each.probability < high]
        count = max(1, len(within))
        mean, right = sum(each.probability for each in within), sum(each.noun == each.read[0] for each in within)
        print(f"| {low:g} | {len(within)} | {mean / count:.1%} | {right / count:.1%} |")
    print(f"\n{sum(each.seconds for each in told) / max(1, len(told)):.2f} CPU s an asset")


if __name__ == "__main__":
    main()
