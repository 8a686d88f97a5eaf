"""Make a triangulation intrinsic Delaunay by flips: same surface, better triangles, vertices where they were.

An intrinsic triangulation is faces and edge lengths. An edge is Delaunay if the angles opposite to it sum to at most
pi, that is if cot a + cot b >= 0. A flip replaces an edge by the other diagonal of its two triangles, unfolded.

Source: Bobenko and Springborn 2007; Fisher et al. 2007, An Algorithm for the Construction of Intrinsic Delaunay
Triangulations with Applications to Digital Geometry Processing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.fields.gluing import glue
from meshdeform.geometry.kernels import kernel

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class IntrinsicMesh:
    """Triangles of which only the side lengths are known."""

    faces: _Index  # (F, 3) int64: an edge may occur twice, or join a vertex with itself
    lengths: _Floats  # (F, 3) float64: side k runs from corner k to corner k + 1
    vertices: int
    flips: int  # number of flips that made it
    least: float  # smallest cot a + cot b of an inner edge: not below zero (but for rounding) if all are Delaunay

    @property
    def certified(self) -> bool:
        """Whether every inner edge is Delaunay."""
        return self.least >= -1e-6


def delaunay(verts: _Floats, faces: _Index) -> IntrinsicMesh:
    """Flip the edges of a manifold mesh until all are Delaunay.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64
    """
    corners = verts[faces]
    lengths = np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=2)
    # Lengthen all sides alike where a triangle is so thin that rounding breaks its inequality (Sharp and Crane 2020).
    slack = lengths.sum(1, keepdims=True) - 2 * lengths
    lengths = lengths + max(0.0, float((1e-6 * np.median(lengths) - slack).max(initial=0.0)))
    faces, twin = faces.copy(), glue(verts, faces).ravel().copy()
    flat, sides = faces.reshape(-1), lengths.reshape(-1).copy()
    flips = int(_flip_all(flat, sides, twin))
    least = float(_sums(sides, twin).min(initial=np.inf))
    return IntrinsicMesh(flat.reshape(-1, 3), sides.reshape(-1, 3), len(verts), flips, least)


def half_cotangents(lengths: _Floats) -> _Floats:
    """Return half the cotangent (F, 3) of the angle opposite to each side."""
    squared = lengths**2
    area = areas_of(lengths)
    return np.asarray((squared.sum(1, keepdims=True) - 2 * squared) / (8 * area[:, None]))


def areas_of(lengths: _Floats) -> _Floats:
    """Return the areas (F,) of triangles by Kahan's form of Heron's formula."""
    c, b, a = np.sort(lengths, 1).T
    inside = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c))
    return np.asarray(0.25 * np.sqrt(np.maximum(inside, 1e-300)))


def _sums(sides: _Floats, twin: _Index) -> _Floats:
    """Return cot a + cot b of every inner edge."""
    cot = 2 * half_cotangents(sides.reshape(-1, 3)).ravel()
    inner = np.flatnonzero(twin > np.arange(len(twin)))
    return np.asarray(cot[inner] + cot[twin[inner]])


@kernel
def _cotangent(sides: _Floats, edge: int) -> float:
    """Return the cotangent of the angle opposite to a half-edge."""
    first = edge - edge % 3
    a, b, c = sides[edge], sides[first + (edge + 1) % 3], sides[first + (edge + 2) % 3]
    inside = (a + b + c) * (b + c - a) * (a + c - b) * (a + b - c)
    cotangent: float = (b * b + c * c - a * a) / math.sqrt(max(inside, 1e-300))
    return cotangent


@kernel
def _flip_all(faces: _Index, sides: _Floats, twin: _Index) -> int:
    """Flip until every inner edge is Delaunay; return the number of flips."""
    count = len(faces)
    queue, waiting = list(range(count)), np.ones(count, np.bool_)
    flips = 0
    while len(queue) > 0:
        e = queue.pop()
        waiting[e] = False
        t = twin[e]
        if t < 0 or e // 3 == t // 3 or _cotangent(sides, e) + _cotangent(sides, t) >= -_TOLERANCE:
            continue
        f, g = e - e % 3, t - t % 3
        e1, e2, t1, t2 = f + (e + 1) % 3, f + (e + 2) % 3, g + (t + 1) % 3, g + (t + 2) % 3
        # Unfold: the edge on the x axis from (0, 0), one tip above, one below.
        base, la, lb, lc, ld = sides[e], sides[e1], sides[e2], sides[t1], sides[t2]
        x1 = (base * base + lb * lb - la * la) / (2 * base)
        x2 = (base * base + lc * lc - ld * ld) / (2 * base)
        y1, y2 = math.sqrt(max(lb * lb - x1 * x1, 0.0)), math.sqrt(max(lc * lc - x2 * x2, 0.0))
        crossing = (x1 * y2 + x2 * y1) / max(y1 + y2, 1e-300)
        if crossing <= 0.0 or crossing >= base:
            continue  # rounding: the diagonals do not cross
        length = math.hypot(x1 - x2, y1 + y2)
        a, b, c, d = faces[e], faces[e1], faces[e2], faces[t2]
        n_a, n_b, n_c, n_d = twin[e1], twin[e2], twin[t1], twin[t2]
        # New faces: (c, d, b) in place of f, and (d, c, a) in place of g.
        faces[f], faces[f + 1], faces[f + 2] = c, d, b
        faces[g], faces[g + 1], faces[g + 2] = d, c, a
        sides[f], sides[f + 1], sides[f + 2] = length, ld, la
        sides[g], sides[g + 1], sides[g + 2] = length, lb, lc
        # Old half-edges to new ones; a neighbour may be one of them.
        n_a = _moved(n_a, e1, e2, t1, t2, f, g)
        n_b = _moved(n_b, e1, e2, t1, t2, f, g)
        n_c = _moved(n_c, e1, e2, t1, t2, f, g)
        n_d = _moved(n_d, e1, e2, t1, t2, f, g)
        twin[f], twin[g] = g, f
        twin[f + 1], twin[f + 2], twin[g + 1], twin[g + 2] = n_d, n_a, n_b, n_c
        for new in (f + 1, f + 2, g + 1, g + 2):
            if twin[new] >= 0:
                twin[twin[new]] = new
            if not waiting[new]:
                waiting[new] = True
                queue.append(new)
        flips += 1
    return flips


@kernel
def _moved(edge: int, e1: int, e2: int, t1: int, t2: int, f: int, g: int) -> int:
    """Return the new number of a half-edge of the two faces; others keep theirs."""
    if edge == e1:
        return f + 2
    if edge == e2:
        return g + 1
    if edge == t1:
        return g + 2
    if edge == t2:
        return f + 1
    return edge
