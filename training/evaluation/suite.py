"""Define the suites of the benchmark: which sources are deformed with which prompts.

`small` and `full` use prompts of the builtin vocabulary; twelve nouns, easy (a mushroom) and hard (a chair, a table and
an airplane need thin parts far from any source), a third of them with an attribute. `nouns` deforms a sphere into every
noun.

`assets` deforms real assets, most of many parts, each by a few nouns. The files are not part of the project: the caller
names a folder that has them (public samples of Khronos, Kenney, KayKit and others; see `ASSET_PAIRS`).

`paper` is for Stable Diffusion models. Its first five prompts are from the public pages and repositories of the two
papers behind the method; the other prompts and all sources are ours, because the papers' meshes cannot be
redistributed. Nothing here reproduces a figure from the papers.

Sources of `PAPER_PROMPTS`: "a giraffe", "an octopus", "a heart shaped vase", "a mandolin": the project page and README
of TextDeformer (Gao et al. 2023); "a dragon": the public configuration of FusionDeformer (Xu et al. 2024).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from meshdeform.errors import ParameterError
from meshdeform.priors.builtin.vocabulary import NOUNS
from meshdeform.vocabulary.grammar import ParsedPrompt

__all__ = ["ASSET_PAIRS", "PAPER_PROMPTS", "SUITES", "Item", "Suite", "files_in"]

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

PAPER_PROMPTS = ("a giraffe", "a dragon", "an octopus", "a heart shaped vase", "a mandolin")
"""The prompts of `paper` that the papers' authors use themselves."""

_OUR_PROMPTS = (
    "a dachshund",
    "a camel",
    "a rabbit",
    "a wooden chair",
    "a fighter jet",
    "a wine bottle",
    "a mushroom",
)

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


@dataclass(frozen=True)
class Item:
    """One deformation of a suite; `source` is a name in `training.evaluation.sources.SOURCES`, or that of a file."""

    source: str
    prompt: str
    seed: int

    @property
    def name(self) -> str:
        """Name of the item's folder."""
        return f"{Path(self.source).stem}--{self.prompt.replace(' ', '-')}--seed{self.seed}"


@dataclass(frozen=True)
class Suite:
    """Pairs of source and prompt, each with every seed; `of_files`: whether the sources are files of other people."""

    pairs: tuple[tuple[str, str], ...]
    seeds: tuple[int, ...] = (0,)
    of_files: bool = False

    @property
    def prompts(self) -> tuple[str, ...]:
        """All prompts, each once; retrieval is among them."""
        return tuple(dict.fromkeys(prompt for _, prompt in self.pairs))

    @property
    def items(self) -> list[Item]:
        """All deformations."""
        return [Item(source, prompt, seed) for seed in self.seeds for source, prompt in self.pairs]


def _each(sources: tuple[str, ...], prompts: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Return every source with every prompt; any P consecutive pairs of P prompts have each prompt once."""
    count = len(sources)
    shifts = [(shift, number) for shift in range(count) for number in range(len(prompts))]
    return tuple((sources[(number + shift) % count], prompts[number]) for shift, number in shifts)


SUITES = {
    "small": Suite(_each(("sphere", "cube", "vase", "quadruped"), _PROMPTS)),
    "full": Suite(
        _each(("sphere", "cube", "cylinder", "torus", "vase", "armchair", "quadruped", "toy"), _PROMPTS), (0, 1)
    ),
    "nouns": Suite(_each(("sphere",), tuple(str(ParsedPrompt(noun)) for noun in NOUNS))),
    "assets": Suite(ASSET_PAIRS, of_files=True),
    "paper": Suite(_each(("sphere", "vase", "armchair", "quadruped"), PAPER_PROMPTS + _OUR_PROMPTS)),
}
"""The suites by name."""


def files_in(folder: Path, items: list[Item]) -> dict[str, Path]:
    """Return the paths of the files that items are made from, found by their names anywhere in a folder.

    Raises
    ------
    ParameterError
        The folder lacks one of them.
    """
    paths = {path.name: path.absolute() for path in sorted(folder.rglob("*")) if path.is_file()}
    if missing := sorted({item.source for item in items} - paths.keys()):
        raise ParameterError(
            f"{folder} has no {', '.join(missing)}.",
            advice="training/evaluation/suite.py says where the files are published.",
        )
    return {item.source: paths[item.source] for item in items}
