"""Choose how to draw: compiled loops on the CPU, plain torch on every other device."""

from __future__ import annotations

from torch import Tensor

__all__ = ["is_compiled"]


def is_compiled(tensor: Tensor) -> bool:
    """Return whether what is drawn from this tensor is drawn by compiled loops; tests and benchmarks replace this."""
    return tensor.device.type == "cpu"
