"""Apply meshopt's filters, which expand unit vectors, quaternions, floats and colours from fewer bits.

Source: EXT_meshopt_compression and KHR_meshopt_compression, appendix B (filters 1 to 4), which allow one unit in the
last place. Results equal those of meshoptimizer's SIMD code, which viewers and browsers run: the same order of sums,
and halves rounded to even. Only its 8-bit octahedral filter for x86 differs: its reciprocal root is approximate, and
depends on the processor. Ours rounds all inputs exactly.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]


def apply_filter(name: str, elements: Bytes) -> Bytes:
    """Return the filtered elements, in the shape of the input.

    Parameters
    ----------
    name : str
        `NONE`, `OCTAHEDRAL`, `QUATERNION`, `EXPONENTIAL` or `COLOR`; the stride has been checked to fit.
    elements : (N, stride) uint8
        The decoded attribute stream.
    """
    if name == "NONE":
        return elements
    elements = np.ascontiguousarray(elements)
    # Values that the specification leaves undefined (a scale of zero) must not reject a file that never uses them.
    with np.errstate(all="ignore"):
        filtered = _FILTERS[name](elements)
    return np.ascontiguousarray(filtered).view(np.uint8).reshape(elements.shape)


def _rounded(values: NDArray[np.float32]) -> NDArray[np.int32]:
    """Round to the nearest integer, halves to even."""
    return np.nan_to_num(np.rint(values)).astype(np.int32)


def _octahedral(elements: Bytes) -> NDArray[Any]:
    packed = elements.view("<i1" if elements.shape[1] == 4 else "<i2")
    x, y, one = packed[:, :3].T.astype(np.float32)
    z = one - (np.abs(x) + np.abs(y))
    fold = np.minimum(z, np.float32(0.0))
    x, y = x - np.copysign(fold, x), y - np.copysign(fold, y)
    scale = np.float32(np.iinfo(packed.dtype).max) / np.sqrt(x * x + (y * y + z * z))
    unpacked = packed.copy()
    unpacked[:, :3] = _rounded(np.stack([x, y, z], axis=1) * scale[:, None]).astype(packed.dtype)
    return unpacked


def _quaternion(elements: Bytes) -> NDArray[Any]:
    packed = elements.view("<i2")
    scale = (np.float32(1.0) / np.sqrt(np.float32(2.0))) / (packed[:, 3] | 3).astype(np.float32)
    x, y, z = packed[:, :3].T.astype(np.float32) * scale
    largest = np.sqrt(np.maximum(np.float32(1.0) - (x * x + (y * y + z * z)), np.float32(0.0)))
    values = _rounded(np.stack([largest, x, y, z], axis=1) * np.float32(32767.0)).astype("<i2")
    unpacked = np.empty_like(packed)
    places = ((packed[:, 3] & 3)[:, None] + np.arange(4)) % 4
    np.put_along_axis(unpacked, places, values, axis=1)
    return unpacked


def _exponential(elements: Bytes) -> NDArray[Any]:
    packed = elements.view("<i4")
    mantissa, exponent = (packed << 8) >> 8, packed >> 24
    return np.asarray(np.ldexp(mantissa.astype(np.float32), exponent), "<f4")


def _color(elements: Bytes) -> NDArray[Any]:
    unsigned, signed = ("<u1", "<i1") if elements.shape[1] == 4 else ("<u2", "<i2")
    luma = elements.view(unsigned)[:, 0].astype(np.int32)
    alpha = elements.view(unsigned)[:, 3].astype(np.int32)
    orange, green = elements.view(signed)[:, 1:3].T.astype(np.int32)
    # The highest set bit of alpha gives the number of bits per component.
    bits = np.frexp(alpha.astype(np.float64))[1]
    full = (np.int32(1) << bits) - 1
    alpha = alpha & full >> 1
    alpha = alpha << 1 | alpha & 1
    rgba = np.stack([luma + orange - green, luma + green, luma - orange - green, alpha], axis=1)
    largest = np.iinfo(unsigned).max
    scaled = _rounded((rgba * (np.float32(largest) / full.astype(np.float32))[:, None]).astype(np.float32))
    return np.clip(scaled, 0, largest).astype(unsigned)


_FILTERS = {"OCTAHEDRAL": _octahedral, "QUATERNION": _quaternion, "EXPONENTIAL": _exponential, "COLOR": _color}
