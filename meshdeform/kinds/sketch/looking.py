"""Look at a drawing: how likely it shows each noun.

The histograms of a picture's gradients are projected to where drawings of one thing lie close and those of others apart
(Fisher's linear discriminants), and a noun is as likely as its own places are near there: the means of what people drew
(Quick, Draw! by Google, CC-BY 4.0), and of the lines of its members. A new noun or a word of somebody's own has the
mean of the lines of its members. `training/sketch` fits the projection.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from safetensors import SafetensorError, safe_open
from scipy.ndimage import gaussian_filter1d

from meshdeform.assets.drawing import prepared
from meshdeform.errors import ModelError
from meshdeform.kinds.sketch.lines import Pictures

__all__ = ["WEIGHTS", "Projection", "gradients", "inked", "read_projection"]

WEIGHTS = Path(__file__).parent / "weights" / "sketch.safetensors"
"""The weights that are part of the package."""
_ADVICE = "Install meshdeform again (the weights are part of the package), or train: python -m training.sketch.train."
_BLUR, _CELL, _WAYS = 0.7, 8, 9

Singles = NDArray[np.float32]


def gradients(pictures: Singles) -> Singles:
    """Return histograms of oriented gradients (N, D) of pictures (N, S, S): unsigned, blocks of 2 x 2 cells.

    Source: Dalal and Triggs 2005.
    """
    cells = _oriented(pictures)
    side = cells.shape[1]
    blocks = np.concatenate([cells[:, i : side - 1 + i, j : side - 1 + j] for i in (0, 1) for j in (0, 1)], -1)
    blocks /= np.linalg.norm(blocks, axis=-1, keepdims=True) + 0.1
    return np.asarray(blocks.reshape(len(pictures), -1), np.float32)


def _oriented(pictures: Singles) -> Singles:
    """Return how much ink runs which way in each cell of pictures (N, S, S), (N, S / 8, S / 8, 9).

    The size of the gradient, divided between the two nearest of the ways.
    """
    rows, columns = (gaussian_filter1d(pictures.astype(np.float32), _BLUR, axis) for axis in (1, 2))
    dx, dy = gaussian_filter1d(rows, 1.0, 2, order=1), gaussian_filter1d(columns, 1.0, 1, order=1)
    size, place = np.hypot(dx, dy), np.mod(np.arctan2(dy, dx), np.pi) / np.pi * _WAYS
    low = place.astype(np.int64)
    share = place - low
    count, side = len(pictures), pictures.shape[1] // _CELL
    at = np.arange(pictures.shape[1]) // _CELL
    first = ((np.arange(count)[:, None, None] * side + at[:, None]) * side + at) * _WAYS
    total = np.zeros(count * side * side * _WAYS)
    for way, part in ((low % _WAYS, 1 - share), ((low + 1) % _WAYS, share)):
        total += np.bincount((first + way).ravel(), (size * part).ravel(), len(total))
    return np.asarray(total.reshape(count, side, side, _WAYS), np.float32)


def inked(lines: Pictures) -> Singles:
    """Return lines as a drawing that was `prepared`."""
    return prepared(Image.fromarray(np.where(lines > 0, 0, 255).astype(np.uint8)))


@dataclass(frozen=True)
class Projection:
    """The projection, and what lies where.

    `arrays`: `projection` (D, E); `people` and `members` (D,), the middles of both kinds of lines; `places` (R, E), of
    length 1, with the class `of` each (R,) and its `offset` (R,); `scale`. Classes are the nouns by their order, and
    after them things that are no noun of ours.
    """

    arrays: Mapping[str, NDArray[Any]]
    nouns: tuple[str, ...]

    def placed(self, pictures: Singles, *, of_members: bool = False) -> Singles:
        """Return the places (N, E) of drawings or lines of members (N, SIDE, SIDE), with those of their mirrors."""
        found = (gradients(pictures) + gradients(pictures[:, :, ::-1])) / 2
        found = (found - self.arrays["members" if of_members else "people"]) @ self.arrays["projection"]
        return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))

    def likelihoods(self, picture: Singles, new: Mapping[str, Singles]) -> dict[str, float]:
        """Return how likely a drawing (SIDE, SIDE) shows each noun; `new`: places (E,) of nouns that are new or other.

        What is left to 1 is how likely it shows something else.
        """
        of = self.arrays["of"].astype(np.int64)
        known = np.full(int(of.max()) + 1, -np.inf)
        place, scale = self.placed(picture[None])[0], float(self.arrays["scale"])
        np.maximum.at(known, of, scale * (self.arrays["places"] @ place + self.arrays["offset"]))
        lower = float(self.arrays["offset"].min())
        scores = dict(zip(self.nouns, known.tolist(), strict=False))
        scores |= {noun: scale * (float(each @ place) + lower) for noun, each in new.items()}
        others = known[len(self.nouns) :]
        every = np.array([*scores.values(), *others])
        likely = np.exp(every - every.max())
        return dict(zip(scores, (likely / likely.sum()).tolist(), strict=False))


@cache
def read_projection(path: Path = WEIGHTS) -> Projection:
    """Return the projection of a file of weights; a file is read once.

    Raises
    ------
    ModelError
        The file is missing or damaged.
    """
    try:
        with safe_open(path, "np") as file:
            nouns = file.metadata()["nouns"].split()
            arrays: dict[str, NDArray[Any]] = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError, KeyError, TypeError) as error:
        raise ModelError(f"The weights for drawings {path.name} cannot be read.", advice=_ADVICE) from error
    return Projection({name: each.astype(np.float32) for name, each in arrays.items()}, tuple(nouns))
