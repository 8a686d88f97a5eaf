"""Generate the benchmark's source meshes: eight closed surfaces of about 2,000 even triangles.

None is a member of the builtin prior's families, so changes to those do not affect them.

=========  ====================================================================
sphere     geodesic: no direction is special
cube       flat sides, sharp edges
cylinder   upright, with rounded rims
torus      genus 1, which no deformation can change
vase       a solid body with a thin neck
armchair   a block with a back: concave, with flat sides
quadruped  four legs, head and tail, in one piece
toy        the same kind of animal of seven overlapping components
=========  ====================================================================
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import torch
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import join
from training.evaluation.relaxed import Solid, capsule, geodesic_sphere, relaxed_surface, smooth_union
from training.shapes import box, torus

_FREQUENCY = 10
_Point = tuple[float, float, float]


def _rounded_box(centre: _Point, half: _Point) -> Solid:
    """Return a superellipsoid of exponent 8: a box with rounded edges."""
    middle, size = torch.tensor(centre, dtype=torch.float64), torch.tensor(half, dtype=torch.float64)
    return lambda p: ((((p - middle) / size).abs() ** 8).sum(1) ** 0.125 - 1) * min(half)


def _turned(radius: Callable[[Tensor], Tensor], half_height: float) -> Solid:
    """Return a solid of revolution around the Y axis of `radius(y)`, with rounded rims."""

    def value(p: Tensor) -> Tensor:
        across = (p[:, 0] ** 2 + p[:, 2] ** 2).sqrt() / radius(p[:, 1])
        return ((across**10 + (p[:, 1].abs() / half_height) ** 10) ** 0.1 - 1) * 0.3

    return value


def _cylinder() -> TriangleMesh:
    return relaxed_surface(_turned(lambda y: torch.full_like(y, 0.5), 0.8), _FREQUENCY)


def _vase() -> TriangleMesh:
    return relaxed_surface(_turned(lambda y: 0.34 + 0.2 * torch.sin(3.4 * y + 2.46), 0.9), _FREQUENCY)


def _armchair() -> TriangleMesh:
    seat, back = _rounded_box((0, -0.1, 0), (0.45, 0.28, 0.45)), _rounded_box((0, 0.3, -0.3), (0.43, 0.62, 0.15))
    return relaxed_surface(smooth_union(seat, back, blend=0.03), _FREQUENCY)


def quadruped(frequency: int = _FREQUENCY) -> TriangleMesh:
    """Return an animal in one piece, of 20 * frequency^2 triangles."""
    legs = [
        capsule((0.05 * x, -0.05, 0.1 * z), (0.25 * x, -0.55, 0.42 * z), 0.18, 0.14) for x in (-1, 1) for z in (-1, 1)
    ]
    trunk = capsule((0, 0, -0.42), (0, 0, 0.42), 0.27, 0.27)
    head, tail = capsule((0, 0, 0.2), (0, 0.42, 0.62), 0.18, 0.2), capsule((0, 0, -0.2), (0, 0.28, -0.72), 0.13, 0.08)
    return relaxed_surface(smooth_union(trunk, *legs, head, tail, blend=0.08), frequency)


def _toy() -> TriangleMesh:
    def ellipsoid(centre: _Point, half: _Point, frequency: int) -> TriangleMesh:
        ball = geodesic_sphere(frequency)
        return TriangleMesh(ball.verts * np.array(half) + np.array(centre), ball.faces)

    legs = [ellipsoid((0.2 * x, -0.35, 0.33 * z), (0.1, 0.32, 0.1), 3) for x in (-1, 1) for z in (-1, 1)]
    trunk = ellipsoid((0, 0, 0), (0.3, 0.26, 0.55), 6)
    head, tail = ellipsoid((0, 0.27, 0.55), (0.2, 0.24, 0.26), 5), ellipsoid((0, 0.13, -0.58), (0.08, 0.08, 0.24), 3)
    return join(trunk, head, tail, *legs)


SOURCES: dict[str, Callable[[], TriangleMesh]] = {
    "sphere": lambda: geodesic_sphere(_FREQUENCY),
    "cube": lambda: box(13),
    "cylinder": _cylinder,
    "torus": lambda: torus(0.6, 0.25, 44, 24),
    "vase": _vase,
    "armchair": _armchair,
    "quadruped": quadruped,
    "toy": _toy,
}
"""Every source by name."""


@cache
def source_mesh(name: str) -> TriangleMesh:
    """Return one of `SOURCES` (+Y up, facing +Z, about 1 unit in size); computed once per process."""
    return SOURCES[name]()
