"""Measure the quality of a deformed mesh relative to its rest state, for the report and the benchmarks.

Source: Smith and Schaefer 2015, Bijective Parameterization with Free Boundaries, eq. 2: the symmetric Dirichlet energy,
here ``(s1^2 + s2^2 + s1^-2 + s2^-2) / 4`` of the singular values of each face's map, after removing the mean area
scale, so that a similarity has the value 1.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.folds import FaceNeighbours, longest_squared, without_rounding
from meshdeform.geometry.intersections import TooManyPairsError, intersecting_faces, newly_cutting_pairs
from meshdeform.geometry.junctions import opened
from meshdeform.geometry.mesh import face_areas, face_cross

_Floats = NDArray[np.float64]
_Faces = NDArray[np.int64]
_COLLAPSED_SHARE = 1e-6

_RESIZED = 1.5
"""Factor by which lengths in a face may differ from the overall scale before the face counts as reshaped. Furniture and
vehicles of one kind differ by about as much; twice is seen at once, also in a texture."""


@dataclass(frozen=True)
class MeshQuality:
    """Quality of a deformed mesh."""

    flipped_faces: int  # faces that now point against their edge neighbours (a fold) and clearly did not at rest
    collapsed_faces: int
    """Faces that lost their area: below a millionth of what the uniform scale would give, or reduced to a line."""
    # The first percentile of the faces' smallest angles, in degrees
    min_angle_p1_deg_before: float
    min_angle_p1_deg_after: float
    # Area-weighted mean and 99th percentile; a similarity has 1
    symmetric_dirichlet_mean: float
    symmetric_dirichlet_p99: float
    self_intersecting_faces_before: int | None
    self_intersecting_faces_after: int | None
    self_intersections_added: int | None
    """Faces that cut a face which they neither cut nor touched at rest. Faces that touch without cutting cut each
    other, by rounding, as soon as they are turned. All three are None if there are too many pairs to search."""
    opened_junctions: int | None
    """Vertices on edges of other faces that came off them (`junctions.py`); None if there are too many pairs."""
    volume_ratio: float  # signed volume after over before; 0 if the rest mesh encloses none
    area_ratio: float  # total area after over before
    area_ratio_spread: float  # standard deviation of the logarithm of the faces' area ratios
    kept_share: float
    """Share of the area at rest that kept its shape: of faces in which no length changed by more than a factor of 1.5
    beyond one scale for all, the geometric mean by area."""

    def to_dict(self) -> dict[str, float | None]:
        """Return the figures by name."""
        return asdict(self)

    def warnings(self, faces: int) -> list[str]:
        """Return sentences for the user about damaged faces, and about self-intersections that were not counted.

        Parameters
        ----------
        faces : int
            Number of faces of the mesh.
        """
        damage = {
            "flipped": self.flipped_faces,
            "newly cutting others": self.self_intersections_added,
            "without area": self.collapsed_faces,
        }
        counts = [f"{count:,} {words}" for words, count in damage.items() if count]
        sentences = [f"Damaged faces, of {faces:,}: {', '.join(counts)}."] if counts else []
        if self.opened_junctions:
            what = f"{self.opened_junctions:,} of the vertices on edges of other faces came off"
            sentences.append(f"Cracks opened: {what}.")
        if self.self_intersecting_faces_after is None:
            sentences.append(
                "The self-intersections were not counted, because too many faces lie on or in each other. Remove "
                "copies that are in one place."
            )
        return sentences


def measure(rest_verts: _Floats, faces: _Faces, verts: _Floats) -> MeshQuality:
    """Compare a deformed mesh with its rest state.

    Parameters
    ----------
    rest_verts, verts : (V, 3) float64
        Positions in the same unit.
    faces : (F, 3) int64

    Notes
    -----
    Faces without area at rest count only in the self-intersections. Vertices that moved less than rounding count as
    unmoved, so that a result equal to its source has no flipped face and no added self-intersection.
    """
    diagonal_sq = float((np.ptp(rest_verts, axis=0) ** 2).sum()) if len(rest_verts) else 0.0
    verts = without_rounding(rest_verts, verts)
    area_old, area_new = face_areas(rest_verts, faces), face_areas(verts, faces)
    solid = area_old > COLLAPSED_SHAPE * longest_squared(rest_verts, faces)
    f, a, b = faces[solid], area_old[solid], area_new[solid]
    scale = float(b.sum() / a.sum()) if len(a) else 1.0
    collapsed = (b <= _COLLAPSED_SHARE * scale * a) | (b <= COLLAPSED_SHAPE * longest_squared(verts, f))
    total, product = _squared_stretches(rest_verts, verts, f[~collapsed], scale or 1.0)
    energy = (total + total / product) / 4
    weights = a[~collapsed]
    volume = _volume(rest_verts, faces)
    ratio = np.log(np.maximum(b, 1e-300) / a)[~collapsed]
    folded = FaceNeighbours(f, rest_verts).folded(verts)
    cuts_before, cuts_after, cuts_added = _self_intersections(rest_verts, verts, faces)
    return MeshQuality(
        flipped_faces=int((folded & ~collapsed).sum()),
        collapsed_faces=int(collapsed.sum()),
        min_angle_p1_deg_before=_min_angle_p1(rest_verts, f),
        min_angle_p1_deg_after=_min_angle_p1(verts, f[~collapsed]),
        symmetric_dirichlet_mean=float((energy * weights).sum() / weights.sum()) if len(energy) else 0.0,
        symmetric_dirichlet_p99=float(np.percentile(energy, 99)) if len(energy) else 0.0,
        self_intersecting_faces_before=cuts_before,
        self_intersecting_faces_after=cuts_after,
        self_intersections_added=cuts_added,
        opened_junctions=opened(rest_verts, faces, verts),
        volume_ratio=_volume(verts, faces) / volume if abs(volume) > 1e-12 * diagonal_sq**1.5 else 0.0,
        area_ratio=scale,
        area_ratio_spread=float(ratio.std()) if len(ratio) else 0.0,
        kept_share=_kept_area(total, np.exp(ratio) / scale, weights) / float(a.sum()) if len(energy) else 0.0,
    )


def _self_intersections(rest: _Floats, verts: _Floats, faces: _Faces) -> tuple[int, int, int] | tuple[None, None, None]:
    """Count the faces that cut another before, those after, and the added ones; None if too many pairs meet."""
    try:
        before, after = int(intersecting_faces(rest, faces).sum()), int(intersecting_faces(verts, faces).sum())
        return before, after, len(np.unique(newly_cutting_pairs(rest, verts, faces))) if after else 0
    except TooManyPairsError:
        return None, None, None


def _volume(verts: _Floats, faces: _Faces) -> float:
    origin = verts[faces[:, 0]].mean(0) if len(faces) else np.zeros(3)
    a = verts[faces[:, 0]] - origin
    return float((a * face_cross(verts - origin, faces)).sum() / 6)


def _min_angle_p1(verts: _Floats, faces: _Faces) -> float:
    if not len(faces):
        return 0.0
    p = verts[faces]
    angles = []
    for k in range(3):
        u, v = p[:, (k + 1) % 3] - p[:, k], p[:, (k + 2) % 3] - p[:, k]
        angles.append(np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(1)))
    return float(np.degrees(np.percentile(np.min(angles, axis=0), 1)))


def _squared_stretches(rest: _Floats, verts: _Floats, faces: _Faces, scale: float) -> tuple[_Floats, _Floats]:
    """Return sum and product (F,) of the squared singular values of the faces' maps, without the mean area scale."""

    def metric(points: _Floats) -> tuple[_Floats, _Floats, _Floats]:
        u, v = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
        return (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)

    e, m, g = metric(rest)
    e2, m2, g2 = (entry / scale for entry in metric(verts))
    # They are the trace of I^-1 II and det(II) / det(I), with the first fundamental forms I and II of a face.
    det_old, det_new = e * g - m * m, e2 * g2 - m2 * m2
    return (g * e2 - 2 * m * m2 + e * g2) / det_old, det_new / det_old


def _kept_area(total: _Floats, growth: _Floats, areas: _Floats) -> float:
    """Return the area at rest of the faces that kept their shape."""
    # Their squared singular values have the sums `total` (F,) and the products `growth ** 2` (F,).
    middle = np.exp(np.average(np.log(growth), weights=areas))
    largest = (total + np.sqrt(np.maximum(total**2 - 4 * growth**2, 0.0))) / 2
    kept = (largest <= _RESIZED**2 * middle) & (growth**2 / largest >= middle / _RESIZED**2)
    return float(areas[kept].sum())
