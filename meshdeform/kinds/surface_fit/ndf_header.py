"""Check what the header of a `.ndf` states before anything is made of it. The standard library alone.

A checksum does not make a file honest: sizes and widths are used only where they fit each other and the limits.
"""

from __future__ import annotations

import itertools
import sys
from typing import Any

_MAX_FACES = 100_000
_MAX_BITS, _MAX_OCTAVES, _MAX_LAYERS, _MAX_SCALARS = 16, 32, 32, 64
_MAX_STEP = 400
"""Of the exponents n: 2^(n / 4) is 1e30 at most."""
_MAX_UNPACKED = 1 << 26
"""Bytes of all sections. A base of 16,000 faces, with 32 features and 64 scalars, takes less than 10 MB."""


def checked_header(header: dict[str, Any], size: int) -> dict[str, Any]:
    """Return the header (docs/surface_fit.md) of a file with `size` bytes of sections.

    Raises
    ------
    ValueError, KeyError, TypeError
        The numbers do not fit each other, or are beyond the limits.
    """
    vertices, faces, features, octaves = (header[name] for name in ("vertices", "faces", "features", "octaves"))
    if not (_whole(faces, 1, _MAX_FACES) and _whole(vertices, 1, 3 * faces)):
        raise ValueError("The .ndf states impossible counts.")
    scalars = header.get("scalars", [])
    _require(_whole(features, 0, 1024) and _whole(octaves, 0, _MAX_OCTAVES) and _whole(header["bits"], 2, _MAX_BITS))
    _require(len(header["centre"]) == 3 and all(map(_finite, [*header["centre"], header["scale"]])))
    _require(isinstance(scalars, list) and len(scalars) <= _MAX_SCALARS)
    sizes = [_weights(header, features, vertices)]
    _require((header["widths"][0], header["widths"][-1]) == (features + 3 + 6 * octaves, 3))
    for each in scalars:
        sizes.append(_weights(each, each["widths"][0], vertices))
        outputs, labels = each["widths"][-1], each.get("labels", [])
        _require(len(each["offset"]) == len(each["scale"]) == outputs and len(labels) in (0, outputs))
        _require(all(map(_finite, [*each["offset"], *each["scale"]])) and all(type(x) is int for x in labels))
    packed, unpacked = zip(*header["sections"], strict=True)
    _require(all(_whole(each, 0, size) for each in packed) and sum(packed) == size)
    # A face has one symbol, each of its borders one more, and each part three.
    _require(_whole(unpacked[0], 2, 14 * faces) and unpacked[0] % 2 == 0)
    _require(list(unpacked[1:]) == [6 * vertices, *sizes] and sum(unpacked) <= _MAX_UNPACKED)
    return header


def _weights(network: dict[str, Any], features: int, vertices: int) -> int:
    """Return the bytes of a network's section."""
    widths: list[int] = network["widths"]
    _require(2 <= len(widths) <= _MAX_LAYERS and all(_whole(width, 1, 1 << 16) for width in widths))
    steps = network["steps"]
    _require(len(steps) == features + 2 * len(widths) - 2 and all(_whole(n, -_MAX_STEP, _MAX_STEP) for n in steps))
    return 2 * (vertices * features + sum((before + 1) * after for before, after in itertools.pairwise(widths)))


def _whole(number: Any, least: int, most: int) -> bool:
    return type(number) is int and least <= number <= most


def _finite(number: Any) -> bool:
    return type(number) in (int, float) and abs(number) <= sys.float_info.max


def _require(fits: bool) -> None:
    if not fits:
        raise ValueError("The .ndf contradicts itself.")
