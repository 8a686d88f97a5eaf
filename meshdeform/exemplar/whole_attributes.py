"""Make an asset tall, fat or bent as a whole, as the members of its noun are made so.

The map is that of the members (`priors.builtin.teaching.deformed`), in the asset's frame. Wheels only move along and
stay round, the plate under an asset stays, and what stands goes on standing at its height.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from meshdeform.exemplar.pieces import pieces_of
from meshdeform.exemplar.shapes import Shape
from meshdeform.nouns.labels import Floats, code
from meshdeform.priors.builtin.grammar import Attribute
from meshdeform.priors.builtin.teaching.deformed import WHOLE
from meshdeform.reading.result import GROUND

__all__ = ["reshaped"]


def reshaped(source: Shape, verts: Floats, attributes: Iterable[Attribute], seed: int) -> Floats:
    """Return vertices (V, 3) of a source with the attributes of the whole, in degrees that the seed draws."""
    degrees = {each.degree for each in attributes if each.part == "whole"}
    standing = np.unique(source.faces[source.labels != GROUND])
    rng = np.random.default_rng(seed)
    own = verts[standing]
    ground = own[:, 1].min()
    for degree, change in WHOLE.items():
        if degree in degrees:
            own = change(own, rng)
    own[:, 1] += ground - own[:, 1].min()
    moved = verts.copy()
    moved[standing] = own
    return _with_round_wheels(source, verts, moved, float(ground))


def _with_round_wheels(source: Shape, verts: Floats, moved: Floats, ground: float) -> Floats:
    """Return the vertices with wheels that were only moved; on the ground, if they were."""
    if not (source.labels == code("wheel")).any():
        return moved
    pieces = pieces_of(source, {"wheel": "wheel"})
    for piece in range(len(pieces)):
        rows = np.unique(source.faces[pieces.of_face == piece])
        step = moved[rows].mean(0) - verts[rows].mean(0)
        if verts[rows, 1].min() < ground + 0.02:
            step[1] = 0
        moved[rows] = verts[rows] + step
    return moved
