"""Deform whole shapes as attributes say: tall, fat, twisted. numpy and scipy, no torch.

Labels are true by construction: a shape without an attribute of the whole is not deformed.

Source of twist, bend and taper: Barr 1984, Global and local deformations of solid primitives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from meshdeform.vocabulary.lookup import Attribute

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Rng = np.random.Generator
_COMPACT = 1.6
"""Ratio of the longest axis to the second up to which a solid is not long."""


class Part(NamedTuple):
    """Vertices (V, 3) float64 and faces (F, 3) int64 of a surface.

    `labels` (F,) int64: the part of each face, a place in `solids.PART_NAMES`, where they are named as they are drawn.
    """

    verts: Array
    faces: Index
    labels: Index | None = None


def normalised(part: Part) -> Part:
    """Centre the bounding box at the origin and scale the farthest vertex to distance 1."""
    centred = part.verts - (part.verts.min(0) + part.verts.max(0)) / 2
    return part._replace(verts=centred / np.linalg.norm(centred, axis=1).max())


def _scaled(x: float, y: float, z: float) -> Array:
    return np.array([x, y, z])


def _height(verts: Array) -> Array:
    """Return the height of each vertex, from 0 at the bottom to 1 at the top."""
    low, high = verts[:, 1].min(), verts[:, 1].max()
    return np.asarray((verts[:, 1] - low) / (high - low))


def _slimness(verts: Array) -> Array:
    """Return the shares (x, z) of a change of girth: 1 along the slimmer axis, less along the longer one."""
    # A fat dog is thus wider, not longer.
    extent = np.ptp(verts, axis=0)[[0, 2]]
    return np.asarray(extent.min() / extent)


def _tall(verts: Array, rng: Rng) -> Array:
    return verts * _scaled(1.0, rng.uniform(1.4, 1.75), 1.0)


def _short(verts: Array, rng: Rng) -> Array:
    return verts * _scaled(1.0, rng.uniform(0.5, 0.62), 1.0)


def _thin(verts: Array, rng: Rng) -> Array:
    x, z = 1.0 - rng.uniform(0.42, 0.52) * _slimness(verts)
    return verts * _scaled(x, 1.0, z)


def _fat(verts: Array, rng: Rng) -> Array:
    bulge = 0.15 + rng.uniform(0.5, 0.7) * np.sin(np.pi * _height(verts))
    x, z = _slimness(verts)
    scale: Array = np.stack([1.0 + x * bulge, np.ones_like(bulge), 1.0 + z * bulge], 1)
    return verts * scale


def _wide(verts: Array, rng: Rng) -> Array:
    return verts * _scaled(rng.uniform(1.5, 1.85), 1.0, 1.0)


def _long(verts: Array, rng: Rng) -> Array:
    return verts * _scaled(1.0, 1.0, rng.uniform(1.5, 1.85))


def _flat(verts: Array, rng: Rng) -> Array:
    return verts * _scaled(1.0, rng.uniform(0.28, 0.36), 1.0)


def _twisted(verts: Array, rng: Rng) -> Array:
    # Twisting a solid of revolution has no visible effect, so its cross-section becomes a rounded square first.
    azimuth = np.arctan2(verts[:, 0], verts[:, 2])
    fluted = 1.0 + 0.16 * np.cos(4 * azimuth)
    angle = np.radians(rng.uniform(80, 115)) * (_height(verts) - 0.5)
    x, z = verts[:, 0] * fluted, verts[:, 2] * fluted
    return np.stack([np.cos(angle) * x + np.sin(angle) * z, verts[:, 1], np.cos(angle) * z - np.sin(angle) * x], 1)


def _leaning(verts: Array, rng: Rng) -> Array:
    sheared = verts.copy()
    sheared[:, 0] += rng.uniform(0.45, 0.65) * verts[:, 1]
    return sheared


def _bent(verts: Array, rng: Rng) -> Array:
    low, high = verts[:, 1].min(), verts[:, 1].max()
    angle = np.radians(rng.uniform(65, 90)) * (verts[:, 1] - low) / (high - low)
    radius = (high - low) / np.radians(80)
    # Never past the bend's centre, where the shape would turn inside out.
    arm = radius - np.minimum(verts[:, 0], 0.85 * radius)
    return np.stack([radius - arm * np.cos(angle), arm * np.sin(angle), verts[:, 2]], 1)


def _tapered(verts: Array, rng: Rng) -> Array:
    scale = 1.2 - rng.uniform(0.75, 0.85) * _height(verts)
    return verts * np.stack([scale, np.ones_like(scale), scale], 1)


def _pinched(verts: Array, rng: Rng) -> Array:
    # A bell curve around half height: the ends keep their girth, unlike in a thin shape.
    waist = np.exp(-(((_height(verts) - 0.5) / 0.2) ** 2))
    scale = 1.1 - rng.uniform(0.62, 0.72) * waist
    return verts * np.stack([scale, np.ones_like(scale), scale], 1)


def _boxed(inside: Array) -> Array:
    """Return the factors (N,) that take what lies in the unit ball to the cube about it, and leave the cube."""
    return np.asarray(np.minimum(np.linalg.norm(inside, axis=1), 1.0) / np.maximum(np.abs(inside).max(1), 1e-12))


def _rounded(inside: Array) -> Array:
    """Return the factors (N,) that take the cube about the unit ball to it, and leave the ball."""
    return np.asarray(1.0 / np.maximum(np.linalg.norm(inside, axis=1), 1.0))


_OF_SOLIDS = {"boxy": (_boxed, 0.8, 1.0), "rounded": (_rounded, 0.5, 0.65)}
"""What becomes of each solid in its own box, and how strongly, from and to; a long one is changed across its length."""


def _reshaped(part: Part, factors: Callable[[Array], Array], strength: float) -> Part:
    """Return a part each of whose solids is drawn out or in, within its box."""
    verts = part.verts.copy()
    edges = np.concatenate([part.faces[:, :2], part.faces[:, 1:]])
    graph = sparse.csr_matrix((np.ones(len(edges)), tuple(edges.T)), shape=(len(verts),) * 2)
    count, solids = csgraph.connected_components(graph, directed=False)
    for number in range(count):
        rows = solids == number
        middle = verts[rows].mean(0)
        axes = np.linalg.eigh(np.cov((verts[rows] - middle).T))[1] if _is_slanted(verts[rows]) else np.eye(3)
        own = (verts[rows] - middle) @ axes
        low, high = own.min(0), own.max(0)
        inside = (own - (low + high) / 2) / np.maximum((high - low) / 2, 1e-12)
        order = np.argsort(high - low)
        across = np.ones(3, bool)
        across[order[2]] = (high - low)[order[2]] <= _COMPACT * (high - low)[order[1]]
        inside[:, across] *= factors(inside[:, across])[:, None] ** strength
        verts[rows] = (inside * (high - low) / 2 + (low + high) / 2) @ axes.T + middle
    return part._replace(verts=verts)


def _is_slanted(verts: Array) -> bool:
    """Return whether a solid is long and its length along no axis: its box is then wider than it."""
    values, vectors = np.linalg.eigh(np.cov(verts.T))
    return bool(values[2] > 3 * values[1] and np.abs(vectors[:, 2]).max() < 0.985)


WHOLE: dict[str, Callable[[Array, Rng], Array]] = {
    "tall": _tall,
    "short": _short,
    "thin": _thin,
    "fat": _fat,
    "wide": _wide,
    "long": _long,
    "flat": _flat,
    "tapered": _tapered,
    "pinched": _pinched,
    "twisted": _twisted,
    "bent": _bent,
    "leaning": _leaning,
}
"""Deformation for each attribute of the whole, in the order of application."""


def deformed(part: Part, attributes: Iterable[Attribute], rng: Rng) -> Part:
    """Apply every attribute of the whole, then centre the shape and scale it to the unit sphere.

    All deformations preserve the orientation of the faces.
    """
    degrees = {attribute.degree for attribute in attributes if attribute.part == "whole"}
    for word, (factors, least, most) in _OF_SOLIDS.items():
        part = _reshaped(part, factors, rng.uniform(least, most)) if word in degrees else part
    shape = normalised(part)
    for word, apply in WHOLE.items():
        if word in degrees:
            shape = normalised(shape._replace(verts=apply(shape.verts, rng)))
    return shape
