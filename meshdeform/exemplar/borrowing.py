"""Give a shape a part of another: a dog the ears of a rabbit, a chair the arms of a sofa.

Both stand in the frame of one asset. The parent is the part from which the borrowed one grows, if both shapes have it,
else the largest that both have: the head of ears, the seat of arms. The box of the lender's parent is taken to that of
the borrower's: what is lent on each side goes along by a scale for each axis, and its size by their geometric mean.
Where the borrower has the part itself, its root, the end next to the middle of the parent, goes to where that of the
borrower's own was.
"""

from __future__ import annotations

import numpy as np

from meshdeform.exemplar.alike import grows_from
from meshdeform.exemplar.shapes import Shape
from meshdeform.geometry.mesh import face_areas
from meshdeform.nouns.families import Part
from meshdeform.nouns.labels import Floats, Index, solids_of
from meshdeform.vocabulary.solids import CARRIED_BY, PART_NAMES

__all__ = ["with_part_of"]

_ROOT = 0.15
"""Share of the vertices of what is lent, those nearest to the middle of the parent, that are its root."""
_IN_THE_MIDDLE = 0.02
"""Distance from the mirror plane, a share of the asset's diagonal, within which a piece is on neither side."""


def with_part_of(borrower: Shape, lender: Shape, part: str) -> Shape:
    """Return a shape that has the named part of another in place of its own; as it was if nothing can be lent.

    Both are placed in the frame of one asset, with the parts of their faces.
    """
    with_part = _with_carried(part)
    lent, own = np.isin(lender.labels, with_part), np.isin(borrower.labels, with_part)
    parent = _parent(borrower, lender, part)
    if parent is None or not lent.any():
        return borrower
    verts, faces = _submesh(lender.verts, lender.faces[lent])
    box = _submesh(borrower.verts, borrower.faces[borrower.labels == parent])[0]
    there = _submesh(lender.verts, lender.faces[lender.labels == parent])[0]
    old, old_faces = _submesh(borrower.verts, borrower.faces[own])
    old_sides = _sides(old, old_faces)
    for side, rows in _sides(verts, faces).items():
        verts[rows] = _fitted_into(verts[rows], there, box)
        if side in old_sides:
            verts[rows] += _root(old[old_sides[side]], box) - _root(verts[rows], box)
    solids = None
    if borrower.solids is not None and lender.solids is not None:
        solids = np.concatenate([borrower.solids[~own], borrower.solids.max() + 1 + lender.solids[lent]])
    return Shape(
        borrower.noun,
        np.concatenate([borrower.verts, verts]),
        np.concatenate([borrower.faces[~own], faces + len(borrower.verts)]),
        np.concatenate([borrower.labels[~own], lender.labels[lent]]),
        solids,
    )


def _with_carried(part: str) -> list[int]:
    """Return the indices in `PART_NAMES` of a part and of what moves with it: of an arm and its hand."""
    moving = {part}
    while more := {name for name, above in CARRIED_BY.items() if above in moving} - moving:
        moving |= more
    return [number for number, name in enumerate(PART_NAMES) if name in moving]


def _parent(borrower: Shape, lender: Shape, part: str) -> int | None:
    """Return the index in `PART_NAMES` of the parent; None if the two have no part in common."""
    common = np.intersect1d(borrower.labels, lender.labels)
    names = {PART_NAMES[k]: int(k) for k in common if k >= 0 and k not in _with_carried(part)}
    grown_from = grows_from(part, names)
    if grown_from is not None:
        return names[grown_from]
    areas = face_areas(borrower.verts, borrower.faces)
    return max(names.values(), key=lambda k: float(areas[borrower.labels == k].sum()), default=None)


def _submesh(verts: Floats, faces: Index) -> tuple[Floats, Index]:
    """Return the vertices (U, 3) that faces use, and the faces (F, 3) among them."""
    used, corners = np.unique(faces, return_inverse=True)
    return verts[used], corners.reshape(-1, 3)


def _sides(verts: Floats, faces: Index) -> dict[int, Index]:
    """Return the vertices of the pieces on the right (-1), in the middle (0) and on the left (1), where any are."""
    if not len(faces):
        return {}
    solids = solids_of(Part(verts, faces))
    middles = np.bincount(solids, verts[:, 0]) / np.bincount(solids)
    side = np.where(np.abs(middles) < _IN_THE_MIDDLE, 0, np.sign(middles)).astype(int)[solids]
    return {int(one): np.flatnonzero(side == one) for one in np.unique(side)}


def _fitted_into(points: Floats, there: Floats, here: Floats) -> Floats:
    """Return points (N, 3) as they go along when one box of points is taken to another."""
    scale = np.maximum(np.ptp(here, axis=0), 1e-9) / np.maximum(np.ptp(there, axis=0), 1e-9)
    middles = [(positions.min(0) + positions.max(0)) / 2 for positions in (there, here)]
    middle = points.mean(0)
    size = float(np.exp(np.log(scale).mean()))
    return np.asarray(middles[1] + (middle - middles[0]) * scale + (points - middle) * size)


def _root(points: Floats, parent: Floats) -> Floats:
    """Return the middle (3,) of the end of a piece that is next to the middle of its parent."""
    away = np.linalg.norm(points - (parent.min(0) + parent.max(0)) / 2, axis=1)
    return np.asarray(points[away <= np.quantile(away, _ROOT)].mean(0))
