"""Read what real assets are that nobody tuned on: ``python -m bench.nouns FOLDER [--only COUNT]``.

`members.json` names public files by repository, commit, path and SHA-256 with their licences, each with its noun: that
of its name, put right by eye. `split`: `authors` made nothing that anything here learnt from or was tuned on, `packs`
are other packs of an author who did (`training/collections/sources.py` leaves them out). `front` is where an asset
faces, in degrees from +Z toward +X, `up` its upward axis. FOLDER has the files, wherever in it, beside what they refer
to; nothing is fetched, and what is missing is counted.

Names are withheld: the judge and the shapes of the nouns decide. There are the shares of assets whose noun is first,
and among the first three, with 95 % intervals: of each split, the `authors` in two halves by hash, of the nouns that
the suite had before its words became meshes (the trait `plain`) and of those since, of nouns that the judge knows and
of others, and of each group of nouns. On `seen`, as on the `packs`, the reading may be tuned.
Nouns without a family are left out and named.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from meshdeform.assets import Limits, load_asset
from meshdeform.assets.bundle import read_with_files
from meshdeform.errors import MeshdeformError
from meshdeform.judge import Judge
from meshdeform.nouns.families import FAMILIES
from meshdeform.plain.body import loose_body
from meshdeform.requests.document import DeformParams, resolve
from meshdeform.runs.kept_readings import Unkept, samples_in
from meshdeform.runs.reading import ReadingSource, read_source
from meshdeform.settings import Settings
from meshdeform.vocabulary.nouns import NOUN_GROUPS, nouns_with
from training.evaluation.report import interval

LISTED = Path(__file__).with_name("members.json")
_SUFFIXES = (".glb", ".gltf", ".obj")
_GROUPS = {noun: group for group, nouns in NOUN_GROUPS.items() for noun in nouns}


@dataclass(frozen=True)
class Answer:
    """What an asset is, and the three likeliest nouns, nearest first."""

    path: str
    noun: str
    split: str
    three: tuple[str, ...]
    judged: bool  # whether the judge knows the noun


def answers(folder: Path, wanted: Sequence[dict[str, str]]) -> Iterator[Answer]:
    """Read each listed file that is in the folder, without its names."""
    files = {
        hashlib.sha256(path.read_bytes()).hexdigest(): path
        for path in sorted(folder.rglob("*"))
        if path.suffix.lower() in _SUFFIXES
    }
    params, limits, judged = resolve(DeformParams()), Limits.unlimited(), Judge().nouns
    kept = Unkept(samples_in(Settings().cache_folder))
    for entry in wanted:
        if (path := files.get(entry["sha256"])) is None:
            continue
        three: tuple[str, ...] = ()
        source = ReadingSource("", path.name, kept=kept)
        try:
            body = loose_body(load_asset(read_with_files(path, limits), path.name, limits))
            reading = read_source(replace(body, names={}), params, source, fitted=1)  # fits do not decide nouns
            if reading is not None:
                likely = reading.probabilities
                three = tuple(sorted(likely, key=lambda noun: -likely[noun])[:3])
        except MeshdeformError as error:
            print(f"not read: {entry['path']}: {error.detail}", flush=True)
        yield Answer(entry["path"], entry["noun"], split_of(entry), three, entry["noun"] in judged)


def split_of(entry: Mapping[str, str]) -> str:
    """Return the split of an asset, of `authors` with the half."""
    half = " seen" if int(entry["sha256"][0], 16) < 8 else " unseen"
    return entry["split"] + (half if entry["split"] == "authors" else "")


def table(found: Sequence[Answer]) -> str:
    """Return the shares of all, of each split and of each group, as a table."""
    rows = defaultdict[str, list[Answer]](list)
    plain = nouns_with("plain")
    for each in sorted(found, key=lambda each: (each.split, each.noun not in plain, _GROUPS[each.noun])):
        age = f"{each.split}, {'first nouns' if each.noun in plain else 'nouns since'}"
        for row in ("all", each.split, age, "judged" if each.judged else "not judged", _GROUPS[each.noun]):
            rows[row].append(each)
    lines = ["| assets | number | nouns | first | among three |", "|---|---|---|---|---|"]
    for row, those in rows.items():
        first, three = (
            sum(each.three[:1] == (each.noun,) for each in those),
            sum(each.noun in each.three for each in those),
        )
        shares = (_share(hits, len(those)) for hits in (first, three))
        lines.append(f"| {row} | {len(those)} | {len({each.noun for each in those})} | {' | '.join(shares)} |")
    return "\n".join(lines)


def _share(hits: int, count: int) -> str:
    low, high = interval(hits, count)
    return f"{hits / count:.1%} ({low:.1%} to {high:.1%})"


def main() -> None:
    """Print what was mistaken, and the shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", type=int, help="this many of the list, from its beginning")
    arguments = parser.parse_args()
    listed = json.loads(LISTED.read_text(encoding="utf-8"))
    wanted = [each for each in listed if each["noun"] in FAMILIES][: arguments.only]
    print("no family:", *sorted({each["noun"] for each in listed if each["noun"] not in FAMILIES}))
    found = list(answers(arguments.folder, wanted))
    for each in found:
        if each.three[:1] != (each.noun,):
            print(f"{each.noun} taken for {', '.join(each.three) or 'nothing'}: {each.path}")
    print(f"\n{len(found)} assets of {len(wanted)} that are listed\n\n{table(found)}")


if __name__ == "__main__":
    main()
