"""`report.json`: what was asked, what ran, what it did to the mesh, and what was skipped and why."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import meshdeform

__all__ = ["LossHistory", "PhaseClock", "sha256_hex", "versions"]

_PACKAGES = ("torch", "numpy", "scipy", "numba", "trimesh", "safetensors", "diffusers", "transformers", "usd-core")
_MAX_SAMPLES = 200


def sha256_hex(data: bytes) -> str:
    """SHA-256 of `data`, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def versions() -> dict[str, str]:
    """Versions of everything that can change a result."""
    found = {"meshdeform": meshdeform.__version__, "python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


class PhaseClock:
    """Wall-clock seconds per phase of one attempt."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the time that the block takes to `name`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


class LossHistory:
    """First, last, and at most 200 evenly thinned samples of the losses."""

    def __init__(self) -> None:
        self._samples: list[dict[str, Any]] = []
        self._stride = 1
        self._last: dict[str, Any] | None = None

    def add(self, step: int, losses: dict[str, float]) -> None:
        """Record one step's losses."""
        self._last = {"step": step, **losses}
        if (step - 1) % self._stride == 0:
            self._samples.append(self._last)
        if len(self._samples) > _MAX_SAMPLES:
            self._samples = self._samples[::2]
            self._stride *= 2

    def to_list(self) -> list[dict[str, Any]]:
        """The samples in order, the last step included."""
        if self._last is None or (self._samples and self._samples[-1] is self._last):
            return list(self._samples)
        return [*self._samples, self._last]
