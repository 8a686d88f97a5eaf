"""Encode and decode colours of 0 to 1 as sRGB (IEC 61966-2-1), as arrays of numpy or tensors of torch."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["linear_from_srgb", "srgb_from_linear"]


def linear_from_srgb(values: Any, library: Any = np) -> Any:
    """Decode sRGB."""
    curve = ((library.clip(values, 0.04045, None) + 0.055) / 1.055) ** 2.4
    return library.where(values <= 0.04045, values / 12.92, curve)


def srgb_from_linear(values: Any, library: Any = np) -> Any:
    """Encode linear light."""
    curve = 1.055 * library.clip(values, 0.0031308, None) ** (1 / 2.4) - 0.055
    return library.where(values <= 0.0031308, values * 12.92, curve)
