"""Project points to a surface, whatever describes it: a mesh, oriented points, a distance grid, a network.

Each gives `project` and a reference: a dense mesh from which the base is made, and with which the result is compared.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn import functional

from meshdeform.errors import AssetError
from meshdeform.geometry.isosurface import continued, isosurface
from meshdeform.geometry.kernels import kernel
from meshdeform.geometry.mesh import connected_components, face_normals
from meshdeform.geometry.nearest_points import SurfaceTree
from meshdeform.geometry.surface_samples import surface_samples
from meshdeform.kinds.surface_fit.cleaning import CleanMesh, clean
from meshdeform.kinds.surface_fit.oriented_points import poisson_grid
from meshdeform.kinds.surface_fit.params import MAX_BASE_FACES
from meshdeform.kinds.surface_fit.surface_files import DistanceGrid, ImplicitNetwork, OrientedPoints, coarsening

_Floats = NDArray[np.float64]
_Index = NDArray[np.int64]

_CELLS = 96
"""Cells along the longest side where a surface must first be extracted."""
_NEIGHBOURS = 16
_STRAY, _MOST_STRAYS = 20.0, 0.01
"""Times the usual distance of neighbours from which on a point is a stray, and the share of points that may be: one
scanned amiss would else make the grid so large that all the rest is a few of its cells."""
_BEYOND = 3.0
"""Times the usual distance of neighbours from which on a face closes a hole of the cloud."""
_NEWTON_STEPS = 4
_CHUNK = 65_536


class SourceSurface(Protocol):
    """A surface in the source's own coordinates."""

    kind: str  # `mesh`, `points`, `grid` or `network`
    reference: CleanMesh

    def samples(self, count: int) -> tuple[_Floats, _Floats]:
        """Return points of what was given (P, 3) and unit normals (P, 3) there, about `count` of them."""

    def project(self, points: _Floats, normals: _Floats) -> tuple[_Floats, _Floats]:
        """Return the nearest places on the surface (P, 3), and its unit normals (P, 3) there.

        Parameters
        ----------
        points : (P, 3) float64
            Near the surface.
        normals : (P, 3) float64
            Unit normals of the surface to which the points belong; zero if unknown. They tell the sides of a thin wall.
        """


def surface_of(
    source: CleanMesh | OrientedPoints | DistanceGrid | ImplicitNetwork, base_faces: int = MAX_BASE_FACES
) -> SourceSurface:
    """Return the surface that a file describes, if a base of so many faces can have its handles.

    Raises
    ------
    AssetError
        It has no surface of which a base can be made.
    """
    if isinstance(source, OrientedPoints):
        return PointSurface(source, base_faces)
    if isinstance(source, DistanceGrid):
        return GridSurface(source, base_faces)
    return NetworkSurface(source, base_faces) if isinstance(source, ImplicitNetwork) else MeshSurface(source)


class _Sampled:
    reference: CleanMesh

    def samples(self, count: int) -> tuple[_Floats, _Floats]:
        """Return places of the mesh and their normals."""
        return surface_samples(self.reference.verts, self.reference.faces, count, seed=0)


class MeshSurface(_Sampled):
    """A mesh: the nearest place, and the normal of its triangle."""

    kind = "mesh"

    def __init__(self, mesh: CleanMesh) -> None:
        self.reference = mesh
        self._normals = face_normals(mesh.verts, mesh.faces)
        self._tree = SurfaceTree.of(mesh.verts, mesh.faces, slack=0.1)

    def project(self, points: _Floats, normals: _Floats) -> tuple[_Floats, _Floats]:
        """Return the nearest places, and the normals of their triangles."""
        face, weights = self._tree.find(points, normals)
        return np.einsum("pk,pkc->pc", weights, self.reference.verts[self.reference.faces[face]]), self._normals[face]


class PointSurface:
    """Oriented points: the zero set of the implicit moving least squares of their tangent planes.

    Source: Shen, O'Brien and Shewchuk 2004; Kolluri 2008, Provably Good Moving Least Squares.
    """

    kind = "points"

    def __init__(self, cloud: OrientedPoints, base_faces: int) -> None:
        points, self._count = cloud.points, min(_NEIGHBOURS, len(cloud.points))
        self._tree = cKDTree(points)
        far = self._tree.query(points, k=self._count)[0][:, -1]
        stray = far > _STRAY * np.median(far)
        if not 0 < stray.mean() <= _MOST_STRAYS:
            stray[:] = False
        self._points, self._normals = points[~stray], cloud.normals[~stray]
        # Of a closed surface with normals to the outside, this is three times the volume.
        around = self._points - self._points.mean(0)
        turned = float(np.average((around * self._normals).sum(1), weights=far[~stray] ** 2)) < 0
        if turned:
            self._normals = -self._normals
        if stray.any():
            self._tree = cKDTree(self._points)
        self._width = float(np.median(far)) / 2
        phi, origin, spacing = poisson_grid(self._points, self._normals)
        verts, faces = isosurface(phi, origin, np.full(3, spacing))
        beyond = self._tree.query(verts[faces].mean(1))[0] > _BEYOND * np.median(far)
        if beyond.mean() > _MOST_STRAYS:  # open: what closes it has no points
            faces = faces[~beyond]
        self.reference = _reference(verts, faces, self, base_faces, "The points enclose nothing.")
        self.reference.cleaned.update(stray_points=int(stray.sum()), turned_normals=len(points) if turned else 0)

    def samples(self, count: int) -> tuple[_Floats, _Floats]:
        """Return the points that were given, about `count` of them."""
        some = slice(None, None, max(len(self._points) // count, 1))
        return self._points[some], self._normals[some]

    def project(self, points: _Floats, normals: _Floats) -> tuple[_Floats, _Floats]:
        """Return points of the zero set, by moving along the mean normal of the neighbours, and that normal."""
        projected, directions = points.copy(), np.empty_like(points)
        for start in range(0, len(points), _CHUNK):
            rows = slice(start, start + _CHUNK)
            near = self._tree.query(points[rows], k=self._count)[1]
            _settle(
                projected[rows], directions[rows], normals[rows], near, self._points, self._normals, 2 * self._width**2
            )
        return projected, directions


@kernel
def _settle(
    at: _Floats, direction: _Floats, hints: _Floats, near: _Index, places: _Floats, normals: _Floats, spread: float
) -> None:
    """Move points along the mean normals of their neighbours to the mean of the tangent planes; set those normals."""
    facing = np.empty(near.shape[1])
    for p in range(len(at)):
        known = hints[p, 0] != 0.0 or hints[p, 1] != 0.0 or hints[p, 2] != 0.0
        for k in range(len(facing)):
            n, facing[k] = near[p, k], 1.0
            if known:  # neighbours on the other side of a thin wall do not count
                product = normals[n, 0] * hints[p, 0] + normals[n, 1] * hints[p, 1] + normals[n, 2] * hints[p, 2]
                facing[k] = min(max(product, 0.0), 1.0) + 1e-6
        for _ in range(_NEWTON_STEPS):
            total, height, x, y, z = 0.0, 0.0, 0.0, 0.0, 0.0
            for k in range(len(facing)):
                n = near[p, k]
                a, b, c = at[p, 0] - places[n, 0], at[p, 1] - places[n, 1], at[p, 2] - places[n, 2]
                weight = facing[k] * (np.exp(-(a * a + b * b + c * c) / spread) + 1e-12)
                total += weight
                height += weight * (a * normals[n, 0] + b * normals[n, 1] + c * normals[n, 2])
                x, y, z = x + weight * normals[n, 0], y + weight * normals[n, 1], z + weight * normals[n, 2]
            length = max(np.sqrt(x * x + y * y + z * z) / total, 1e-12) * total
            direction[p, 0], direction[p, 1], direction[p, 2] = x / length, y / length, z / length
            for i in range(3):
                at[p, i] -= height / total * direction[p, i]


class _Implicit(_Sampled):
    """The zero set of a function with a gradient: Newton's method along the gradient."""

    _reach: float

    def _value(self, points: Tensor) -> tuple[Tensor, Tensor]:
        raise NotImplementedError

    def project(self, points: _Floats, normals: _Floats) -> tuple[_Floats, _Floats]:  # noqa: ARG002 - a field has sides
        """Return points of the zero set and the directions of the gradient there."""
        projected, directions = np.empty_like(points), np.empty_like(points)
        for start in range(0, len(points), _CHUNK):
            at = torch.from_numpy(points[start : start + _CHUNK])
            for _ in range(_NEWTON_STEPS):
                value, gradient = self._value(at)
                squared = (gradient**2).sum(1, keepdim=True).clamp_min(1e-24)
                step = value[:, None] * gradient / squared
                length = step.norm(dim=1, keepdim=True).clamp_min(1e-300)
                at = at - step * (self._reach / length).clamp_max(1.0)
            gradient = self._value(at)[1]
            projected[start : start + _CHUNK] = at.numpy()
            directions[start : start + _CHUNK] = functional.normalize(gradient, dim=1).numpy()
        return projected, directions


class GridSurface(_Implicit):
    """A grid of signed distances, interpolated linearly; its gradient is that of central differences.

    Where the distances end at a constant, they are continued.
    """

    kind = "grid"

    def __init__(self, grid: DistanceGrid, base_faces: int) -> None:
        self._origin, self._spacing = torch.from_numpy(grid.origin), torch.from_numpy(grid.spacing)
        values = continued(grid.values, grid.spacing)
        gradient = np.gradient(values, *grid.spacing)
        # grid_sample wants channels first, and the last axis of the grid first in coordinates.
        self._volume = torch.from_numpy(np.stack([values, *gradient])[None])
        self._most = torch.tensor(grid.values.shape, dtype=torch.float64) - 1
        self._reach = 2 * float(grid.spacing.max())
        step = coarsening(grid.values.shape)
        coarse = values[::step, ::step, ::step]
        verts, faces = isosurface(coarse, grid.origin, grid.spacing * step)
        self.reference = _reference(verts, faces, self, base_faces, "The grid has no closed surface.")

    def _value(self, points: Tensor) -> tuple[Tensor, Tensor]:
        places = 2 * (points - self._origin) / self._spacing / self._most - 1
        sampled = functional.grid_sample(
            self._volume, places.flip(1)[None, :, None, None], align_corners=True, padding_mode="border"
        )[0, :, :, 0, 0]
        return sampled[0], sampled[1:].T


class NetworkSurface(_Implicit):
    """A network from a point to a signed value."""

    kind = "network"

    def __init__(self, network: ImplicitNetwork, base_faces: int) -> None:
        self._layers = [(torch.from_numpy(w), torch.from_numpy(b)) for w, b in network.layers]
        self._activation, self._omega = network.activation, network.omega
        low, high = network.bounds
        spacing = float((high - low).max()) / _CELLS
        self._reach = 2 * spacing
        shape = np.maximum(np.ceil((high - low) / spacing).astype(int), 1) + 1
        axes = [low[i] + spacing * np.arange(shape[i]) for i in range(3)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
        values = np.concatenate(
            [self._forward(torch.from_numpy(points[i : i + _CHUNK])).numpy() for i in range(0, len(points), _CHUNK)]
        ).reshape(shape)
        if not np.isfinite(values).all():
            raise AssetError("The network returns values that are not finite.", advice="Train it again.")
        network.check_values(values)
        verts, faces = isosurface(values, low, np.full(3, spacing))
        self.reference = _reference(
            verts, faces, self, base_faces, "The network has no closed surface within its bounds."
        )

    def _forward(self, points: Tensor) -> Tensor:
        x = points
        for i, (weight, bias) in enumerate(self._layers):
            x = functional.linear(x, weight, bias)
            if i + 1 < len(self._layers):
                name = self._activation
                x = (self._omega * x).sin() if name == "sine" else getattr(functional, name)(x)
        return x[:, 0]

    def _value(self, points: Tensor) -> tuple[Tensor, Tensor]:
        with torch.enable_grad():
            at = points.detach().requires_grad_()
            value = self._forward(at)
            (gradient,) = torch.autograd.grad(value.sum(), at)
        return value.detach(), gradient


def _reference(verts: _Floats, faces: _Index, surface: SourceSurface, base_faces: int, otherwise: str) -> CleanMesh:
    """Return the extracted mesh with its vertices moved to the surface, without tiny parts."""
    if len(faces) < 4:
        raise AssetError(otherwise, advice="Check the sign and the bounds.")
    verts, faces = _largest(verts, faces)
    # Each handle takes two from V - F / 2, and needs four faces of a base.
    handles = 1 + len(faces) // 4 - len(np.unique(faces)) // 2
    if 4 * handles - 1 > base_faces:
        raise AssetError(
            f"The surface has about {handles} handles, which need a base of {4 * handles} faces or more; "
            f"params.base_faces is {base_faces}.",
            advice=f"Set it higher (the limit is {MAX_BASE_FACES}), or smooth the values of a grid or network, and "
            "check the normals of points.",
        )
    cleaned = clean(verts, faces)
    moved, _ = surface.project(cleaned.verts, np.zeros_like(cleaned.verts))
    return replace(cleaned, verts=moved)


def _largest(verts: _Floats, faces: _Index) -> tuple[_Floats, _Index]:
    """Return the parts that have at least a hundredth of the faces; others are noise."""
    label = connected_components(faces, len(verts))[faces[:, 0]]
    return verts, faces[(np.bincount(label) >= 0.01 * len(faces))[label]]
