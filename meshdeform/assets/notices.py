"""Find causes of bad deformations, for an asset's warnings: a backdrop, large triangles, Z for up, rounding.

A ground plane or backdrop makes the object itself small in every picture that the guidance sees. Beside one that is far
larger, the object is smaller than a few cells of a lattice, and a ground of two triangles is only a chord of the map
that carries the object: the two would separate. Such a backdrop is left as it is (`params.control.backdrop`). No
torch, because the service's check of assets uses this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.document import Document
from meshdeform.assets.surface import Block, Surface

_LARGE = 0.6
"""Share of the scene's diagonal from which a mesh spans the scene."""
_WIDE = 0.4
"""Second extent over the first from which a mesh is a plane and not a pole."""
_FLAT, _SMALL = 0.05, 0.5
"""Thickness over width up to which a mesh is a plane, and share of the diagonal below which the rest is small."""
_SHEET, _TINY = 0.005, 0.25
"""The same for a backdrop that is left as it is: a door with a knob, or a ray with its eyes, is an object."""

_Flags = NDArray[np.bool_]
_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_LONG_EDGE = 1 / 3
"""Length of an edge, as a share of the longest side of the bounding box, above which a triangle is too large. A lattice
has 24 cells on that side (`lattice.CELLS`), so such an edge is a chord across at least eight of them."""
_MOSTLY = 0.5
_ROUNDED = 2e-5
"""Step between 32-bit floats, as a share of the asset's diagonal, from which its shape is told to be rounded."""
_DOWN = 0.97
"""Least cosine between a face of a base and the downward axis."""
_LAYER = 0.01
"""Height of the layer in which a base lies, as a share of the mesh's height."""
_BASE = 0.03
"""Least area of a base, as a share of the mesh's footprint."""
_MUCH_LESS = 0.1
"""Share of the base that the mesh may have of the other flat sides."""


@dataclass(frozen=True)
class Backdrop:
    """The planes that span a scene."""

    triangles: _Flags  # (T,) bool: which triangles of the surface are theirs
    share: float  # diagonal of what is left without them, over that of the scene
    left: bool  # whether they are left as they are, unless the request says otherwise
    name: str  # names of their nodes
    own_nodes: bool  # whether their nodes show nothing else, so that `params.control.exclude` can name them

    @property
    def warning(self) -> str:
        """A sentence about what the planes do, or what is done about them."""
        if self.left:
            return (
                f"{self.name} looks like a ground plane or backdrop: the rest is only {_percent(self.share)} as large. "
                "It is neither drawn nor deformed, unless params.control.backdrop is `deform`."
            )
        remedy = "Name it in params.control.exclude to leave it as it is."
        if not self.own_nodes:
            remedy = "Make it an object of its own, and name that in params.control.exclude to leave it as it is."
        return (
            f"{self.name} looks like a ground plane or backdrop: it spans the scene, and the rest is only "
            f"{_percent(self.share)} as large, so the guidance sees the object small. {remedy}"
        )


def find_backdrop(document: Document, surface: Surface, blocks: Sequence[Block]) -> Backdrop | None:
    """Return the backdrop of a surface: meshes, or else connected components."""
    if not len(surface.triangles):
        return None
    starts = [block.rows.start for block in blocks]
    block = np.searchsorted(starts, surface.triangles[:, 0], side="right") - 1
    for left, flat, small in ((True, _SHEET, _TINY), (False, _FLAT, _SMALL)):
        planes, share = _planes(surface, block, flat, small)
        if left and not planes.any() and _may_have_sheet(surface):
            planes, share = _planes(surface, _components(surface), flat, small)
        if planes.any():
            nodes = [blocks[at].node for at in np.unique(block[planes])]
            others = {blocks[at].node for at in np.unique(block[~planes])}
            names = ", ".join(_name(document, node) for node in list(dict.fromkeys(nodes))[:3])
            return Backdrop(planes, share, left, names, others.isdisjoint(nodes))
    return None


def _planes(surface: Surface, group: _Index, flat: float, small: float) -> tuple[_Flags, float]:
    """Return flags (T,) of the triangles in groups (T,) that are backdrops, and the share of the rest."""
    none = np.zeros(len(group), bool)
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    if len(starts) < 2:
        return none, 1.0
    corners = surface.positions[surface.triangles[order]]
    low = np.minimum.reduceat(corners.min(1), starts)
    high = np.maximum.reduceat(corners.max(1), starts)
    extent = np.sort(high - low, axis=1)
    diagonal = float(np.linalg.norm(high.max(0) - low.min(0)))
    spans = np.linalg.norm(extent, axis=1) > _LARGE * diagonal
    planes = spans & (extent[:, 0] <= flat * extent[:, 2]) & (extent[:, 1] >= _WIDE * extent[:, 2])
    if not planes.any() or planes.all():
        return none, 1.0
    share = float(np.linalg.norm(high[~planes].max(0) - low[~planes].min(0))) / diagonal
    if share >= small:
        return none, share
    flags = none.copy()
    flags[order] = np.repeat(planes, np.diff(starts, append=len(group)))
    return flags, share


def _may_have_sheet(surface: Surface) -> bool:
    """Return whether a connected component may be a sheet beside which the rest, on it or near it, is tiny."""
    extent = np.ptp(surface.positions, axis=0)
    return bool(extent.min() < (_TINY + _SHEET) * np.linalg.norm(extent))


def _components(surface: Surface) -> _Index:
    """Return the connected component (T,) of each triangle."""
    from meshdeform.geometry.coincidence import connected_triangles  # scipy takes a moment to load

    return connected_triangles(surface.positions, surface.triangles)


def _percent(share: float) -> str:
    return f"{share:.0%}" if share >= 0.01 else f"{share:.2g} times"


def _name(document: Document, node: int) -> str:
    name = document.root["nodes"][node].get("name")
    return f"{name[:60]!r} (node {node})" if isinstance(name, str) and name else f"Node {node}"


def coarse_share(positions: NDArray[np.float64], triangles: NDArray[np.int64]) -> float:
    """Return the share of the surface that is in triangles with an edge longer than a third of the asset.

    `positions` is (N, 3) float64; `triangles` is (T, 3) int64.
    """
    corners = positions[triangles]
    edges = np.roll(corners, -1, axis=1) - corners
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    total = float(areas.sum())
    if not total > 0:
        return 0.0
    size = float(np.ptp(positions[np.unique(triangles)], axis=0).max())
    return float(areas[(edges**2).sum(2).max(1) > (_LONG_EDGE * size) ** 2].sum()) / total


def coarseness_warnings(positions: NDArray[np.float64], triangles: NDArray[np.int64]) -> tuple[str, ...]:
    """Return a sentence about an asset that is mostly too coarse to bend, with the remedy; nothing for others."""
    share = coarse_share(positions, triangles)
    if share < _MOSTLY:
        return ()
    return (
        f"{share:.0%} of the surface is in triangles with edges longer than a third of the asset. Triangles stay "
        "flat, so these surfaces cannot bend. Let edges longer than a tenth of the asset be split (output.subdivide), "
        "or subdivide them in a modelling program.",
    )


def rounding_warnings(surface: Surface, blocks: Sequence[Block]) -> tuple[str, ...]:
    """Return a sentence about positions that are stored so far from the origin that 32-bit floats round the shape."""
    if not len(surface.positions):
        return ()
    filled = [block for block in blocks if len(block.positions)]
    steps = [float(np.spacing(np.abs(block.positions).max())) * block.placement.scale for block in filled]
    return _rounding(max(steps), float(np.linalg.norm(np.ptp(surface.positions, axis=0))))


def rounded_positions(positions: _Floats) -> tuple[str, ...]:
    """Return a sentence about positions (V, 3) of a file of 32-bit floats that are rounded in it already."""
    if not len(positions):
        return ()
    step = float(np.spacing(np.float32(np.abs(positions).max())))
    return _rounding(step, float(np.linalg.norm(np.ptp(positions, axis=0))))


def _rounding(step: float, size: float) -> tuple[str, ...]:
    """Return a sentence if the steps between the floats of an asset are large beside its diagonal."""
    if not size > 0.0 or step < _ROUNDED * size:
        return ()
    return (
        f"The positions lie so far from the origin that the file rounds them to steps of {step:.2g}: {step / size:.1g} "
        "of the asset's diagonal. Export it near the origin, and place it by its node.",
    )


def looks_z_up(positions: NDArray[np.float64], triangles: NDArray[np.int64]) -> bool:
    """Return whether a mesh stands on a flat base at its lowest Z, with no such side at its lowest Y or highest Z.

    A flat side opposite the base would also be the front and back of a flat panel that stands upright. `positions` is
    (V, 3) float64; `triangles`, (F, 3) int64: counter-clockwise from outside.
    """
    if not len(triangles):
        return False
    corners = positions[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    base = _flat_share(corners, cross, axis=2, sign=-1)
    others = max(_flat_share(corners, cross, axis=1, sign=-1), _flat_share(corners, cross, axis=2, sign=1))
    return base >= _BASE and others < _MUCH_LESS * base


def up_axis_warnings(positions: NDArray[np.float64], triangles: NDArray[np.int64]) -> tuple[str, ...]:
    """Return a sentence about a mesh that looks as if Z were up; nothing for others."""
    if not looks_z_up(positions, triangles):
        return ()
    return ("The asset seems to have Z up. Unless it is read so, say it by params.input.up, or export it with +Y up.",)


def _flat_share(corners: NDArray[np.float64], cross: NDArray[np.float64], *, axis: int, sign: int) -> float:
    """Return the area of the flat side at one end of an axis, as a share of the bounding box's side there."""
    low, high = corners.min((0, 1)), corners.max((0, 1))
    extent = high - low
    side = np.prod(np.delete(extent, axis))
    if not side > 0:
        return 0.0
    end = high[axis] if sign > 0 else low[axis]
    inside = (np.abs(corners[:, :, axis] - end) <= _LAYER * extent[axis]).all(1)
    facing = sign * cross[:, axis] >= _DOWN * np.linalg.norm(cross, axis=1)
    return float(np.abs(cross[inside & facing, axis]).sum() / 2 / side)
