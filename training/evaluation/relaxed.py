"""Triangulate star-shaped solids evenly: project a geodesic sphere onto the surface and relax it there.

A solid is a function of points that is negative inside. Every vertex of the sphere moves along its ray from the origin
to the zero of the function. Then vertices alternately move tangentially to the area-weighted centroid of their
neighbours and back to the surface along the gradient, which evens out the triangles without moving the surface.

Sources: Wenninger 1979, Spherical Models (geodesic subdivision); Botsch and Kobbelt 2004, A Remeshing Approach to
Multiresolution Modeling, section 4 (tangential relaxation with areas as weights).
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from meshdeform.geometry.mesh import TriangleMesh
from meshdeform.geometry.shapes import icosphere
from meshdeform.geometry.tensors import face_cross, faces_of, safe_normalize, verts_of

Solid = Callable[[Tensor], Tensor]
"""Maps points (N, 3) float64 to values (N,): negative inside, increasing along every ray from the origin."""

_FAR = 4.0


def geodesic_sphere(frequency: int) -> TriangleMesh:
    """Return the unit sphere of 20 `frequency`^2 triangles: each face of the icosahedron split into `frequency`^2."""
    base, n = icosphere(0), frequency
    points: list[Tensor] = []
    faces: list[tuple[int, int, int]] = []
    for a, b, c in verts_of(base)[faces_of(base)]:
        first = len(points) * (n + 1) * (n + 2) // 2
        rows = [[first + i * (i + 1) // 2 + j for j in range(i + 1)] for i in range(n + 1)]
        points.append(torch.stack([a * (n - i) + b * (i - j) + c * j for i in range(n + 1) for j in range(i + 1)]) / n)
        for i in range(n):
            faces += [(rows[i][j], rows[i + 1][j], rows[i + 1][j + 1]) for j in range(i + 1)]
            faces += [(rows[i][j], rows[i + 1][j + 1], rows[i][j + 1]) for j in range(i)]
    every = torch.cat(points)
    _, inverse = torch.unique((every * 1e6).round().long(), dim=0, return_inverse=True)
    verts = torch.zeros(int(inverse.max()) + 1, 3, dtype=torch.float64).index_copy(0, inverse, every)
    return TriangleMesh(torch.nn.functional.normalize(verts, dim=1).numpy(), inverse[torch.tensor(faces)].numpy())


def capsule(start: tuple[float, float, float], end: tuple[float, float, float], thick: float, thin: float) -> Solid:
    """Return a limb from `start` to `end` with radius from `thick` to `thin`; a signed distance if they are equal."""
    a = torch.tensor(start, dtype=torch.float64)
    axis = torch.tensor(end, dtype=torch.float64) - a

    def value(points: Tensor) -> Tensor:
        along = (((points - a) @ axis) / (axis @ axis)).clamp(0, 1)
        distance: Tensor = (points - a - along[:, None] * axis).norm(dim=1)
        return distance - (thick + (thin - thick) * along)

    return value


def smooth_union(*solids: Solid, blend: float) -> Solid:
    """Return the union with rounded seams: ``-blend log sum exp(-f / blend)``."""
    return lambda points: -blend * torch.logsumexp(torch.stack([-f(points) / blend for f in solids]), 0)


def relaxed_surface(solid: Solid, frequency: int, *, rounds: int = 100) -> TriangleMesh:
    """Triangulate the surface of `solid` by 20 `frequency`^2 even triangles, counter-clockwise from outside."""
    sphere = geodesic_sphere(frequency)
    faces = faces_of(sphere)
    verts = _cast(solid, verts_of(sphere))
    corners = faces.reshape(-1)
    for _ in range(rounds):
        cross = face_cross(verts, faces)
        areas = cross.norm(dim=1)
        middle = verts[faces].mean(1)
        weight = torch.zeros(len(verts), dtype=torch.float64).index_add_(0, corners, areas.repeat_interleave(3))
        pull = torch.zeros_like(verts).index_add_(0, corners, (areas[:, None] * middle).repeat_interleave(3, 0))
        step = pull / weight[:, None] - verts
        normal = safe_normalize(torch.zeros_like(verts).index_add_(0, corners, cross.repeat_interleave(3, 0)))
        verts = verts + 0.7 * (step - (step * normal).sum(1, keepdim=True) * normal)
        for _ in range(2):
            verts = _newton(solid, verts)
    return TriangleMesh(verts.numpy(), sphere.faces)


def _cast(solid: Solid, rays: Tensor) -> Tensor:
    """Find the point where each ray from the origin leaves the solid, by bisection."""
    low, high = torch.zeros(len(rays), 1, dtype=torch.float64), torch.full((len(rays), 1), _FAR, dtype=torch.float64)
    for _ in range(50):
        middle = (low + high) / 2
        inside = (solid(rays * middle) < 0)[:, None]
        low, high = torch.where(inside, middle, low), torch.where(inside, high, middle)
    return rays * low


def _newton(solid: Solid, verts: Tensor) -> Tensor:
    """Take one Newton step along the gradient towards the surface."""
    points = verts.detach().requires_grad_()
    value = solid(points)
    (gradient,) = torch.autograd.grad(value.sum(), points)
    square = (gradient * gradient).sum(1).clamp_min(1e-6)
    return (points - (value / square).clamp(-0.1, 0.1)[:, None] * gradient).detach()
