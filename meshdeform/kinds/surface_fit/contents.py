"""Check the files of a surface fit: a surface, which may have no triangles, and values at points near it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from meshdeform.assets.check import bound_reading, decode_mesh
from meshdeform.assets.inspect import surface_format
from meshdeform.assets.limits import Limits


def _read_surface(path: Path, filename: str, limits: Limits) -> dict[str, Any]:
    """Check a surface without triangles, or a mesh if it is none."""
    with path.open("rb") as file:
        if surface_format(file.read(65_536), filename) is None:
            return decode_mesh(path, filename, limits)
    from meshdeform.kinds.surface_fit.surface_files import read_surface_file, summary_of

    bound_reading(path, limits)
    surface = read_surface_file(path.read_bytes(), filename, limits)
    assert surface is not None
    return asdict(summary_of(surface, filename))


def _read_scalars(path: Path, _filename: str, limits: Limits) -> dict[str, Any]:
    bound_reading(path, limits)
    from meshdeform.kinds.surface_fit.scalar_files import read_scalar_file, summary_of_scalars

    return asdict(summary_of_scalars(read_scalar_file(path.read_bytes())))


READERS = {"surface": _read_surface, "scalars": _read_scalars}
