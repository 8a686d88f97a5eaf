"""Compute the network of the builtin prior in 8-bit integers, on processors with instructions for them.

A convolution multiplies unsigned bytes of the picture by signed bytes of the weights, adds up in 32-bit integers, and
returns float32; oneDNN, which torch brings along, does this. Weights have one step per output channel, and 7 bits.
Pictures have one step each, which follows their extremes in every pass, so nothing is calibrated, and what is predicted
of a picture does not depend on the others of its batch. Texts, times, azimuths and the sums of the residual blocks stay
in float32.

Source: Jacob et al. 2018, Quantization and training of neural networks for efficient integer-arithmetic-only inference.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from meshdeform.priors.builtin.compiled_quantization import dequantize, quantize, quantize_normed, round_weights
from meshdeform.priors.builtin.network import AttentionBlock, PriorNetwork, ResidualBlock

__all__ = ["is_usable", "quantized"]

_Floats = NDArray[np.float32]

_LARGEST_WEIGHT = 63
"""Of 7 bits. AVX2 adds up the products of two pairs of bytes in 16 bits, where 2 x 255 x 63 is not too much."""


@dataclass(frozen=True)
class _Levels:
    """Pictures (B, H, W, C) of bytes with a border.

    `steps` (B, 2) has of each picture the step between two levels and the level of 0: ``step (values - zero)``.
    """

    values: NDArray[np.uint8]
    steps: NDArray[np.float32]


def _rows(picture: Tensor) -> _Floats:
    """Return a picture (B, C, H, W) as (B, H, W, C), without a copy if its channels come last in memory."""
    rows: _Floats = picture.permute(0, 2, 3, 1).contiguous().numpy()
    return rows


def _picture(rows: _Floats) -> Tensor:
    return torch.from_numpy(rows).permute(0, 3, 1, 2)


def _room(rows: _Floats, border: int) -> _Levels:
    batch, height, width, channels = rows.shape
    values = np.empty((batch, height + 2 * border, width + 2 * border, channels), np.uint8)
    return _Levels(values, np.empty((batch, 2), np.float32))


def _levels(rows: _Floats, border: int = 0) -> _Levels:
    """Quantise pictures (B, H, W, C)."""
    made = _room(rows, border)
    quantize(rows, border, made.values, made.steps)
    return made


def _normed(
    rows: _Floats, gain: _Floats, shift: _Floats, groups: int, *, silu: bool = True, border: int = 1
) -> _Levels:
    """Quantise pictures (B, H, W, C) after a group norm, scaled and shifted by (B, C) each, and SiLU."""
    made = _room(rows, border)
    quantize_normed(rows, gain, shift, groups, silu, border, made.values, made.steps)
    return made


class _Norm(nn.Module):
    """A group norm, with SiLU behind it unless `silu` is false, whose output is bytes."""

    def __init__(self, norm: nn.GroupNorm, *, silu: bool = True, border: int = 1) -> None:
        super().__init__()
        self._gain, self._shift = norm.weight.detach()[None].numpy(), norm.bias.detach()[None].numpy()
        self._groups, self._silu, self._border = norm.num_groups, silu, border

    def forward(self, x: Tensor) -> _Levels:
        """Quantise the norm of a picture (B, C, H, W) float32."""
        return self.of_rows(_rows(x))

    def of_rows(self, rows: _Floats) -> _Levels:
        """Quantise the norm of pictures (B, H, W, C)."""
        return _normed(rows, self._gain, self._shift, self._groups, silu=self._silu, border=self._border)


class _Convolution(nn.Module):
    """A convolution whose weights are bytes; its output is float32.

    Its input has a border in place of padding. So every weight meets a pixel, and what the zero point adds is the same
    everywhere. oneDNN would add up the weights again in each call, on one thread.
    """

    def __init__(self, layer: nn.Conv2d) -> None:
        super().__init__()
        weight = layer.weight.detach().float()
        self._steps = weight.abs().amax((1, 2, 3)).clamp_min(1e-12) / _LARGEST_WEIGHT
        scaled = (weight / self._steps[:, None, None, None]).contiguous().flatten(2)
        signed = round_weights(scaled.numpy(), _LARGEST_WEIGHT)
        self._signed = torch.from_numpy(signed).view_as(weight)
        self._stride, self._border = list(layer.stride), int(layer.padding[0])
        self._zeros = torch.zeros(len(weight), dtype=torch.int64)
        bias = torch.zeros(len(weight)) if layer.bias is None else layer.bias.detach().float()
        self._bias, self._sums = bias.numpy(), (self._signed.sum((1, 2, 3)) * self._steps).numpy()
        self._packed: Tensor | None = None

    def forward(self, picture: Tensor | _Levels) -> Tensor:
        """Convolve a picture (B, C, H, W) float32, or pictures of bytes."""
        return _picture(self.to_rows(picture if isinstance(picture, _Levels) else _rows(picture)))

    def to_rows(self, rows: _Floats | _Levels, added: _Floats | None = None) -> _Floats:
        """Convolve pictures (B, H, W, C), and add others to the result."""
        x = rows if isinstance(rows, _Levels) else _levels(rows, self._border)
        levels = torch.from_numpy(x.values).permute(0, 3, 1, 2)
        if self._packed is None:
            # In an order that suits the first picture. Without its size, each call would reorder all weights.
            self._packed = torch.ops.onednn.qconv_prepack(
                self._signed, self._steps, 1.0, 0, self._stride, [0, 0], [1, 1], 1, levels.shape
            )
        result: Tensor = torch.ops.onednn.qconv2d_pointwise(
            levels, 1.0, 0, self._packed, self._steps, self._zeros, None,
            self._stride, [0, 0], [1, 1], 1, 1.0, 0, torch.float32, "none", [], None,
        )  # fmt: skip
        out = _rows(result)
        dequantize(out, x.steps, self._sums, self._bias, added)
        return out


class _Modulation(nn.Module):
    """One product for the second norms of all residual blocks.

    Such a norm is scaled by ``gamma (1 + scale)`` and shifted by ``beta (1 + scale) + offset``, where a layer makes
    scale and offset of the condition. Both are linear in the condition.
    """

    def __init__(self, blocks: Iterable[ResidualBlock]) -> None:
        super().__init__()
        weights, biases = [], []
        for block in blocks:
            gamma, beta, layer = block.norm_out.weight, block.norm_out.bias, block.condition
            (scale, offset), (scale_bias, offset_bias) = layer.weight.chunk(2), layer.bias.chunk(2)
            weights += [gamma[:, None] * scale, beta[:, None] * scale + offset]
            biases += [gamma * (1 + scale_bias), beta * (1 + scale_bias) + offset_bias]
        self._weight, self._bias = torch.cat(weights).detach(), torch.cat(biases).detach()

    def forward(self, condition: Tensor) -> Tensor:
        """Return the gains and shifts (B, sum of 2 C) of all blocks in turn, of a condition (B, E) float32."""
        return functional.linear(condition, self._weight, self._bias)


class _ResidualBlock(nn.Module):
    """`network.ResidualBlock` in bytes; what `_Modulation` returns has its gains and shifts from column `begin` on."""

    def __init__(self, block: ResidualBlock, begin: int) -> None:
        super().__init__()
        self._norm_in, self._groups = _Norm(block.norm_in), block.norm_out.num_groups
        self._gains = slice(begin, begin + block.norm_out.num_channels)
        self._shifts = slice(self._gains.stop, self._gains.stop + block.norm_out.num_channels)
        self._conv_in, self._conv_out = _Convolution(block.conv_in), _Convolution(block.conv_out)
        self._skip = None if isinstance(block.skip, nn.Identity) else _Convolution(block.skip)

    def forward(self, x: Tensor, modulation: Tensor) -> Tensor:
        """Map (B, inner, H, W) float32 to (B, outer, H, W)."""
        rows, both = _rows(x), modulation.numpy()
        gain, shift = (np.ascontiguousarray(both[:, columns]) for columns in (self._gains, self._shifts))
        h = _normed(self._conv_in.to_rows(self._norm_in.of_rows(rows)), gain, shift, self._groups)
        return _picture(self._conv_out.to_rows(h, self._skip.to_rows(rows) if self._skip else rows))


class _AttentionBlock(nn.Module):
    """`network.AttentionBlock` with its products of weights in bytes."""

    def __init__(self, block: AttentionBlock) -> None:
        super().__init__()
        self.heads, self.norm = block.heads, _Norm(block.norm, silu=False, border=0)
        self.qkv, self.out = _Convolution(block.qkv), _Convolution(block.out)

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, C, H, W) float32 to the same shape."""
        rows = _rows(x)
        batch, height, width, channels = rows.shape
        qkv = self.qkv.to_rows(self.norm.of_rows(rows)).reshape(batch, height * width, 3, self.heads, -1)
        query, key, value = torch.from_numpy(qkv).permute(2, 0, 3, 1, 4).unbind(0)
        mixed = functional.scaled_dot_product_attention(query, key, value).transpose(1, 2)
        return _picture(self.out.to_rows(mixed.reshape(batch, height, width, channels).numpy(), rows))


@functools.cache
@torch.no_grad()
def is_usable() -> bool:
    """Return whether torch's operator, which is no part of its public interface, does what is expected of it here."""
    layer = nn.Conv2d(4, 8, 3, padding=1)
    layer.weight.copy_(torch.linspace(-1, 1, layer.weight.numel()).view_as(layer.weight))
    picture = torch.linspace(-1, 2, 4 * 5 * 5).view(1, 4, 5, 5)
    try:
        apart = (_Convolution(layer)(picture) - layer(picture)).abs().max()
    except (AttributeError, NotImplementedError, RuntimeError, TypeError):
        return False
    return float(apart) < 0.2  # of sums up to 20; the rounding of bytes makes up to 0.06


def quantized(network: PriorNetwork) -> PriorNetwork:
    """Replace the layers of a network in float32 by layers in bytes, in place, and return it."""
    layers = dict(network.named_modules())
    blocks = {name: layer for name, layer in layers.items() if isinstance(layer, ResidualBlock)}
    begins = accumulate((2 * block.norm_out.num_channels for block in blocks.values()), initial=0)
    made: dict[str, nn.Module] = {
        "modulate": _Modulation(blocks.values()),
        "norm": _Norm(network.norm),
        "activation": nn.Identity(),
        **{name: _Convolution(layers[name]) for name in ("pool0", "pool1", "out")},
        **{name: _ResidualBlock(block, begin) for (name, block), begin in zip(blocks.items(), begins, strict=False)},
        **{name: _AttentionBlock(layer) for name, layer in layers.items() if isinstance(layer, AttentionBlock)},
    }
    for name, layer in made.items():
        parent, _, last = name.rpartition(".")
        setattr(network.get_submodule(parent), last, layer)
    return network
