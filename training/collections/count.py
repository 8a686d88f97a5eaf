"""Count what public collections call their files: `python -m training.collections.count LISTINGS -o OUT`.

LISTINGS has one text file for each repository, called OWNER+NAME.txt, with the paths of its meshes, one a line, as
`git ls-tree -r --name-only HEAD` gives them. A name is cut into words without variants (`nouns.words_of`), and counts
once in a pack, however many colours, sizes and numbers it comes in. It counts for its last word that can have a shape
("kitchen chair"), or else for its first, and for the two words that it consists of. Words that can have a shape are the
builtin prior's, those of `nouns.txt` and WordNet's (`release/nouns.py`). OUT has a line for each noun that several
packs have: noun, names, packs, and `*` where the prior has it.
"""

from __future__ import annotations

import argparse
import gzip
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import meshdeform
from meshdeform.vocabulary.nouns import NOUNS
from training.collections.nouns import noun_of, words_of
from training.collections.sources import INNER

_WORDS = Path(meshdeform.__file__).parent / "priors" / "builtin" / "nouns.txt.gz"
_SUFFIXES = frozenset({".glb", ".gltf", ".obj", ".fbx", ".dae", ".stl", ".vox", ".vrm", ".blend"})
_FEWEST_PACKS = (2, 3)
"""Packs that must have a noun of one word, and of two."""
_ANONYMOUS = frozenset({"model", "scene", "mesh", "untitled"})
"""Names of files that only their folder's name explains."""


def things() -> frozenset[str]:
    """Return the words for what can have a shape."""
    lines = gzip.decompress(_WORDS.read_bytes()).decode().splitlines()
    return frozenset(word for line in lines if not line.startswith("#") for word in line.split()) | NOUNS.keys()


def pack_of(repository: str, path: PurePosixPath) -> str:
    """Return the repository and the first folder in it that says something."""
    inner = [part for part in path.parts[:-1] if part.lower() not in INNER]
    return "/".join([repository, *inner[:1]])


def nouns_in(words: list[str], shaped: frozenset[str]) -> Iterator[str]:
    """Give the nouns that a name counts for."""
    head = next((word for word in (words[-1], words[0]) if word in shaped or noun_of(word)), None)
    if head is not None:
        yield head
        if len(words) == 2 and head == words[-1]:
            yield " ".join(words)


def count(listings: Path) -> dict[str, tuple[int, int]]:
    """Return how many names and packs each noun has."""
    shaped, names, packs = things(), defaultdict[str, set[str]](set), defaultdict[str, set[str]](set)
    for listing in sorted(listings.glob("*.txt")):
        for path in map(PurePosixPath, listing.read_text(encoding="utf-8").splitlines()):
            words = words_of(path.parent.name if path.stem.lower() in _ANONYMOUS else path.stem)
            if path.suffix.lower() not in _SUFFIXES or not words:
                continue
            pack = pack_of(listing.stem, path)
            for noun in nouns_in(words, shaped):
                names[noun].add(f"{pack}: {' '.join(words)}")
                packs[noun].add(pack)
    often = [noun for noun in names if len(packs[noun]) >= _FEWEST_PACKS[" " in noun]]
    return {noun: (len(names[noun]), len(packs[noun])) for noun in often}


def packs_of_nouns() -> dict[str, int]:
    """Return how many packs have each noun, of the table beside this module."""
    lines = Path(__file__).with_name("counts.txt").read_text(encoding="utf-8").splitlines()[1:]
    rows = (line.split("\t") for line in lines)
    return {name.replace(" ", "-"): int(packs) for name, _, packs, *_ in rows}


def main() -> None:
    """Write the table, the nouns of most packs first."""
    parser = argparse.ArgumentParser(prog="python -m training.collections.count", description=main.__doc__)
    parser.add_argument("listings", type=Path, help="folder with the listing of each repository")
    parser.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()
    counts = sorted(count(arguments.listings).items(), key=lambda each: (-each[1][1], -each[1][0], each[0]))
    repositories = len(list(arguments.listings.glob("*.txt")))
    head = f"# By training/collections/count.py from {repositories} repositories: noun, names, packs, * if ours"
    rows = ["\t".join([noun, *map(str, numbers), *("*" for _ in range(noun in NOUNS))]) for noun, numbers in counts]
    arguments.output.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
