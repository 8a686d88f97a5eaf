"""Define the suites of the benchmark: which sources are deformed with which prompts.

`small` and `full` use prompts of the builtin prior's vocabulary; twelve nouns, easy (a mushroom) and hard (a chair, a
table and an airplane need thin parts far from any source), a third of them with an attribute.

`nouns` deforms a sphere into every noun of the builtin prior, and `unseen` into 40 of the pairs of noun and attribute
that no training picture of that prior showed, which tests combinations of known words. `seen` is its control: 40 of the
pairs that training pictures did show.

`assets` deforms real assets, most of many parts, each by a few nouns. The files are not part of the project: the caller
names a folder that has them (public samples of Khronos, Kenney, KayKit and others; see `ASSET_PAIRS`).

`keep` asks whether anybody would keep the result: 28 real assets, half furniture, vehicles, buildings and vessels, half
animals, people and plants, each with a near and a far prompt, chosen before any result was seen. Whole jobs run on the
files, and the results are compared with doing nothing and with a stretch (`delivered`). `keep.json` says where each
file is published, with its commit, SHA-256 and licence.

`held-out-packs` deforms real assets of an author whom the prior's training never saw into each noun that the prior
learned from collections alone (`training.collections`).

`turned` is `small`, and `turned-assets` is `assets`, with every source turned by its own random angle about the up
axis, which tests `orientation`.

`paper` is for Stable Diffusion models. Its first five prompts are from the public pages and repositories of the two
papers behind the method; the other prompts and all sources are ours, because the papers' meshes cannot be
redistributed. Nothing here reproduces a figure from the papers.

Sources of `PAPER_PROMPTS`: "a giraffe", "an octopus", "a heart shaped vase", "a mandolin": the project page and README
of TextDeformer (Gao et al. 2023); "a dragon": the public configuration of FusionDeformer (Xu et al. 2024).
"""

from __future__ import annotations

import hashlib
import json
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from meshdeform.errors import ParameterError
from meshdeform.priors.builtin.grammar import Attribute, ParsedPrompt
from meshdeform.priors.builtin.vocabulary import NOUNS
from training.collections.nouns import noun_of
from training.prior.held_out import FOURTH_EDITION, attributes_of, is_held_out, unseen_pairs

__all__ = ["ASSET_PAIRS", "KEEP_ASSETS", "PAPER_PROMPTS", "SUITES", "Item", "Suite", "find_suite"]

_PROMPTS = (
    "a mushroom",
    "a tall vase",
    "a fish",
    "a rocket with big fins",
    "a fat penguin",
    "a rabbit with big ears",
    "a giraffe",
    "a dinosaur with a long neck",
    "a twisted tree",
    "an airplane",
    "a chair",
    "a table",
)

_SMALL_SOURCES = ("sphere", "cube", "vase", "quadruped")
_NOUN_PROMPTS = tuple(str(ParsedPrompt(noun)) for noun in NOUNS)
_PAIR_COUNT = 40
_SEEN_SEED = 5

_Pair = tuple[str, Attribute]


def _prompts_of(pairs: Sequence[_Pair]) -> tuple[str, ...]:
    """Return prompts of pairs evenly spaced in their list, which is sorted by noun."""
    chosen = [pairs[number * len(pairs) // _PAIR_COUNT] for number in range(_PAIR_COUNT)]
    return tuple(str(ParsedPrompt(noun, (attribute,))) for noun, attribute in chosen)


def _seen_pairs() -> list[_Pair]:
    """Return as many pairs that the training showed as there are unseen ones, drawn once and for all."""

    def order(pair: _Pair) -> tuple[str, str, str]:
        return pair[0], pair[1].part, pair[1].degree

    shown = [(noun, a) for noun in NOUNS for a in attributes_of(noun) if not is_held_out(noun, a)]
    sample = random.Random(_SEEN_SEED).sample(sorted(shown, key=order), len(unseen_pairs()))  # noqa: S311
    return sorted(sample, key=order)


PAPER_PROMPTS = ("a giraffe", "a dragon", "an octopus", "a heart shaped vase", "a mandolin")
"""The prompts of `paper` that the papers' authors use themselves."""

ASSET_PAIRS = (
    ("CesiumMilkTruck.glb", "a car"),
    ("CesiumMilkTruck.glb", "a boat"),
    ("RobotExpressive.glb", "a penguin"),
    ("RobotExpressive.glb", "a snowman"),
    ("Knight.glb", "a snowman"),
    ("Knight.glb", "a cactus"),
    ("chr_knight.glb", "a snowman"),
    ("vehicle-truck-red.glb", "a car"),
    ("vehicle-truck-red.glb", "a boat"),
    ("vehicle-motorcycle.glb", "a horse"),
    ("decoration-tents.glb", "a house"),
    ("spot.obj", "a giraffe"),
    ("spot.obj", "a horse"),
    ("cow.obj", "a giraffe"),
    ("cow.obj", "an elephant"),
    ("Duck.glb", "a rabbit"),
)
"""File names and prompts of `assets`. Found at KhronosGroup/glTF-Sample-Assets (truck, duck), Kenney's Starter Kit
Racing (vehicles, tents), three.js (robot), KayKit Adventurers (knight), glTF-Transform's tests (chr_knight) and
alecjacobson/common-3d-test-models (spot, cow)."""

KEEP_ASSETS: tuple[dict[str, str], ...] = tuple(json.loads((Path(__file__).parent / "keep.json").read_text()))
"""The assets of `keep`: `file`; `noun`: what it is; `near` and `far`: its prompts; `repository`, `commit`, `path`,
`sha256`, `licence` and `author`."""

_DUNGEON = ("barrel_large", "bottle_A_brown", "box_large", "candle_triple", "chair", "coin_stack_medium", "keg",
            "pillar", "plate", "stool", "table_medium", "torch", "trunk_large_A")  # fmt: skip
_KAYKIT = (*(f"{name}.gltf.glb" for name in _DUNGEON), "chest.glb", "Barbarian.glb", "Mage.glb")
"""Files of KayKit's Dungeon Remastered and Adventurers (CC0, Kay Lousberg)."""


def _held_out_pairs() -> tuple[tuple[str, str], ...]:
    """Return a pair for each noun from collections, with an asset that does not show it."""
    pairs = []
    for number, noun in enumerate(sorted(FOURTH_EDITION)):
        strangers = [name for name in _KAYKIT if noun_of(Path(name).stem) != noun]
        pairs.append((strangers[5 * number % len(strangers)], str(ParsedPrompt(noun))))
    return tuple(pairs)


_HELD_OUT_PAIRS = _held_out_pairs()
_KEEP_PAIRS = tuple((asset["file"], asset[which]) for asset in KEEP_ASSETS for which in ("near", "far"))

_OUR_PROMPTS = (
    "a dachshund",
    "a camel",
    "a rabbit",
    "a wooden chair",
    "a fighter jet",
    "a wine bottle",
    "a mushroom",
)


@dataclass(frozen=True)
class Item:
    """One deformation of a suite."""

    source: str
    prompt: str
    seed: int

    @property
    def name(self) -> str:
        """File name that identifies the item."""
        return f"{Path(self.source).stem}--{self.prompt.replace(' ', '-')}--seed{self.seed}"


@dataclass(frozen=True)
class Suite:
    """Every source is deformed by every prompt with every seed, or every pair of both with every seed.

    Attributes
    ----------
    name : str
    sources : tuple of str
        Names in `training.evaluation.sources.SOURCES`, or paths of meshes.
    prompts : tuple of str
        All prompts; retrieval is among them.
    seeds : tuple of int
    preset : str
        Default parameters.
    pairs : tuple of (str, str), optional
        The pairs of source and prompt, if not every source is deformed by every prompt.
    delivered : bool
        Whether whole jobs run on the files, and their results are measured as viewers show them (`delivered`).
    turned : bool
        Whether each item's source is turned about the up axis by `turn_of`; shapes are judged turned back.
    """

    name: str
    sources: tuple[str, ...]
    prompts: tuple[str, ...]
    seeds: tuple[int, ...]
    preset: str
    pairs: tuple[tuple[str, str], ...] = ()
    turned: bool = False
    delivered: bool = False

    def items(self, limit: int | None = None) -> list[Item]:
        """Return all deformations, or the first `limit`; any P consecutive ones of P prompts have each prompt once."""
        if self.pairs:
            return [Item(source, prompt, seed) for seed in self.seeds for source, prompt in self.pairs][:limit]
        count = len(self.sources)
        every = [
            Item(self.sources[(number + shift) % count], prompt, seed)
            for seed in self.seeds
            for shift in range(count)
            for number, prompt in enumerate(self.prompts)
        ]
        return every[:limit]

    def turn_of(self, item: Item) -> float:
        """Return by how many degrees, from +Z towards +X, an item's source is turned: 0 .. 360, from its name."""
        if not self.turned:
            return 0.0
        return 360 * int.from_bytes(hashlib.sha256(item.name.encode()).digest()[:4], "big") / 2**32

    def with_sources(self, sources: tuple[str, ...]) -> Suite:
        """Return the same suite with other sources.

        Raises
        ------
        ParameterError
            Two sources have the same file name without extension.
        """
        if self.pairs:
            raise ParameterError(f"The suite `{self.name}` has its own sources.", advice="Use another suite.")
        names = [Path(source).stem for source in sources]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ParameterError(f"Two sources are called {twice[0]!r}.", advice="Give the files different names.")
        return replace(self, sources=sources)

    def in_folder(self, folder: Path) -> Suite:
        """Return the same suite with the paths of its sources, found by their names anywhere in a folder.

        Raises
        ------
        ParameterError
            The suite needs no files, or the folder lacks one of them or has another file of its name.
        """
        if not self.pairs:
            raise ParameterError(f"The suite `{self.name}` needs no folder of assets.", advice="Omit --assets.")
        paths = {path.name: str(path) for path in sorted(folder.rglob("*")) if path.is_file()}
        if missing := [name for name in self.sources if name not in paths]:
            raise ParameterError(
                f"{folder} has no {', '.join(missing)}.",
                advice="training/evaluation/suite.py and keep.json say where the files of the suites are published.",
            )
        known = {asset["file"]: asset["sha256"] for asset in KEEP_ASSETS} if self.delivered else {}
        other = [name for name in known if hashlib.sha256(Path(paths[name]).read_bytes()).hexdigest() != known[name]]
        if other:
            raise ParameterError(
                f"{folder} has another {', '.join(other)} than the suite.",
                advice="training/evaluation/keep.json has the commit and the SHA-256 of each file.",
            )
        pairs = tuple((paths[source], prompt) for source, prompt in self.pairs)
        return replace(self, sources=tuple(paths[name] for name in self.sources), pairs=pairs)

    def with_seeds(self, seeds: tuple[int, ...]) -> Suite:
        """Return the same suite with other seeds."""
        return replace(self, seeds=seeds)


SUITES: dict[str, Suite] = {
    suite.name: suite
    for suite in (
        Suite("small", _SMALL_SOURCES, _PROMPTS, (0,), "balanced"),
        Suite(
            "full",
            ("sphere", "cube", "cylinder", "torus", "vase", "armchair", "quadruped", "toy"),
            _PROMPTS,
            (0, 1),
            "balanced",
        ),
        Suite("turned", _SMALL_SOURCES, _PROMPTS, (0,), "balanced", turned=True),
        Suite("nouns", ("sphere",), _NOUN_PROMPTS, (0,), "balanced"),
        Suite("unseen", ("sphere",), _prompts_of(unseen_pairs()), (0,), "balanced"),
        Suite("seen", ("sphere",), _prompts_of(_seen_pairs()), (0,), "balanced"),
        Suite(
            "assets",
            tuple(dict.fromkeys(source for source, _ in ASSET_PAIRS)),
            tuple(dict.fromkeys(prompt for _, prompt in ASSET_PAIRS)),
            (0,),
            "balanced",
            ASSET_PAIRS,
        ),
        Suite(
            "held-out-packs", _KAYKIT, tuple(prompt for _, prompt in _HELD_OUT_PAIRS), (0,), "balanced", _HELD_OUT_PAIRS
        ),
        Suite(
            "turned-assets",
            tuple(dict.fromkeys(source for source, _ in ASSET_PAIRS)),
            tuple(dict.fromkeys(prompt for _, prompt in ASSET_PAIRS)),
            (0,),
            "balanced",
            ASSET_PAIRS,
            turned=True,
        ),
        Suite(
            "keep",
            tuple(asset["file"] for asset in KEEP_ASSETS),
            tuple(dict.fromkeys(prompt for _, prompt in _KEEP_PAIRS)),
            (0,),
            "balanced",
            _KEEP_PAIRS,
            delivered=True,
        ),
        Suite("paper", ("sphere", "vase", "armchair", "quadruped"), PAPER_PROMPTS + _OUR_PROMPTS, (0,), "paper"),
    )
}
"""The suites by name."""


def find_suite(name: str) -> Suite:
    """Return a suite by its name.

    Raises
    ------
    ParameterError
        There is no suite of this name.
    """
    if name not in SUITES:
        raise ParameterError(f"There is no suite {name!r}.", advice=f"Choose one of: {', '.join(SUITES)}.")
    return SUITES[name]
