"""Is the mesh still good? Figures of a deformed mesh against its rest state, for the report and the benchmarks.

Sources: symmetric Dirichlet energy: Smith and Schaefer 2015, Bijective Parameterization with Free Boundaries, eq. 2,
here ``(s1^2 + s2^2 + s1^-2 + s2^-2) / 4`` of the singular values of each face's map, after the best uniform scale, so
that 1 is a similarity.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.intersections import intersecting_faces
from meshdeform.operators import COLLAPSED_SHAPE

__all__ = ["MeshQuality", "folded_faces", "measure"]

_Floats = NDArray[np.float64]
_Faces = NDArray[np.int64]
_COLLAPSED_SHARE = 1e-6


@dataclass(frozen=True)
class MeshQuality:
    """What a deformation did to a mesh.

    Attributes
    ----------
    flipped_faces : int
        Faces that point against their edge neighbours now and did not at rest (a fold).
    collapsed_faces : int
        Faces that lost their area: below a millionth of what the uniform scale would give, or a line.
    min_angle_p1_deg_before, min_angle_p1_deg_after : float
        The first percentile of the faces' smallest angles, in degrees.
    symmetric_dirichlet_mean, symmetric_dirichlet_p99 : float
        Area-weighted mean and 99th percentile; 1 is a similarity.
    self_intersecting_faces_before, self_intersecting_faces_after : int
    volume_ratio : float
        Signed volume after over before; NaN-free: 0 where the rest mesh encloses none.
    area_ratio : float
        Total area after over before.
    area_ratio_spread : float
        Standard deviation of the logarithm of the faces' area ratios.
    """

    flipped_faces: int
    collapsed_faces: int
    min_angle_p1_deg_before: float
    min_angle_p1_deg_after: float
    symmetric_dirichlet_mean: float
    symmetric_dirichlet_p99: float
    self_intersecting_faces_before: int
    self_intersecting_faces_after: int
    volume_ratio: float
    area_ratio: float
    area_ratio_spread: float

    def to_dict(self) -> dict[str, float | int]:
        """The figures by name."""
        return asdict(self)


def measure(rest_verts: _Floats, faces: _Faces, verts: _Floats) -> MeshQuality:
    """Compare a deformed mesh with its rest state.

    Parameters
    ----------
    rest_verts, verts : (V, 3) float64
        In the same unit.
    faces : (F, 3) int64

    Notes
    -----
    Faces without area at rest do not count in any figure but the self-intersections.
    """
    diagonal_sq = float((np.ptp(rest_verts, axis=0) ** 2).sum()) if len(rest_verts) else 0.0
    area_old, area_new = _areas(rest_verts, faces), _areas(verts, faces)
    solid = area_old > COLLAPSED_SHAPE * _longest_sq(rest_verts, faces)
    f, a, b = faces[solid], area_old[solid], area_new[solid]
    scale = float(b.sum() / a.sum()) if len(a) else 1.0
    collapsed = (b <= _COLLAPSED_SHARE * scale * a) | (b <= COLLAPSED_SHAPE * _longest_sq(verts, f))
    energy = _symmetric_dirichlet(rest_verts, verts, f[~collapsed], scale or 1.0)
    weights = a[~collapsed]
    volume = _volume(rest_verts, faces)
    ratio = np.log(np.maximum(b, 1e-300) / a)[~collapsed]
    folded_before, folded_after = folded_faces(rest_verts, f), folded_faces(verts, f)
    return MeshQuality(
        flipped_faces=int((folded_after & ~folded_before & ~collapsed).sum()),
        collapsed_faces=int(collapsed.sum()),
        min_angle_p1_deg_before=_min_angle_p1(rest_verts, f),
        min_angle_p1_deg_after=_min_angle_p1(verts, f[~collapsed]),
        symmetric_dirichlet_mean=float((energy * weights).sum() / weights.sum()) if len(energy) else 0.0,
        symmetric_dirichlet_p99=float(np.percentile(energy, 99)) if len(energy) else 0.0,
        self_intersecting_faces_before=int(intersecting_faces(rest_verts, faces).sum()),
        self_intersecting_faces_after=int(intersecting_faces(verts, faces).sum()),
        volume_ratio=_volume(verts, faces) / volume if abs(volume) > 1e-12 * diagonal_sq**1.5 else 0.0,
        area_ratio=scale,
        area_ratio_spread=float(ratio.std()) if len(ratio) else 0.0,
    )


def _cross(verts: _Floats, faces: _Faces) -> _Floats:
    a, b, c = verts[faces[:, 0]], verts[faces[:, 1]], verts[faces[:, 2]]
    return np.cross(b - a, c - a)


def _areas(verts: _Floats, faces: _Faces) -> _Floats:
    return np.asarray(0.5 * np.linalg.norm(_cross(verts, faces), axis=1))


def _longest_sq(verts: _Floats, faces: _Faces) -> _Floats:
    """Squared length (F,) of each face's longest edge."""
    corners = verts[faces]
    return np.asarray(((corners - corners[:, [1, 2, 0]]) ** 2).sum(2).max(1, initial=0.0))


def _volume(verts: _Floats, faces: _Faces) -> float:
    origin = verts[faces[:, 0]].mean(0) if len(faces) else np.zeros(3)
    a = verts[faces[:, 0]] - origin
    return float((a * _cross(verts - origin, faces)).sum() / 6)


def _min_angle_p1(verts: _Floats, faces: _Faces) -> float:
    if not len(faces):
        return 0.0
    p = verts[faces]
    angles = []
    for k in range(3):
        u, v = p[:, (k + 1) % 3] - p[:, k], p[:, (k + 2) % 3] - p[:, k]
        angles.append(np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(1)))
    return float(np.degrees(np.percentile(np.min(angles, axis=0), 1)))


def _symmetric_dirichlet(rest: _Floats, verts: _Floats, faces: _Faces, scale: float) -> _Floats:
    """Energy per face of the map after taking out the mean area scale."""

    def metric(points: _Floats) -> tuple[_Floats, _Floats, _Floats]:
        u, v = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
        return (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)

    e, m, g = metric(rest)
    e2, m2, g2 = (part / scale for part in metric(verts))
    # Of the map's squared singular values: their sum is trace(I^-1 II), their product det(II) / det(I).
    det_old, det_new = e * g - m * m, e2 * g2 - m2 * m2
    total = (g * e2 - 2 * m * m2 + e * g2) / det_old
    product = det_new / det_old
    return np.asarray((total + total / product) / 4)


def folded_faces(verts: _Floats, faces: _Faces) -> NDArray[np.bool_]:
    """Which faces (F,) are folded over: their normals point against the sum of their edge neighbours' area vectors."""
    cross = _cross(verts, faces)
    start, stop = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    key = np.minimum(start, stop) * (int(faces.max(initial=0)) + 1) + np.maximum(start, stop)
    _, inverse = np.unique(key, return_inverse=True)
    owner = np.repeat(np.arange(len(faces)), 3)
    around = np.zeros((int(inverse.max(initial=-1)) + 1, 3))
    np.add.at(around, inverse, cross[owner])
    neighbours = around[inverse].reshape(len(faces), 3, 3).sum(1) - 3 * cross
    return np.asarray((neighbours * cross).sum(1) < 0)
