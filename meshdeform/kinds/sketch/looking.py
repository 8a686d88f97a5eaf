"""Look at a drawing with the network's weights, without torch: loading torch takes far longer than one look.

`network` has the same layers for the training; a test compares what both see.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from meshdeform.assets.drawing import read_drawing
from meshdeform.errors import ModelError
from meshdeform.kinds.sketch.families import FAMILIES, family_of, member_glb
from meshdeform.requests.sketches import Value

WEIGHTS = Path(__file__).parent / "weights" / "sketch.safetensors"
"""The weights that are part of the package."""
WIDTHS = ((16, 2), (32, 2), (48, 1), (64, 2), (64, 1), (96, 2))
"""Channels and stride of each convolution."""
_ADVICE = "Install meshdeform again (the weights are part of the package), or train: python -m training.sketch.train."
_Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Seen:
    """The network's answer for one drawing."""

    probabilities: NDArray[np.float64]  # of the families
    shares: Mapping[str, NDArray[np.float64]]
    """mapping of str to (N,) float64: of each family, its numbers as shares of their ranges."""
    options: Mapping[str, list[int]]  # of each family, the likeliest option of each choice


def parameters_hash() -> str:
    """Return a hash of all families with their parameters; weights of others would be misread."""
    about = [f"{f.name}:{f.numbers}:{f.choices}" for f in FAMILIES.values()]
    return hashlib.sha256("\n".join(about).encode()).hexdigest()[:16]


@cache
def read_weights(path: Path = WEIGHTS) -> dict[str, NDArray[Any]]:
    """Return the arrays of a file of weights by name; a file is read once.

    Raises
    ------
    ModelError
        The file is missing or damaged, or it is of other families.
    """
    try:
        with safe_open(path, "np") as file:
            families = (file.metadata() or {}).get("families")
            state = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
    except (OSError, SafetensorError) as error:
        raise ModelError(f"The sketch network's weights {path.name} cannot be read.", advice=_ADVICE) from error
    if families != parameters_hash():
        raise ModelError(f"The sketch network's weights {path.name} are of other families.", advice=_ADVICE)
    return {name: each.astype(np.float32) if each.dtype == np.float16 else each for name, each in state.items()}


def look(picture: _Floats, weights: Mapping[str, NDArray[Any]]) -> Seen:
    """Look at a drawing (SIDE, SIDE) that `read_drawing` returned."""
    maps = picture[None]
    for index, (_, stride) in enumerate(WIDTHS):
        maps = _convolved(maps, weights[f"trunk.{3 * index}.weight"], stride)
        norm = {name: weights[f"trunk.{3 * index + 1}.{name}"][:, None, None] for name in _NORM}
        scale = norm["weight"] / np.sqrt(norm["running_var"] + 1e-5)
        maps = np.maximum((maps - norm["running_mean"]) * scale + norm["bias"], 0)
    # After the convolutions: flattening, dropout, which only the training has, and a layer.
    features = np.maximum(_layer(maps.reshape(-1), weights, f"trunk.{3 * len(WIDTHS) + 2}"), 0)
    logits = _layer(features, weights, "family").astype(np.float64)
    likely = np.exp(logits - logits.max())
    shares, options = {}, {}
    for name, family in FAMILIES.items():
        shares[name] = _layer(features, weights, f"numbers.{name}").astype(np.float64) + 0.5
        ends = np.cumsum([len(each.options) for each in family.choices])[:-1]
        options[name] = [int(each.argmax()) for each in np.split(_layer(features, weights, f"choices.{name}"), ends)]
    return Seen(likely / likely.sum(), shares, options)


_NORM = ("weight", "bias", "running_mean", "running_var")


def _convolved(maps: _Floats, kernels: _Floats, stride: int) -> _Floats:
    """Return maps (C, H, W) convolved with kernels (D, C, K, K), as large as before or by the stride smaller."""
    side = kernels.shape[-1]
    around = np.pad(maps, ((0, 0), (side // 2, side // 2), (side // 2, side // 2)))
    windows = np.lib.stride_tricks.sliding_window_view(around, (side, side), (1, 2))[:, ::stride, ::stride]
    return np.asarray(np.tensordot(kernels, windows, ((1, 2, 3), (0, 3, 4))))


def _layer(features: _Floats, weights: Mapping[str, NDArray[Any]], name: str) -> _Floats:
    return np.asarray(weights[f"{name}.weight"] @ features + weights[f"{name}.bias"])


SURE = 0.85
"""Probability of the first guess from which on it is sure; docs/sketch.md has what this threshold tells."""


@dataclass(frozen=True)
class Guess:
    """One reading of a drawing."""

    family: str
    probability: float  # that the drawing shows this family and none of the others
    values: dict[str, Value]  # all parameters of the family

    @classmethod
    def of(cls, family: str, probability: float, values: Mapping[str, object]) -> Self:
        """Return a guess with checked parameters; those left out have their default.

        Raises
        ------
        ParameterError
            There is no such family, a name is unknown, or a value is out of range.
        """
        return cls(family, probability, family_of(family).checked(values))

    def glb(self) -> bytes:
        """Return the mesh as `member_glb` does."""
        return member_glb(self.family, self.values)


def guess(data: bytes, *, family: str = "") -> list[Guess]:
    """Return what a drawing may show, the likeliest first.

    Parameters
    ----------
    data : bytes
        A PNG, JPEG or WebP with dark lines on a bright page, or the reverse.
    family : str
        The only family to consider. Default: all, of which the first three are returned.

    Raises
    ------
    DrawingError
        The picture is no line drawing.
    ParameterError
        There is no such family.
    ModelError
        The package's weights are missing or damaged.
    """
    if family:
        family_of(family)
    seen = look(read_drawing(data), read_weights())
    probabilities = seen.probabilities.tolist()
    names = list(FAMILIES)
    order = sorted(range(len(names)), key=lambda index: -probabilities[index])
    candidates = [index for index in order if not family or names[index] == family][:3]
    guesses = []
    for index in candidates:
        name = names[index]
        values = FAMILIES[name].values(seen.shares[name], seen.options[name])
        guesses.append(Guess(name, round(probabilities[index], 4), values))
    return guesses


def is_unsure(guesses: Sequence[Guess], *, family: str = "") -> bool:
    """Return whether a drawing may be of none of the families; never if its `family` was named."""
    return not family and guesses[0].probability < SURE
