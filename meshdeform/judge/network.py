"""Read the judge's network, and run it in numpy.

The network is a small residual one that classifies a single view: a strided stem, three blocks that halve the picture,
the mean over what is left of it, and a linear layer. Batch norms are folded into the convolutions before them, and a
convolution is a product of matrices. `training.judge.network` has the same network in torch.

The weights are half precision safetensors that record their vocabulary.

Source: He et al. 2016 (residual networks).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from meshdeform.errors import ModelError

WEIGHTS = Path(__file__).parent / "weights" / "judge.safetensors"
ADVICE = (
    "Install meshdeform again (the weights are part of the package), or train them: python -m training.judge.train."
)

_EPSILON = 1e-5  # of the batch norms, as in torch
_Singles = NDArray[np.float32]
_State = Mapping[str, _Singles]


@dataclass(frozen=True)
class JudgeConfig:
    """Sizes of the network, whose defaults are those of the shipped weights, and the nouns that it tells apart."""

    nouns: tuple[str, ...]
    stem: int = 24
    channels: tuple[int, int, int] = (64, 128, 256)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes of all weights by their names."""
        shapes: dict[str, tuple[int, ...]] = {"stem.0.weight": (self.stem, 1, 5, 5), **_norm("stem.1", self.stem)}
        for number, (inner, outer) in enumerate(zip((self.stem, *self.channels), self.channels, strict=False)):
            block = f"blocks.{number}"
            shapes |= {f"{block}.conv_in.weight": (outer, inner, 3, 3), **_norm(f"{block}.norm_in", outer)}
            shapes |= {f"{block}.conv_out.weight": (outer, outer, 3, 3), **_norm(f"{block}.norm_out", outer)}
            shapes[f"{block}.skip.weight"] = (outer, inner, 1, 1)
        count = len(self.nouns)
        head: dict[str, tuple[int, ...]] = {"noun_head.weight": (count, self.channels[-1]), "noun_head.bias": (count,)}
        return shapes | head | {"sharpness": (), "commonness": (count,)}


def _norm(name: str, channels: int) -> dict[str, tuple[int, ...]]:
    return {f"{name}.{part}": (channels,) for part in ("weight", "bias", "running_mean", "running_var")}


@dataclass(frozen=True)
class JudgeWeights:
    """The contents of a file: sizes, weights by name in float32, and metadata."""

    config: JudgeConfig
    state: _State
    metadata: dict[str, str]


def read_weights(path: Path = WEIGHTS) -> JudgeWeights:
    """Read a file of weights.

    Raises
    ------
    ModelError
        The file is missing, not safetensors, or of another network.
    """
    if not path.is_file():
        raise ModelError(f"The judge's weights are missing: there is no {path.name} in {path.parent}.", advice=ADVICE)
    try:
        with safe_open(path, framework="np") as file:
            metadata = dict(file.metadata() or {})
            state = {name: file.get_tensor(name).astype(np.float32) for name in file.keys()}  # noqa: SIM118 (not a dict)
    except SafetensorError as error:
        raise ModelError(f"The judge's weights in {path} cannot be read: {error}.", advice=ADVICE) from error
    try:
        sizes = json.loads(metadata["config"])
        config = JudgeConfig(tuple(sizes["nouns"]), sizes["stem"], tuple(sizes["channels"]))
        fits = {name: each.shape for name, each in state.items()} == config.shapes()
    except (KeyError, TypeError, ValueError) as error:
        raise ModelError(f"The judge's weights in {path} are of another network.", advice=ADVICE) from error
    if not fits:
        raise ModelError(f"The judge's weights in {path} are of another network.", advice=ADVICE)
    return JudgeWeights(config, state, metadata)


class Network:
    """Network that classifies single views."""

    def __init__(self, weights: JudgeWeights) -> None:
        state = weights.state
        self._stem = _Convolution.folded(state, "stem.0", "stem.1")
        self._blocks = [_Block(state, f"blocks.{number}") for number in range(len(weights.config.channels))]
        self._head, self._bias = state["noun_head.weight"].T, state["noun_head.bias"]
        self.commonness = state["commonness"]
        """(N,): how much likelier each noun is of somebody's asset, as a logarithm."""
        self.sharpness = float(state["sharpness"])
        """Factor of the mean over the views: views of one mesh are correlated, so their sum would be overconfident."""

    def logits(self, images: _Singles) -> _Singles:
        """Return the logits (B, N) of the nouns for views (B, 64, 64) float32 from `draw_views`."""
        x = np.maximum(self._stem(images[..., None] * np.float32(2) - np.float32(1), 2), 0)
        for block in self._blocks:
            x = block(x)
        logits: _Singles = x.mean((1, 2)) @ self._head + self._bias
        return logits


class _Block:
    """Two 3 x 3 convolutions that halve the picture, with a 1 x 1 convolution as shortcut."""

    def __init__(self, state: _State, name: str) -> None:
        self._inner = _Convolution.folded(state, f"{name}.conv_in", f"{name}.norm_in")
        self._outer = _Convolution.folded(state, f"{name}.conv_out", f"{name}.norm_out")
        self._skip = state[f"{name}.skip.weight"][:, :, 0, 0].T

    def __call__(self, x: _Singles) -> _Singles:
        """Map (B, H, W, inner) to (B, H / 2, W / 2, outer)."""
        found = self._outer(np.maximum(self._inner(x, 2), 0), 1)
        found += x[:, ::2, ::2] @ self._skip
        return np.maximum(found, 0)


@dataclass(frozen=True)
class _Convolution:
    """A convolution as a matrix (side^2 inner, outer) and a bias (outer,)."""

    matrix: _Singles
    bias: _Singles
    side: int

    @classmethod
    def folded(cls, state: _State, name: str, norm: str) -> _Convolution:
        """Return a convolution with the batch norm that follows it."""
        weight, scale, shift, mean, variance = (
            state[each].astype(np.float64) for each in (f"{name}.weight", *_norm(norm, 0))
        )
        scale = scale / np.sqrt(variance + _EPSILON)
        matrix = weight.transpose(2, 3, 1, 0).reshape(-1, len(weight)) * scale
        return cls(matrix.astype(np.float32), (shift - mean * scale).astype(np.float32), weight.shape[-1])

    def __call__(self, x: _Singles, stride: int) -> _Singles:
        """Map (B, H, W, inner) to (B, H / stride, W / stride, outer)."""
        margin = self.side // 2
        padded = np.pad(x, ((0, 0), (margin, margin), (margin, margin), (0, 0)))
        windows = np.lib.stride_tricks.sliding_window_view(padded, (self.side, self.side), (1, 2))
        columns = windows[:, ::stride, ::stride].transpose(0, 1, 2, 4, 5, 3)
        rows = columns.reshape(-1, len(self.matrix)) @ self.matrix + self.bias
        return np.asarray(rows.reshape(*columns.shape[:3], -1))
