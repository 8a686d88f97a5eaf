"""Compute the regularisers, which do not depend on mesh resolution or scale.

The published forms are means over faces, vertices and edges, and two of them change with the tessellation: halving
the edges divides the umbrella Laplacian by four and (1 - n_i . n_j)^2 by sixteen. Here each is a discretised integral
over the rest surface of area A:

* jacobian   1/A  sum_f |f| ||J_f - I||^2                       the published mean, weighted by area
* laplacian  1/4pi  sum_v m_v ||(M^-1 L u)_v||^2                 the integral of |Delta u|^2 of the displacement u;
  dimensionless; details of the rest shape cost nothing, only bending relative to it
* normal     1/A  sum_e a_e max(0, g_e(1 - cos t_e) - g_e(1 - cos t_e0))    t_e the signed angle between the normals of
  the two faces, t_e0 at rest (0 where t_e has the other sign); g_e(c) = h(r_e^2 c) + r_e (c^2 - h(c)); r_e = d_0 / d_e,
  d_e the distance between their centroids at rest, d_0 that distance on a uniform mesh of 5,000 faces; a_e the edge's
  share of the area; h(y) = y^2 up to y_0, beyond it 4 sqrt(y_0^3 y) - 3 y_0^2
* dirichlet  1/A  sum_f |f| b log(1 + E_f / b)  with E_f = s_1^2 + s_2^2 + s_1^-2 + s_2^-2 - 4 of the singular values of
  each face's map, in its plane: zero where no length changes, infinite where a face collapses; b = 100, so that a face
  that nearly does outweighs no others. Not in the paper

The normal term is relative to rest: a crease costs nothing unless it becomes sharper than at rest or folds to the other
side. It is the published energy minus its value at rest, so it resists the growth of sharp corners into spikes like the
published term, but does not flatten them. A term in the change of the angle alone was tried: it is weak where a corner
of a cube begins to fold, and the guard then holds back the whole shape.

The term is independent of resolution for both kinds of bending. Under smooth bending, t_e is proportional to d_e and c
to d_e^2: r_e^2 c does not change as the mesh is refined, the a_e add up to the area, and the second part of g is zero.
A crease bends by the same angle at every resolution, while the area beside it shrinks as d_e: there g is r_e c^2 except
for 3 y_0^2 (r_e - 1). At the reference resolution, r_e = 1, the value is exactly the published (1 - n_i . n_j)^2 if the
rest surface is flat.

Sources: Xu et al. 2024, FusionDeformer, eq. 9 to 13; Gao et al. 2023, TextDeformer; Grinspun et al. 2003, Discrete
Shells (bending against rest); Huber 1964, Robust estimation of a location parameter (the change from square to linear);
Smith and Schaefer 2015, Bijective Parameterization with Free Boundaries, eq. 2 (symmetric Dirichlet, here less its
minimum).

Each penalty is computed with its gradient in one compiled pass, because almost all of the work is shared. Sums are
added up in the order of faces and edges, so the same input gives the same bits.

`Pulls` measures how hard each regulariser pulls against the guidance. A term's pull is the norm of its gradient with
respect to the variables. That of the guidance differs tenfold from one step to the next, with the noise; so both are
summed over the measured steps before they are compared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import sparse
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.tensors import through_normals, verts_of

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
REFERENCE_FACES = 5000
_MASS_FLOOR = 0.1
_DISTANCE_FLOOR = 0.1
TERMS = ("guidance", "jacobian", "laplacian", "normal", "dirichlet")

_EVERY_STEPS, _FIRST = 20, 10
"""A measurement takes a third of a step. At step 0 the regularisers of most runs are zero."""


def penalty(compute: Callable[[_Floats, _Floats | None], float], argument: Tensor) -> Tensor:
    """Return a penalty as a scalar, differentiable once in its argument.

    Parameters
    ----------
    compute : callable
        Takes the argument's values and, if it needs a gradient, an array of zeros of the same shape to which it adds
        the gradient; returns the value.
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


class Creases(NamedTuple):
    """Edges between neighbouring faces: `pairs` (E, 2) int64 of faces, and `ends` (E, 2) int64, vertices.

    `sign` (E,) float64: -1 where the two faces are wound inconsistently, otherwise 1.
    """

    pairs: _Index
    ends: _Index
    sign: _Floats


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
def _bend(verts: _Floats, normals: _Floats, creases: Creases, e: int) -> tuple[float, float]:
    """Return cosine and sine of the signed angle between the normals at an edge."""
    pairs, ends = creases.pairs, creases.ends
    f, g, i, j, s = pairs[e, 0], pairs[e, 1], ends[e, 0], ends[e, 1], creases.sign[e]
    ax, ay, az = normals[f, 0], normals[f, 1], normals[f, 2]
    bx, by, bz = s * normals[g, 0], s * normals[g, 1], s * normals[g, 2]
    dx, dy, dz = verts[j, 0] - verts[i, 0], verts[j, 1] - verts[i, 1], verts[j, 2] - verts[i, 2]
    square = dx * dx + dy * dy + dz * dz
    turned = dx * (ay * bz - az * by) + dy * (az * bx - ax * bz) + dz * (ax * by - ay * bx)
    return ax * bx + ay * by + az * bz, turned / np.sqrt(square) if square > _TINY_SQUARE else 0.0


@kernel
def bends(verts: _Floats, faces: _Index, creases: Creases) -> _Floats:
    """Return cosine and sine (E, 2) of the signed angles between the normals of neighbouring faces.

    `verts` is (V, 3) float64; `faces`, (F, 3) int64.
    """
    normals, _ = _unit_normals(verts, faces)
    out = np.empty((len(creases.pairs), 2))
    for e in range(len(out)):
        out[e, 0], out[e, 1] = _bend(verts, normals, creases, e)
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
    creases: Creases,
    rest_sine: _Floats,
    rest_energy: _Floats,
    weights: _Floats,
    scale: _Floats,
    gradient: _Floats | None,
) -> float:
    """Return the bending beyond rest; add its gradient (V, 3).

    `verts`, `faces` and `creases`: as in `bends`; `rest_sine` and `rest_energy`, (E,) float64: sine of
    each angle at rest, and g of it; `weights` and `scale`, (E,) float64: share of the area and r^2 of each edge.
    """
    normals, inverse = _unit_normals(verts, faces)
    d_normals = np.zeros((len(faces), 3))
    total = 0.0
    pairs, sign = creases.pairs, creases.sign
    for e in range(len(pairs)):
        cosine, sine = _bend(verts, normals, creases, e)
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
        through_normals(verts, faces, normals, inverse, d_normals, gradient)
    return total


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


class Regularizers:
    """Penalties of one rest mesh; every method returns a float64 scalar, differentiable in its argument.

    Parameters
    ----------
    mesh : TriangleMesh
        Faces without area are left out, as are edges of such faces, border edges and edges of more than two faces.
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        rest = RestMesh.of(mesh)
        self._faces, self._rest = rest.faces, rest.verts
        total = max(float(rest.areas.sum()), 1e-300)
        self._face_weights = rest.areas / total
        mass = rest.vertex_areas
        used = mass > 0
        # Vertices of needle triangles have almost no mass, and there M^-1 L u is no meaningful curvature.
        floor = _MASS_FLOOR * float(mass[used].mean()) if used.any() else 1.0
        root = sparse.diags(np.where(used, 1 / np.sqrt(np.maximum(mass, floor)), 0.0))
        self._half_operator = (root @ rest.laplacian).tocsr()
        self._transposed = self._half_operator.T.tocsr()
        self._init_edges(rest, rest.areas, total)
        solid = rest.faces[rest.solid]
        inverse = torch.linalg.inv(_in_plane(verts_of(rest)[solid])).contiguous().numpy()
        self._solid = (solid, inverse, self._face_weights[rest.solid])

    def _init_edges(self, mesh: RestMesh, areas: NDArray[np.float64], total: float) -> None:
        edges = mesh.edges
        # Two faces are neighbours only where exactly two meet and they are not duplicates of each other.
        kept = (edges.counts == 2) & (edges.opposite[:, 0] != edges.opposite[:, 1])
        kept[kept.copy()] = (areas[edges.faces[kept]] > 0).all(1)
        pairs, ends = edges.faces[kept], edges.edges[kept]
        # Neighbours of inconsistent winding have opposite normals where the surface is flat.
        sign = np.where(edges.consistent[kept], 1.0, -1.0)
        creases = Creases(*(np.ascontiguousarray(each) for each in (pairs, ends, sign)))
        rest_bend = bends(mesh.verts, np.ascontiguousarray(self._faces), creases)
        centroids = mesh.verts[mesh.faces].mean(1)
        squared = ((centroids[pairs[:, 0]] - centroids[pairs[:, 1]]) ** 2).sum(1)
        squared = np.maximum(squared, _DISTANCE_FLOOR * squared.mean() if len(pairs) else 0.0)
        # Centroids of equilateral neighbours of area a are 2/3 of a height apart: d^2 = 4 a / (3 sqrt 3).
        reference_sq = 4 / (3 * math.sqrt(3)) * total / REFERENCE_FACES
        self._edge_scale = scale = reference_sq / squared
        weights = areas[pairs].sum(1) / 3 / total
        rest_energy = crease_energy(np.ascontiguousarray(rest_bend[:, 0]), scale)
        rest_sine = np.ascontiguousarray(rest_bend[:, 1])
        self._edges = (np.ascontiguousarray(self._faces), creases, rest_sine, rest_energy, weights)

    def jacobian(self, jacobians: Tensor) -> Tensor:
        """Return the area-weighted mean of ||J - I||^2 (squared Frobenius norm) of Jacobians (F, 3, 3)."""
        return penalty(lambda values, gradient: jacobian_penalty(values, self._face_weights, gradient), jacobians)

    def laplacian(self, verts: Tensor) -> Tensor:
        """Return the integral of the squared Laplacian of the displacement of positions (V, 3), divided by 4 pi."""
        return penalty(self._bending, verts)

    def _bending(self, verts: _Floats, gradient: _Floats | None) -> float:
        bent = self._half_operator @ (verts - self._rest)
        if gradient is not None:
            gradient += self._transposed @ (bent / (2 * math.pi))
        return float((bent * bent).sum() / (4 * math.pi))

    def normal(self, verts: Tensor) -> Tensor:
        """Return the bending of neighbouring faces beyond rest: a dimensionless, area-weighted mean.

        Neighbours are two faces at an edge of no other face; if their winding is inconsistent, one normal is flipped.
        """
        # A face that has collapsed since has a zero normal and a constant cost.
        return penalty(lambda values, gradient: normal_penalty(values, *self._edges, self._edge_scale, gradient), verts)

    def dirichlet(self, verts: Tensor) -> Tensor:
        """Return the mean logarithm of the symmetric Dirichlet energy of positions (V, 3), zero for a rigid motion.

        Dimensionless, weighted by area. With F the face's map in coordinates of its rest plane
        and C = F^T F, the energy is E = tr C + tr C / det C - 4.
        Faces without area at rest are left out.
        """
        return penalty(lambda values, gradient: dirichlet_penalty(values, *self._solid, gradient), verts)


def _in_plane(corners: Tensor) -> Tensor:
    """Return two edges of each triangle (F, 3, 3) as columns of a 2 x 2 matrix, in coordinates of its own plane."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = first.norm(dim=1)
    along = (first * second).sum(1) / length
    across = torch.linalg.cross(first, second).norm(dim=1) / length
    return torch.stack([torch.stack([length, along], 1), torch.stack([torch.zeros_like(length), across], 1)], 1)


class Pulls:
    """Sums of the pulls of the terms of a loss.

    `sums`, (5,) float64: in the order of `TERMS`, over the measured steps.
    """

    def __init__(self) -> None:
        self.sums = torch.zeros(len(TERMS), dtype=torch.float64)

    def measure(self, terms: Mapping[str, Tensor], variables: Sequence[Tensor], step: int) -> None:
        """Add the pulls of the terms, if this step is one of those to measure.

        Parameters
        ----------
        terms : mapping of name to () float64
            Some of `TERMS`, weighted; their graphs are kept.
        step : int
            Number of completed steps.
        """
        if step % _EVERY_STEPS != _FIRST:
            return
        for row, name in enumerate(TERMS):
            if name in terms and terms[name].requires_grad:
                gradients = torch.autograd.grad(terms[name], variables, retain_graph=True, allow_unused=True)
                squares = sum(float(gradient.square().sum()) for gradient in gradients if gradient is not None)
                self.sums[row] += squares**0.5

    def to_dict(self) -> dict[str, float] | None:
        """Return each regulariser's pull as a multiple of the guidance's; None before the first measurement."""
        guidance, *regularizers = self.sums.tolist()
        if guidance == 0:
            return None
        return {name: pull / guidance for name, pull in zip(TERMS[1:], regularizers, strict=True)}

    @property
    def warnings(self) -> list[str]:
        """A sentence for each regulariser that pulls harder than the guidance: it decides the shape."""
        return [
            f"The regulariser `{name}` pulled {pull:.1f} times as hard as the guidance: lower its weight to change the "
            "asset further."
            for name, pull in (self.to_dict() or {}).items()
            if pull > 1
        ]
