"""Define the suites of the benchmark: which sources are deformed with which prompts.

`small` and `full` use prompts of the builtin prior's vocabulary; twelve nouns, easy (a mushroom) and hard (a chair, a
table and an airplane need thin parts far from any source), a third of them with an attribute.

`nouns` deforms a sphere into every noun of the builtin prior, and `unseen` into every pair of noun and attribute that
no training picture of that prior showed, which tests combinations of known words.

`turned` is `small` with every source turned by its own random angle about the up axis, which tests `orientation`.

`paper` is for Stable Diffusion models. Its first five prompts are from the public pages and repositories of the two
papers behind the method; the other prompts and all sources are ours, because the papers' meshes cannot be
redistributed. Nothing here reproduces a figure from the papers.

Sources of `PAPER_PROMPTS`: "a giraffe", "an octopus", "a heart shaped vase", "a mandolin": the project page and README
of TextDeformer (Gao et al. 2023); "a dragon": the public configuration of FusionDeformer (Xu et al. 2024).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

from meshdeform.errors import ParameterError
from meshdeform.priors.builtin.grammar import NOUNS, ParsedPrompt
from meshdeform.priors.builtin.training.held_out import unseen_pairs

__all__ = ["PAPER_PROMPTS", "SUITES", "Item", "Suite", "find_suite"]

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
_UNSEEN_PROMPTS = tuple(str(ParsedPrompt(noun, (attribute,))) for noun, attribute in unseen_pairs())

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
    """Every source is deformed by every prompt with every seed.

    Attributes
    ----------
    name : str
    sources : tuple of str
        Names in `meshdeform.evaluation.sources.SOURCES`, or paths of meshes.
    prompts : tuple of str
        All prompts; retrieval is among them.
    seeds : tuple of int
    preset : str
        Default parameters.
    turned : bool
        Whether each item's source is turned about the up axis by `turn_of`; shapes are judged turned back.
    """

    name: str
    sources: tuple[str, ...]
    prompts: tuple[str, ...]
    seeds: tuple[int, ...]
    preset: str
    turned: bool = False

    def items(self, limit: int | None = None) -> list[Item]:
        """Return all deformations, or the first `limit`; any P consecutive ones of P prompts have each prompt once."""
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
        names = [Path(source).stem for source in sources]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ParameterError(f"Two sources are called {twice[0]!r}.", advice="Give the files different names.")
        return replace(self, sources=sources)

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
        Suite("unseen", ("sphere",), _UNSEEN_PROMPTS, (0,), "balanced"),
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
