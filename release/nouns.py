"""Cut WordNet's nouns to `meshdeform/priors/builtin/nouns.txt.gz`: `python -m release.nouns /usr/share/wordnet`.

The folder is that of Debian's package `wordnet-base` (WordNet 3.0), with `data.noun` and `index.noun`. What is kept:
the things that can have a shape (animals, artefacts, parts of bodies, food, natural objects, people, plants), words
in small letters without spaces, of each word its first senses (of the prior's own nouns the one sense that it draws),
and of each thing its first kind. The file is the tree
in depth-first order: a line is the depth and the words of one thing. Words without a line of their own are left out
with their line, unless others are below.
"""

from __future__ import annotations

import argparse
import gzip
import re
from collections import defaultdict
from pathlib import Path

from meshdeform.priors.builtin.vocabulary import NOUNS

__all__ = ["main", "tree"]

TABLE = Path(__file__).parents[1] / "meshdeform" / "priors" / "builtin" / "nouns.txt.gz"
_FILES = {"03", "05", "06", "08", "13", "17", "18", "20"}
"""Lexicographer files (lexnames(5WN)): tops, animal, artifact, body, food, object, person, plant."""
_SENSES = 3
_SIMPLE = re.compile(r"[a-z]{3,}")
_HYPERNYM = "@"
_OTHER_SENSES = {
    # The first sense is another thing than the prior draws: a pullover, a dish, a giant, the fruit's tree.
    "turtle": "05", "octopus": "05", "whale": "05", "pear": "13", "carrot": "13", "pineapple": "13", "mushroom": "20",
    # A factory, an omen, a shape, a fruit, a clue, a fool, an instrument.
    "plant": "20", "sign": "06", "cone": "06", "bone": "08", "key": "06", "mug": "06", "log": "20",
    # Symbols and weather, which no kind of thing is near.
    "star": "", "heart": "", "coin": "", "cloud": "", "crystal": "", "rover": "", "book": "", "target": "",
}  # fmt: skip
"""The lexicographer file of the sense of the prior's nouns, unless it is that of the first sense."""
_SEVERAL = {"dolphin"}
"""Nouns whose sense is the second of its file: the first is a fish."""


def tree(folder: Path) -> list[tuple[int, list[str]]]:
    """Return the lines of the table: depth, and words as `word` or `word:sense` from the second sense on."""
    kinds, files, lemmas = _read(folder / "data.noun")
    words = defaultdict[str, list[str]](list)
    for word, senses in _senses(folder / "index.noun").items():
        shapes = [sense for sense in senses if files[sense] in _FILES]
        if word in NOUNS and word not in _SEVERAL:
            shapes = [sense for sense in shapes if files[sense] == _OTHER_SENSES.get(word, files[sense])][:1]
        for rank, sense in enumerate(shapes[:_SENSES], 1):
            if word in lemmas[sense]:
                words[sense].append(word if rank == 1 else f"{word}:{rank}")
    children = defaultdict[str, list[str]](list)
    roots = []
    for sense in sorted(kinds):
        if files[sense] in _FILES and kinds[sense] and files[kinds[sense]] in _FILES:
            children[kinds[sense]].append(sense)
        elif files[sense] in _FILES:
            roots.append(sense)
    lines: list[tuple[int, list[str]]] = []

    def visit(sense: str, depth: int) -> None:
        at = len(lines)
        lines.append((depth, sorted(words[sense])))
        for child in children[sense]:
            visit(child, depth + 1)
        if not words[sense] and len(lines) == at + 1:
            lines.pop()

    for root in roots:
        visit(root, 0)
    return lines


def _read(path: Path) -> tuple[dict[str, str], dict[str, str], dict[str, set[str]]]:
    """Return the first kind, the lexicographer file and the lemmas of each synset (wndb(5WN))."""
    kinds, files, lemmas = dict[str, str](), dict[str, str](), dict[str, set[str]]()
    for line in path.read_text("utf-8").splitlines():
        if line.startswith(" "):
            continue  # the licence
        fields = line.partition(" | ")[0].split()
        offset, count = fields[0], int(fields[3], 16)
        files[offset] = fields[1]
        # `index.noun` has every word in small letters; here names keep their capitals.
        lemmas[offset] = set(fields[4 : 4 + 2 * count : 2])
        pointers = fields[5 + 2 * count :]
        kinds[offset] = next((pointers[k + 1] for k in range(0, len(pointers) - 3, 4) if pointers[k] == _HYPERNYM), "")
    return kinds, files, lemmas


def _senses(path: Path) -> dict[str, list[str]]:
    """Return the synsets of each simple word, the most frequent first."""
    found = {}
    for line in path.read_text("utf-8").splitlines():
        fields = line.split()
        if not line.startswith(" ") and _SIMPLE.fullmatch(fields[0]):
            found[fields[0]] = fields[-int(fields[2]) :]
    return found


def main() -> None:
    """Write the table, with WordNet's licence at its head."""
    parser = argparse.ArgumentParser(prog="python -m release.nouns", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path, help="of WordNet 3.0: data.noun and index.noun")
    parser.add_argument("-o", "--output", type=Path, default=TABLE)
    arguments = parser.parse_args()
    head = [
        line[5:].rstrip()
        for line in (arguments.folder / "data.noun").read_text("utf-8").splitlines()
        if line.startswith("  ")
    ]
    lines = tree(arguments.folder)
    text = [
        "# A part of WordNet's nouns, cut by release/nouns.py of Meshdeform. WordNet's licence:",
        *(f"# {line}".rstrip() for line in head),
        *(f"{depth} {' '.join(found)}".rstrip() for depth, found in lines),
    ]
    arguments.output.write_bytes(gzip.compress(("\n".join(text) + "\n").encode(), 9, mtime=0))
    print(
        f"{len(lines)} things, {sum(len(found) for _, found in lines)} words, {arguments.output.stat().st_size} bytes"
    )


if __name__ == "__main__":
    main()
