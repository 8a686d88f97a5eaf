"""Collect the contents of `report.json`: hashes, versions, durations of phases, and losses."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import platform
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import meshdeform

__all__ = ["RunLog", "sha256_hex", "versions"]

_PACKAGES = (
    "torch",
    "numpy",
    "scipy",
    "numba",
    "trimesh",
    "fast-simplification",
    "safetensors",
    "diffusers",
    "transformers",
)
_MAX_SAMPLES = 200


def sha256_hex(data: bytes) -> str:
    """Return the SHA-256 of `data` in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def versions() -> dict[str, str]:
    """Return the versions of all packages that can affect a result."""
    return {"meshdeform": meshdeform.__version__, "python": platform.python_version(), **_installed()}


@functools.cache
def _installed() -> dict[str, str]:
    """Return the versions of the packages. Reading their metadata takes longer than a step."""
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


class RunLog:
    """The wall-clock seconds of an attempt by phase, and the losses of its first, last and up to 200 spaced steps."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._samples: list[dict[str, Any]] = []
        self._stride = 1
        self._last: dict[str, Any] | None = None

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Add the duration of the `with` block to phase `name`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def add(self, step: int, losses: Mapping[str, float]) -> None:
        """Add the losses of one step."""
        self._last = {"step": step, **losses}
        if (step - 1) % self._stride == 0:
            self._samples.append(self._last)
        if len(self._samples) > _MAX_SAMPLES:
            self._samples = self._samples[::2]
            self._stride *= 2

    def losses(self) -> list[dict[str, Any]]:
        """Return the samples in order, including the last step."""
        if self._last is None or (self._samples and self._samples[-1] is self._last):
            return list(self._samples)
        return [*self._samples, self._last]
