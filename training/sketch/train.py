"""Train the sketch network on drawings of random members of the families.

    python -m training.sketch.train --drawings 1200 --epochs 12 --cache drawings.npz -o sketch.safetensors

The same arguments give the same weights on the same machine with one thread.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import cross_entropy, mse_loss

from meshdeform import __version__
from meshdeform.assets.drawing import SIDE, prepared
from meshdeform.deformation.variables import Adam
from meshdeform.kinds.sketch.families import FAMILIES
from meshdeform.kinds.sketch.looking import WEIGHTS
from meshdeform.requests.sketches import Value
from training.sketch.habits import Habits, drawn_lines
from training.sketch.network import Look, SketchNetwork, write_network
from training.sketch.strangers import stranger_lines
from training.sketch.strokes import draw

_BATCH = 64
_RATE = 1.5e-3
_DECAY = 0.02
_NUMBERS_WEIGHT = 8.0
_STRANGERS_WEIGHT = 0.5
_HELD_OUT = 0.1
"""Share of the drawings that only measure."""


@dataclass(frozen=True)
class Drawings:
    """N drawings and what they show."""

    pictures: NDArray[np.uint8]  # (N, SIDE, SIDE)
    family: NDArray[np.int64]  # (N,) -1: of none
    numbers: NDArray[np.float32]  # (N, most numbers): shares of the ranges, and 0 beyond the family's own
    choices: NDArray[np.int64]  # (N, most choices)

    def part(self, rows: slice | NDArray[np.bool_]) -> Drawings:
        """Return some of the drawings."""
        return Drawings(self.pictures[rows], self.family[rows], self.numbers[rows], self.choices[rows])

    def with_more(self, more: Drawings) -> Drawings:
        """Return these drawings and others."""
        return Drawings(*(np.concatenate([a, vars(more)[name]]) for name, a in vars(self).items()))


def draw_member(name: str, values: dict[str, Value], random: np.random.Generator) -> NDArray[np.float32]:
    """Return a drawing of a member by some person, as `prepared` returns it."""
    choices = {each.name: str(values[each.name]) for each in FAMILIES[name].choices}
    return prepared(draw(drawn_lines(name, values, Habits.some(name, choices, random)), random))


def make_drawings(count: int, seed: int, report: Callable[[str], None] = lambda _: None) -> Drawings:
    """Draw `count` random members, the families in turn; each depends on its seed and number alone."""
    names = list(FAMILIES)
    most = max(len(f.numbers) for f in FAMILIES.values()), max(len(f.choices) for f in FAMILIES.values())
    drawings = Drawings(
        np.zeros((count, SIDE, SIDE), np.uint8),
        np.arange(count) % len(names),
        np.zeros((count, most[0]), np.float32),
        np.zeros((count, most[1]), np.int64),
    )
    for row in range(count):
        family = FAMILIES[names[row % len(names)]]
        random = np.random.default_rng([seed, row])
        values = family.draw(random)
        drawings.pictures[row] = np.round(draw_member(family.name, values, random) * 255)
        drawings.numbers[row, : len(family.numbers)] = family.shares(values)
        drawings.choices[row, : len(family.choices)] = family.indices(values)
        if row % 1000 == 999:
            report(f"{row + 1} drawings")
    return drawings


def make_strangers(count: int, seed: int) -> Drawings:
    """Draw what is of no family; each drawing depends on its seed and number alone."""
    pictures = np.zeros((count, SIDE, SIDE), np.uint8)
    for row in range(count):
        random = np.random.default_rng([seed, row, 1])
        pictures[row] = np.round(prepared(draw(stranger_lines(random), random)) * 255)
    most = max(len(f.numbers) for f in FAMILIES.values()), max(len(f.choices) for f in FAMILIES.values())
    empty = np.zeros((count, most[0]), np.float32), np.zeros((count, most[1]), np.int64)
    return Drawings(pictures, np.full(count, -1), *empty)


def losses(look: Look, family: Tensor, numbers: Tensor, choices: Tensor) -> dict[str, Tensor]:
    """Return the mean losses: of the family, and of the true family's numbers and choices.

    What is of no family should be as probable of one as of any other.
    """
    strangers = look.family[family < 0].log_softmax(1).mean(1)
    known = cross_entropy(look.family, family, ignore_index=-1, reduction="sum")
    total = {
        "family": (known - _STRANGERS_WEIGHT * strangers.sum()) / len(family),
        "numbers": look.family.new_zeros(()),
        "choices": look.family.new_zeros(()),
    }
    for index, (name, about) in enumerate(FAMILIES.items()):
        rows = torch.nonzero(family == index)[:, 0]
        if not len(rows):
            continue
        share = len(rows) / len(family)
        total["numbers"] = total["numbers"] + share * mse_loss(
            look.numbers[name][rows], numbers[rows, : len(about.numbers)]
        )
        for place, logits in enumerate(look.choices[name]):
            total["choices"] = total["choices"] + share * cross_entropy(logits[rows], choices[rows, place])
    return total


def train(drawings: Drawings, epochs: int, seed: int, report: Callable[[str], None] = lambda _: None) -> SketchNetwork:
    """Train a network on drawings; the rate rises in the first twentieth and falls to 0 by half a cosine.

    Each time a drawing is seen, it is mirrored or not (members look the same mirrored up to the view), shifted by up to
    two pixels, and a square of it may be missing.
    """
    torch.manual_seed(seed)
    generator = torch.Generator().manual_seed(seed)
    network = SketchNetwork().train()
    weights = list(network.parameters())
    steps = epochs * (len(drawings.family) // min(_BATCH, len(drawings.family)))
    optimizer = Adam([{"params": weights, "lr": _RATE}])
    step = 0
    targets = [torch.from_numpy(each) for each in (drawings.family, drawings.numbers, drawings.choices)]
    started = time.process_time()
    for epoch in range(epochs):
        sums: dict[str, float] = {}
        network.train()
        for rows in _batches(len(drawings.family), generator):
            pictures = _changed(torch.from_numpy(drawings.pictures[rows.numpy()]).float() / 255, generator)
            parts = losses(network(pictures), *(each[rows] for each in targets))
            loss = parts["family"] + _NUMBERS_WEIGHT * parts["numbers"] + 0.5 * parts["choices"]
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            step += 1
            rise = min(20 * step / steps, 1.0)
            rate = _RATE * rise * 0.5 * (1 + math.cos(math.pi * step / steps))
            optimizer.param_groups[0]["lr"] = rate
            with torch.no_grad():
                for weight in weights:
                    weight.mul_(1 - rate * _DECAY)
            optimizer.step()
            for name, value in parts.items():
                sums[name] = sums.get(name, 0.0) + float(value.detach()) * len(rows) / len(drawings.family)
        spent = time.process_time() - started
        report(
            f"epoch {epoch + 1}: " + "  ".join(f"{k} {v:.4f}" for k, v in sums.items()) + f"  ({spent:.0f} s of CPU)"
        )
    return network.eval()


def measured(network: SketchNetwork, drawings: Drawings) -> dict[str, float]:
    """Return how well a network reads drawings.

    Returns
    -------
    dict
        `top_1` and `top_3`: share of families that are right. `number_error`: mean absolute error of the numbers as a
        share of their ranges, and `choices` the share of right choices, both with the true family.
    """
    network.eval()
    right = {1: 0, 3: 0}
    errors: list[float] = []
    choices: list[bool] = []
    for first in range(0, len(drawings.family), 256):
        some = drawings.part(slice(first, first + 256))
        with torch.no_grad():
            look = network(torch.from_numpy(some.pictures)[:, None].float() / 255)
        order = look.family.argsort(1, descending=True).numpy()
        for most in right:
            right[most] += int((order[:, :most] == some.family[:, None]).any(1).sum())
        for index, (name, about) in enumerate(FAMILIES.items()):
            rows = np.flatnonzero(some.family == index)
            values = look.numbers[name].clamp(0, 1).numpy()[rows]
            errors += np.abs(values - some.numbers[rows, : len(about.numbers)]).ravel().tolist()
            for place, logits in enumerate(look.choices[name]):
                choices += (logits.argmax(1).numpy()[rows] == some.choices[rows, place]).tolist()
    count = len(drawings.family)
    return {
        "top_1": right[1] / count,
        "top_3": right[3] / count,
        "number_error": float(np.mean(errors)),
        "choices": float(np.mean(choices)),
    }


def _batches(count: int, generator: torch.Generator) -> Iterator[Tensor]:
    """Yield shuffled batches of row numbers; the last rows of an epoch that fill no batch are left out."""
    order = torch.randperm(count, generator=generator)
    size = min(_BATCH, count)
    for first in range(0, count - size + 1, size):
        yield order[first : first + size]


def _changed(pictures: Tensor, generator: torch.Generator) -> Tensor:
    """Return pictures (B, H, W) as (B, 1, H, W), mirrored, shifted and with something missing."""
    count, side = len(pictures), pictures.shape[-1]
    mirrored = torch.rand(count, generator=generator) < 0.5
    pictures = torch.where(mirrored[:, None, None], pictures.flip(2), pictures)
    across, down = torch.randint(-2, 3, (2,), generator=generator).tolist()
    pictures = pictures.roll((down, across), (1, 2)).clone()
    places = torch.randint(0, side - 10, (count, 2), generator=generator).tolist()
    for row, missing in enumerate((torch.rand(count, generator=generator) < 0.3).tolist()):
        if missing:
            y, x = places[row]
            pictures[row, y : y + 10, x : x + 10] = 0
    return pictures[:, None]


def _drawings(path: Path | None, count: int, seed: int, report: Callable[[str], None]) -> Drawings:
    """Return the drawings of a cache file, which is made if it is missing."""
    if path is not None and path.exists():
        with np.load(path) as archive:
            return Drawings(*(archive[name] for name in ("pictures", "family", "numbers", "choices")))
    drawings = make_drawings(count, seed, report)
    if path is not None:
        np.savez_compressed(path, **vars(drawings))
    return drawings


def main(arguments: list[str] | None = None) -> None:
    """Make or read the drawings, train, measure on held-out members, and write the weights."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--drawings", type=int, default=1200)
    parser.add_argument("--epochs", type=int, default=12)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--strangers", type=float, default=0.125, help="drawings of no family for each other one")
    parser.add_argument("--cache", type=Path, help="keep the drawings in this file")
    parser.add_argument("-o", "--output", type=Path, default=WEIGHTS)
    options = parser.parse_args(arguments)

    def told(line: str) -> None:
        print(line, flush=True)

    torch.set_num_threads(1)
    drawings = _drawings(options.cache, options.drawings, options.seed, told)
    held_out = max(int(_HELD_OUT * len(drawings.family)), 1)
    strangers = make_strangers(int(options.strangers * len(drawings.family)), options.seed)
    shown = drawings.part(slice(held_out, None)).with_more(strangers)
    network = train(shown, options.epochs, options.seed, told)
    measures = measured(network, drawings.part(slice(held_out)))
    told("held out: " + "  ".join(f"{name} {value:.4f}" for name, value in measures.items()))
    settings = {
        name: str(value) for name, value in vars(options).items() if name in ("drawings", "epochs", "seed", "strangers")
    }
    write_network(
        options.output, network, settings | {"version": __version__} | {k: f"{v:.4f}" for k, v in measures.items()}
    )


if __name__ == "__main__":
    main()
