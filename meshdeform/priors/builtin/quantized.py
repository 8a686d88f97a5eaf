"""Compute the network of the builtin prior in 8-bit integers, on processors with instructions for them.

A convolution multiplies unsigned bytes of the picture by signed bytes of the weights, adds up in 32-bit integers, and
returns float32; oneDNN, which torch brings along, does this. Weights have one step per output channel, and 7 bits.
Pictures have one step each, which follows their extremes in every pass, so nothing is calibrated, and what is predicted
of a picture does not depend on the others of its batch. Texts, times, azimuths and the sums of the residual blocks stay
in float32.

Source: Jacob et al. 2018, Quantization and training of neural networks for efficient integer-arithmetic-only inference.

Weights and pictures are quantised, and that is undone, by compiled loops. Pictures are normalised and activated in the
same two walks::

    y = a_c x + b_c               the group norm, scaled and shifted, per channel
    s = y sigmoid(y)              SiLU (optional)
    q = round(s / step) + zero    unsigned, 8 bits; one step, and one level that means 0, for each picture

The first walk finds the sums and the extremes of each channel. Since y is linear in x, and SiLU has one minimum, they
bound s before it is computed, so nothing is stored between the walks. sigmoid(y) = (1 + tanh(y / 2)) / 2, with a
rational approximation of tanh: unlike an exponential it becomes vector instructions. SiLU is off by at most 0.0002, far
less than a step of 8 bits.

Sources: Wu & He 2018 (group norm); Jacob et al. 2018, Quantization and training of neural networks, eq. 1; Guo et al.
2022, SQuant: on-the-fly data-free quantization (rounding that keeps sums).
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import accumulate

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from meshdeform.geometry.kernels import kernel
from meshdeform.priors.builtin.network import AttentionBlock, PriorNetwork, ResidualBlock

_Floats = NDArray[np.float32]
_Bytes = NDArray[np.uint8]
_f = np.float32

_LEVELS = 254.0
"""One less than there are: rounding the level of 0 may move all others by half a level, and none may leave the byte."""

_SILU_MINIMUM = -0.27846454
_BOUND = _f(5.5)
_A1, _A3, _A5 = _f(9.98813525e-01), _f(9.75553740e-02), _f(5.60992395e-04)

_B2, _B4 = _f(4.28842890e-01), _f(1.15567037e-02)
"""tanh(z) is about z (A1 + A3 z^2 + A5 z^4) / (1 + B2 z^2 + B4 z^4), with z kept within the bound. The numbers make the
largest error of SiLU smallest."""

_EPSILON = 1e-5
"""Added to the variance, as in `torch.nn.GroupNorm`."""

_LARGEST_WEIGHT = 63
"""Of 7 bits. AVX2 adds up the products of two pairs of bytes in 16 bits, where 2 x 255 x 63 is not too much."""


# Without `error_model`, a test for a divisor of zero would keep loops from becoming vector instructions, and so would
# the order of sums without `fastmath`. The order is fixed when it is compiled, so equal input gives equal bits.
@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _measure(x: _Floats, total: _Floats, squares: _Floats, low: _Floats, high: _Floats) -> None:
    """Fill in the sum, the sum of squares, the smallest and the largest number of each channel of x (P, C)."""
    pixels, channels = x.shape
    for c in range(channels):
        total[c] = squares[c] = _f(0)
        low[c] = high[c] = x[0, c]
    # Four pixels at a time, because reading and writing what is found takes longer than to find it.
    whole = pixels - pixels % 4
    for p in range(0, whole, 4):
        row_0, row_1, row_2, row_3 = x[p], x[p + 1], x[p + 2], x[p + 3]
        for c in range(channels):
            v0, v1, v2, v3 = row_0[c], row_1[c], row_2[c], row_3[c]
            total[c] += (v0 + v1) + (v2 + v3)
            squares[c] += (v0 * v0 + v1 * v1) + (v2 * v2 + v3 * v3)
            low[c] = min(low[c], min(min(v0, v1), min(v2, v3)))
            high[c] = max(high[c], max(max(v0, v1), max(v2, v3)))
    for p in range(whole, pixels):
        row = x[p]
        for c in range(channels):
            value = row[c]
            total[c] += value
            squares[c] += value * value
            low[c] = min(low[c], value)
            high[c] = max(high[c], value)


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _write_activated(x: _Floats, a: _Floats, b: _Floats, inverse: _f, zero: _f, out: _Bytes) -> None:
    """Write ``silu(a x + b) inverse + zero``, rounded, for x (P, C); a and b are (C,)."""
    for p in range(x.shape[0]):
        row, to = x[p], out[p]
        for c in range(x.shape[1]):
            half = _f(0.5) * (row[c] * a[c] + b[c])
            z = -_BOUND if half < -_BOUND else half
            z = _BOUND if z > _BOUND else z
            w = z * z
            tanh = ((_A5 * w + _A3) * w + _A1) * z / ((_B4 * w + _B2) * w + _f(1))
            level = half * inverse * (_f(1) + tanh) + zero + _f(0.5)
            to[c] = np.uint8(np.int32(level))


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _write_linear(x: _Floats, a: _Floats, b: _Floats, inverse: _f, zero: _f, out: _Bytes) -> None:
    """Write ``(a x + b) inverse + zero``, rounded, for x (P, C); a and b are (C,)."""
    for p in range(x.shape[0]):
        row, to = x[p], out[p]
        for c in range(x.shape[1]):
            level = (row[c] * a[c] + b[c]) * inverse + zero + _f(0.5)
            to[c] = np.uint8(np.int32(level))


@kernel
def _steps(low: float, high: float) -> tuple[float, float]:
    """Return the scale and the zero point of 8 bits for numbers from `low` to `high`; 0 is always one of the levels."""
    low, high = min(low, 0.0), max(high, 0.0)
    scale = (high - low) / _LEVELS
    if not scale > 0.0:
        return 1.0, 0.0
    return scale, np.floor(-low / scale + 0.5)


@kernel
def _write(x: _Floats, a: _Floats, b: _Floats, silu: bool, step: float, zero: float, border: int, out: _Bytes) -> None:
    """Write one picture x (H, W, C) into the middle of `out`, and the level of 0 around it."""
    height, width, _ = x.shape
    inverse, level = np.float32(1.0 / step), np.float32(zero)
    for row in range(border):
        out[row] = np.uint8(zero)
        out[-1 - row] = np.uint8(zero)
    for row in range(height):
        to = out[row + border]
        to[:border] = np.uint8(zero)
        to[border + width :] = np.uint8(zero)
        if silu:
            _write_activated(x[row], a, b, inverse, level, to[border : border + width])
        else:
            _write_linear(x[row], a, b, inverse, level, to[border : border + width])


@kernel
def quantize_normed(
    x: _Floats, gain: _Floats, shift: _Floats, groups: int, silu: bool, border: int, out: _Bytes, levels: _Floats
) -> None:
    """Quantise ``silu(gain group_norm(x) + shift)``, or the same without SiLU.

    `x` is (B, H, W, C) float32; `gain` and `shift` are both (B, C), or both (1, C) for all pictures, float32; `groups`:
    divisor of C; `border`: width of the border of `out`, in pixels, whose level means 0; `out`, (B, H + 2 border, W + 2
    border, C) uint8: filled in; `levels`, (B, 2) float32: filled in for each picture: the step between two levels, and
    the level of 0.
    """
    batch, height, width, channels = x.shape
    total, squares = np.empty(channels, np.float32), np.empty(channels, np.float32)
    lows, highs = np.empty(channels, np.float32), np.empty(channels, np.float32)
    a, b = np.empty(channels, np.float32), np.empty(channels, np.float32)
    size = channels // groups
    for n in range(batch):
        _measure(x[n].reshape(height * width, channels), total, squares, lows, highs)
        low, high, row = 0.0, 0.0, n % len(gain)
        for begin in range(0, channels, size):
            end, count = begin + size, size * height * width
            sum_1, sum_2 = 0.0, 0.0
            for c in range(begin, end):
                sum_1 += total[c]
                sum_2 += squares[c]
            mean = sum_1 / count
            scale = 1.0 / np.sqrt(max(sum_2 / count - mean * mean, 0.0) + _EPSILON)
            for c in range(begin, end):
                product = scale * gain[row, c]
                offset = shift[row, c] - mean * product
                a[c], b[c] = product, offset
                one, other = product * lows[c] + offset, product * highs[c] + offset
                low = min(low, one, other)
                high = max(high, one, other)
        if silu:
            # SiLU falls to its minimum and rises from there, so no number between the extremes gives more or less.
            low, high = max(low, _SILU_MINIMUM), high / (1.0 + np.exp(-high))
        step, zero = _steps(low, high)
        _write(x[n], a, b, silu, step, zero, border, out[n])
        levels[n, 0], levels[n, 1] = step, zero


@kernel
def quantize(x: _Floats, border: int, out: _Bytes, levels: _Floats) -> None:
    """Quantise x (B, H, W, C) float32; the parameters are those of `quantize_normed`."""
    batch, height, width, channels = x.shape
    ones, zeros = np.ones(channels, np.float32), np.zeros(channels, np.float32)
    total, squares = np.empty(channels, np.float32), np.empty(channels, np.float32)
    lows, highs = np.empty(channels, np.float32), np.empty(channels, np.float32)
    for n in range(batch):
        _measure(x[n].reshape(height * width, channels), total, squares, lows, highs)
        step, zero = _steps(lows.min(), highs.max())
        _write(x[n], ones, zeros, False, step, zero, border, out[n])
        levels[n, 0], levels[n, 1] = step, zero


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")  # type: ignore[untyped-decorator]
def dequantize(x: _Floats, levels: _Floats, sums: _Floats, bias: _Floats, added: _Floats | None) -> None:
    """Turn the sums of a convolution over levels into those over the numbers that they mean, in place.

    ``step_n (x - zero_n sums) + bias``, where a convolution of ones would give `sums`, plus `added`, if given. `x`, (B,
    H, W, C) float32: changed; `levels`, (B, 2) float32: from `quantize` or `quantize_normed`; `sums` and `bias` are
    (C,) float32; `added` is (B, H, W, C) float32.
    """
    batch, height, width, channels = x.shape
    shift = np.empty(channels, np.float32)
    for n in range(batch):
        step = levels[n, 0]
        for c in range(channels):
            shift[c] = bias[c] - step * levels[n, 1] * sums[c]
        for p in range(height * width):
            row = x[n, p // width, p % width]
            # Compiled once without `added` and once with it: numba removes the branch.
            if added is not None:
                other = added[n, p // width, p % width]
                for c in range(channels):
                    row[c] = row[c] * step + shift[c] + other[c]
            else:
                for c in range(channels):
                    row[c] = row[c] * step + shift[c]


@kernel
def _keep_sum(x: _Floats, rounded: NDArray[np.int8], largest: int) -> None:
    """Move some of the rounded numbers to their other neighbour, so that their sum is within half a step of that of x.

    Those move first that lie closest to it. None goes beyond `largest`.
    """
    error = 0.0
    for i in range(len(x)):
        error += x[i] - rounded[i]
    direction = 1 if error > 0 else -1
    for _ in range(int(np.floor(abs(error) + 0.5))):
        best, at = -1.0, -1
        for i in range(len(x)):
            apart = direction * (x[i] - rounded[i])
            if apart > best and abs(rounded[i] + direction) <= largest:
                best, at = apart, i
        if at < 0:
            return
        rounded[at] += direction


@kernel
def round_weights(x: _Floats, largest: int) -> NDArray[np.int8]:
    """Round weights so that the errors of a kernel, and those of a whole filter, add up to at most half a step.

    A picture varies little from a pixel to its neighbours, and most of its channels are positive, so that errors which
    add up to zero hardly change a convolution. Rounding each weight to the nearest step would let them add up. `x`, (O,
    I, K) float32: weights in steps, from ``-largest`` to ``largest``; K are those of a kernel. Returns (O, I, K) int8.
    """
    outputs, inputs, size = x.shape
    rounded = np.empty((outputs, inputs * size), np.int8)
    for o in range(outputs):
        for i in range(inputs):
            kernel = rounded[o, i * size : (i + 1) * size]
            for k in range(size):
                kernel[k] = np.int8(np.floor(x[o, i, k] + np.float32(0.5)))
            _keep_sum(x[o, i], kernel, largest)
        _keep_sum(x[o].reshape(inputs * size), rounded[o], largest)
    return rounded.reshape(outputs, inputs, size)


@dataclass(frozen=True)
class _Levels:
    """Pictures (B, H, W, C) of bytes with a border."""

    # `steps` (B, 2) has of each picture the step between two levels and the level of 0: ``step (values - zero)``.

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
    levels = _room(rows, border)
    quantize(rows, border, levels.values, levels.steps)
    return levels


def _normed(
    rows: _Floats, gain: _Floats, shift: _Floats, groups: int, *, silu: bool = True, border: int = 1
) -> _Levels:
    """Quantise pictures (B, H, W, C) after a group norm, scaled and shifted by (B, C) each, and SiLU."""
    normed = _room(rows, border)
    quantize_normed(rows, gain, shift, groups, silu, border, normed.values, normed.steps)
    return normed


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
    """A convolution whose weights are bytes; its output is float32."""

    # Its input has a border in place of padding. So every weight meets a pixel, and what the zero point adds is the
    # same everywhere. oneDNN would add up the weights again in each call, on one thread.

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
    """One product for the second norms of all residual blocks."""

    # Such a norm is scaled by ``gamma (1 + scale)`` and shifted by ``beta (1 + scale) + offset``, where a layer makes
    # scale and offset of the condition. Both are linear in the condition.

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
    modules: dict[str, nn.Module] = {
        "modulate": _Modulation(blocks.values()),
        "norm": _Norm(network.norm),
        "activation": nn.Identity(),
        **{name: _Convolution(layers[name]) for name in ("pool0", "pool1", "out")},
        **{name: _ResidualBlock(block, begin) for (name, block), begin in zip(blocks.items(), begins, strict=False)},
        **{name: _AttentionBlock(layer) for name, layer in layers.items() if isinstance(layer, AttentionBlock)},
    }
    for name, layer in modules.items():
        parent, _, last = name.rpartition(".")
        setattr(network.get_submodule(parent), last, layer)
    return network
