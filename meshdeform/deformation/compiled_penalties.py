"""Compute the penalties of `regularizers` with their gradients in one compiled pass each.

The gradient is computed with the value, because almost all of the work is shared. Sums are added up in the order of
faces and edges, so the same input gives the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.geometry.kernels import kernel

__all__ = ["STRAINED", "bends", "crease_energy", "dirichlet_penalty", "jacobian_penalty", "normal_penalty", "penalty"]

_CREASE = 1 - math.cos(math.radians(15))
"""y_0: on the reference mesh, an angle of more than 15 degrees between neighbours counts as a crease."""
STRAINED = 100.0
"""Energy from which a face's distortion counts by its logarithm: no face outweighs all the others."""
_LEAST_DETERMINANT = 1e-16
"""Lower bound of det C with C = F^T F, a squared area ratio: the area ratio counts as at least 1e-8."""
_TINY_SQUARE = 1e-280
"""As in `geometry.mesh`: squared lengths below this count as zero."""

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]


def penalty(compute: Callable[[_Floats, _Floats | None], float], argument: Tensor) -> Tensor:
    """Return a penalty as a scalar, differentiable once in its argument.

    Parameters
    ----------
    compute : callable
        Takes the argument's values and, if it needs a gradient, an array of zeros of the same shape to which it adds
        the gradient; returns the value.
    argument : Tensor, float64
    """
    result: Tensor = _Penalty.apply(compute, argument)  # type: ignore[no-untyped-call]
    return result


class _Penalty(torch.autograd.Function):
    @staticmethod
    def forward(ctx: FunctionCtx, compute: Callable[[_Floats, _Floats | None], float], argument: Tensor) -> Tensor:
        values = argument.detach().contiguous().numpy()
        gradient = np.zeros(values.shape) if ctx.needs_input_grad[1] else None  # type: ignore[attr-defined]
        value = compute(values, gradient)
        ctx.gradient = gradient  # type: ignore[attr-defined]
        return torch.tensor(value, dtype=torch.float64)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[None, Tensor]:
        return None, upstream * torch.from_numpy(ctx.gradient)


@kernel
def _unit_normals(verts: _Floats, faces: _Index) -> tuple[_Floats, _Floats]:
    """Return the unit normals (F, 3) and the inverse lengths (F,) of the cross products; zero if a face has no area."""
    normals, inverse = np.zeros((len(faces), 3)), np.zeros(len(faces))
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        bx, by, bz = verts[j, 0] - verts[i, 0], verts[j, 1] - verts[i, 1], verts[j, 2] - verts[i, 2]
        cx, cy, cz = verts[k, 0] - verts[i, 0], verts[k, 1] - verts[i, 1], verts[k, 2] - verts[i, 2]
        x, y, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        square = x * x + y * y + z * z
        if square > _TINY_SQUARE:
            inverse[f] = 1.0 / np.sqrt(square)
            normals[f, 0], normals[f, 1], normals[f, 2] = x * inverse[f], y * inverse[f], z * inverse[f]
    return normals, inverse


@kernel
def _bend(verts: _Floats, normals: _Floats, pairs: _Index, ends: _Index, sign: _Floats, e: int) -> tuple[float, float]:
    """Return cosine and sine of the signed angle between the normals at an edge."""
    f, g, i, j, s = pairs[e, 0], pairs[e, 1], ends[e, 0], ends[e, 1], sign[e]
    ax, ay, az = normals[f, 0], normals[f, 1], normals[f, 2]
    bx, by, bz = s * normals[g, 0], s * normals[g, 1], s * normals[g, 2]
    dx, dy, dz = verts[j, 0] - verts[i, 0], verts[j, 1] - verts[i, 1], verts[j, 2] - verts[i, 2]
    square = dx * dx + dy * dy + dz * dz
    turned = dx * (ay * bz - az * by) + dy * (az * bx - ax * bz) + dz * (ax * by - ay * bx)
    return ax * bx + ay * by + az * bz, turned / np.sqrt(square) if square > _TINY_SQUARE else 0.0


@kernel
def bends(verts: _Floats, faces: _Index, pairs: _Index, ends: _Index, sign: _Floats) -> _Floats:
    """Return cosine and sine (E, 2) of the signed angles between the normals of neighbouring faces.

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64
    pairs : (E, 2) int64
        The two faces at each edge.
    ends : (E, 2) int64
        The edge's vertices.
    sign : (E,) float64
        -1 where the two faces are wound inconsistently, otherwise 1.
    """
    normals, _ = _unit_normals(verts, faces)
    out = np.empty((len(pairs), 2))
    for e in range(len(pairs)):
        out[e, 0], out[e, 1] = _bend(verts, normals, pairs, ends, sign, e)
    return out


@kernel
def _smooth_part(y: float) -> tuple[float, float]:
    """Return h(y), y^2 up to y_0 and proportional to the square root plus a constant beyond, and h'(y)."""
    if y < _CREASE:
        return y * y, 2 * y
    root = np.sqrt(_CREASE**3 * y)
    return 4 * root - 3 * _CREASE**2, 2 * root / y


@kernel
def _energy(c: float, scale: float) -> tuple[float, float]:
    """Return g(c) of c = 1 - cos t, and g'(c); `scale` is r^2 of the edge."""
    near, near_slope = _smooth_part(scale * c)
    own, own_slope = _smooth_part(c)
    root = np.sqrt(scale)
    return near + root * (c * c - own), scale * near_slope + root * (2 * c - own_slope)


@kernel
def crease_energy(cosine: _Floats, scale: _Floats) -> _Floats:
    """Return g (E,) of edges with these cosines (E,) and r^2 (E,)."""
    out = np.empty(len(cosine))
    for e in range(len(cosine)):
        out[e] = _energy(max(1.0 - cosine[e], 0.0), scale[e])[0]
    return out


@kernel
def normal_penalty(
    verts: _Floats,
    faces: _Index,
    pairs: _Index,
    ends: _Index,
    sign: _Floats,
    rest_sine: _Floats,
    rest_energy: _Floats,
    weights: _Floats,
    scale: _Floats,
    gradient: _Floats | None,
) -> float:
    """Return the bending beyond rest; add its gradient (V, 3).

    Parameters
    ----------
    verts, faces, pairs, ends, sign
        As in `bends`.
    rest_sine, rest_energy : (E,) float64
        Sine of each angle at rest, and g of it.
    weights, scale : (E,) float64
        Share of the area and r^2 of each edge.
    """
    normals, inverse = _unit_normals(verts, faces)
    d_normals = np.zeros((len(faces), 3))
    total = 0.0
    for e in range(len(pairs)):
        cosine, sine = _bend(verts, normals, pairs, ends, sign, e)
        energy, slope = _energy(max(1.0 - cosine, 0.0), scale[e])
        # At an edge that bends to the other side than at rest, all bending counts.
        beyond = energy - (rest_energy[e] if sine * rest_sine[e] > 0 else 0.0)
        if beyond < 0.0:
            continue
        total += weights[e] * beyond
        if cosine <= 1.0:
            by_cosine = -weights[e] * slope * sign[e]
            f, g = pairs[e, 0], pairs[e, 1]
            for c in range(3):
                d_normals[f, c] += by_cosine * normals[g, c]
                d_normals[g, c] += by_cosine * normals[f, c]
    if gradient is not None:
        _through_normals(verts, faces, normals, inverse, d_normals, gradient)
    return total


@kernel
def _through_normals(
    verts: _Floats, faces: _Index, normals: _Floats, inverse: _Floats, d_normals: _Floats, gradient: _Floats
) -> None:
    """Add the gradient (V, 3) of the vertices that the unit normals' gradient (F, 3) means."""
    for f in range(len(faces)):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        along = 0.0
        for c in range(3):
            along += normals[f, c] * d_normals[f, c]
        gx = (d_normals[f, 0] - along * normals[f, 0]) * inverse[f]
        gy = (d_normals[f, 1] - along * normals[f, 1]) * inverse[f]
        gz = (d_normals[f, 2] - along * normals[f, 2]) * inverse[f]
        bx, by, bz = verts[j, 0] - verts[i, 0], verts[j, 1] - verts[i, 1], verts[j, 2] - verts[i, 2]
        cx, cy, cz = verts[k, 0] - verts[i, 0], verts[k, 1] - verts[i, 1], verts[k, 2] - verts[i, 2]
        jx, jy, jz = cy * gz - cz * gy, cz * gx - cx * gz, cx * gy - cy * gx
        kx, ky, kz = gy * bz - gz * by, gz * bx - gx * bz, gx * by - gy * bx
        gradient[j, 0] += jx
        gradient[j, 1] += jy
        gradient[j, 2] += jz
        gradient[k, 0] += kx
        gradient[k, 1] += ky
        gradient[k, 2] += kz
        gradient[i, 0] -= jx + kx
        gradient[i, 1] -= jy + ky
        gradient[i, 2] -= jz + kz


@kernel
def dirichlet_penalty(
    verts: _Floats, faces: _Index, inverse_rest: _Floats, weights: _Floats, gradient: _Floats | None
) -> float:
    """Return the mean logarithm of the symmetric Dirichlet energy less its minimum; add its gradient (V, 3).

    Parameters
    ----------
    verts : (V, 3) float64
    faces : (F, 3) int64
        Those with an area at rest.
    inverse_rest : (F, 2, 2) float64
        Inverse of two edges at rest, as columns in coordinates of the face's plane.
    weights : (F,) float64
        Share of the area.
    """
    total = 0.0
    for f in range(len(faces)):
        i, j, k, inverse = faces[f, 0], faces[f, 1], faces[f, 2], inverse_rest[f]
        ee = em = mm = 0.0
        for c in range(3):
            u, v = verts[j, c] - verts[i, c], verts[k, c] - verts[i, c]
            first, second = u * inverse[0, 0] + v * inverse[1, 0], u * inverse[0, 1] + v * inverse[1, 1]
            ee += first * first
            em += first * second
            mm += second * second
        trace, exact = ee + mm, ee * mm - em * em
        determinant = max(exact, _LEAST_DETERMINANT)
        energy = trace + trace / determinant - 4
        total += weights[f] * STRAINED * math.log1p(energy / STRAINED)
        if gradient is None:
            continue
        weight = weights[f] / (1 + energy / STRAINED)
        by_trace = weight * (1 + 1 / determinant)
        by_determinant = -weight * trace / determinant**2 if exact >= _LEAST_DETERMINANT else 0.0
        by_ee, by_mm, by_em = by_trace + by_determinant * mm, by_trace + by_determinant * ee, -2 * by_determinant * em
        for c in range(3):
            u, v = verts[j, c] - verts[i, c], verts[k, c] - verts[i, c]
            first, second = u * inverse[0, 0] + v * inverse[1, 0], u * inverse[0, 1] + v * inverse[1, 1]
            by_first, by_second = 2 * by_ee * first + by_em * second, 2 * by_mm * second + by_em * first
            by_u = inverse[0, 0] * by_first + inverse[0, 1] * by_second
            by_v = inverse[1, 0] * by_first + inverse[1, 1] * by_second
            gradient[j, c] += by_u
            gradient[k, c] += by_v
            gradient[i, c] -= by_u + by_v
    return total


@kernel
def jacobian_penalty(jacobians: _Floats, weights: _Floats, gradient: _Floats | None) -> float:
    """Return the weighted sum of ||J - I||^2 of Jacobians (F, 3, 3); add its gradient."""
    total = 0.0
    for f in range(len(jacobians)):
        for i in range(3):
            for j in range(3):
                difference = jacobians[f, i, j] - (1.0 if i == j else 0.0)
                total += weights[f] * difference * difference
                if gradient is not None:
                    gradient[f, i, j] += 2 * weights[f] * difference
    return total
