"""Notice a ground plane or a backdrop that makes the object itself small in every picture that the guidance sees."""

from __future__ import annotations

import numpy as np

from meshdeform.assets.document import Document
from meshdeform.assets.surface import Block, Surface

__all__ = ["backdrop_warnings"]

_LARGE = 0.6
"""Share of the scene's diagonal from which a mesh spans the scene."""
_FLAT = 0.05
"""Thickness over width up to which a mesh is a plane."""
_WIDE = 0.4
"""Second extent over the first from which a mesh is a plane and not a pole."""
_SMALL = 0.5
"""Share of the scene's diagonal below which the rest is small."""


def backdrop_warnings(document: Document, surface: Surface, blocks: list[Block]) -> tuple[str, ...]:
    """Return a warning that names the planes that span the scene, if what is left without them is small."""
    if len(blocks) < 2:
        return ()
    starts = [block.rows.start for block in blocks]
    low, high = (ufunc.reduceat(surface.positions, starts, axis=0) for ufunc in (np.minimum, np.maximum))
    extent = np.sort(high - low, axis=1)
    diagonal = float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
    spans = np.linalg.norm(extent, axis=1) > _LARGE * diagonal
    planes = spans & (extent[:, 0] <= _FLAT * extent[:, 2]) & (extent[:, 1] >= _WIDE * extent[:, 2])
    if not planes.any() or planes.all():
        return ()
    rest = float(np.linalg.norm(high[~planes].max(axis=0) - low[~planes].min(axis=0)))
    if rest >= _SMALL * diagonal:
        return ()
    nodes = dict.fromkeys(block.node for block, plane in zip(blocks, planes, strict=True) if plane)
    names = ", ".join(_name(document, node) for node in list(nodes)[:3])
    return (
        f"{names} looks like a ground plane or backdrop: it spans the scene, and the rest is only "
        f"{rest / diagonal:.0%} as large, so the guidance sees the object small. Name it in "
        "params.exclude to leave it as it is.",
    )


def _name(document: Document, node: int) -> str:
    name = document.root["nodes"][node].get("name")
    return f"{name[:60]!r} (node {node})" if isinstance(name, str) and name else f"Node {node}"
