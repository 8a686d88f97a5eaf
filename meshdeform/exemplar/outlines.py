"""Pull the outline of a surface, as it is seen from given directions, to the outlines of silhouettes.

Every round, points spread over the surface are seen from each direction: what they cover, and the border of that. A
piece of the border belongs to the outermost of the points near to it. Points c of the silhouette's contour, with their
outward normals m, and these points, seen at p, are paired both ways by (point / D, 0.1 normal); a pair adds

    w [ (m . (p' - c))^2 + 0.1 (m_t . (p' - c))^2 + 0.1 z^2 ],   w = 1 / sqrt(1 + (2 |p - c| / l)^2),

with m_t along the contour and z the round's step in depth, of which an outline tells nothing,
to the least squares of the smooth fit (`smooth_fit`) if its normals have a product above 0.2 and it is shorter than l,
which falls from 0.5 to 0.1 of the diagonal D. p' is linear in the surface's displacement in the plane of the picture.
Before the pairing a contour is moved so that the silhouette and what the surface covers have the same centre of area,
as a picture does not tell where things are; its size is that of all pictures together (`geometry.pictures`), with which
they spread on average as the surface at rest does.

Sources: Cashman and Fitzgibbon 2013, What shape are dolphins? Building 3D morphable models from 2D images (contour
generators that are sought anew); Liu et al. 2019, Soft Rasterizer (silhouettes that are to agree).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from meshdeform.exemplar.smooth_fit import CodedSurface, PullRows, in_ratio, smooth_fit
from meshdeform.geometry.pictures import SilhouetteView, mask_centre, mask_radius, mask_spread, picture_scales
from meshdeform.nouns.labels import Flags, Floats, Index
from meshdeform.reading.samples import spread

__all__ = ["Outline", "Outlines", "contour_of", "outlined", "outlines_of"]

_SAMPLES, _VERTS = 9_000, 4_000
_SIDE, _MARGIN = 96, 1.25
_POINTS = 400
"""Most points of a contour."""
_LIMITS = (0.5, 0.1)
_NORMAL, _COSINE, _ALONG = 0.1, 0.2, 0.1
_WEIGHT = 3.0
"""Of all outlines together; the pairs with a goal weigh about as much."""
_CANDIDATES = 8
_TINY = 1e-12


@dataclass(frozen=True)
class Outline:
    """A contour seen from a direction, in the frame of the surface that is fitted.

    `right`, `up` (3,): unit directions in the picture. `points` (N, 2): its contour, rightward and upward in the unit
    of the frame, from its centre of area; `normals` (N, 2): outward. `distance`: of the camera from the origin, at
    which it looks.
    """

    right: Floats
    up: Floats
    points: Floats
    normals: Floats
    distance: float

    def seen_at(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return where in the picture points (P, 3) are seen, (P, 2), and how much larger than at the origin, (P,)."""
        flat = np.column_stack([positions @ self.right, positions @ self.up])
        depth = positions @ np.cross(self.right, self.up)
        larger = self.distance / np.maximum(self.distance - depth, 0.1 * self.distance)
        return flat * larger[:, None], larger


def outlines_of(views: Sequence[SilhouetteView], verts: Floats, faces: Index, turn: Floats) -> list[Outline]:
    """Return the outlines of masks in the frame of a surface, as large as the surface is.

    Parameters
    ----------
    views : sequence of SilhouetteView
        Masks, and directions in the coordinates of the asset.
    verts, faces : arrays (V, 3) float64 and (F, 3) int64
        The surface at rest, about the origin of the frame.
    turn : array (3, 3) float64
        The rotation from the coordinates of the asset to the frame.

    Raises
    ------
    SilhouetteError
        The pictures contradict their directions.
    """
    scales = picture_scales(views)
    positions = spread(verts, faces, _SAMPLES, 0).positions
    reach = float(np.linalg.norm(verts[np.unique(faces)], axis=1).max())
    empty = np.zeros((0, 2))
    sizes = []
    for view, scale in zip(views, scales, strict=True):
        own = Outline(turn @ view.right, turn @ view.up, empty, empty, _distance(view, reach))
        covered = _Covered(own.seen_at(positions)[0])
        sizes.append(mask_spread(covered.mask) * covered.pixel / (mask_spread(view.mask) * scale))
    size = math.exp(float(np.mean(np.log(sizes))))
    found = []
    for view, scale in zip(views, scales * size, strict=True):
        points, normals = contour_of(view.mask)
        row, column = mask_centre(view.mask)
        points = (points - [column, -row]) * scale
        distance = _distance(view, max(reach, mask_radius(view.mask) * scale))
        found.append(Outline(turn @ view.right, turn @ view.up, points, normals, distance))
    return found


def outlined(verts: Floats, faces: Index, outlines: Sequence[Outline], *, planes: Collection[int] = ()) -> Floats:
    """Return the vertices (V, 3) of a surface that takes on outlines, and is else bent and stretched little.

    `planes`: as of `smooth_fit`.
    """
    surface, pulls = CodedSurface.alike(verts, faces), [Outlines(verts, faces, outlines)]
    return smooth_fit(surface, CodedSurface.empty(), planes=planes, pulls=pulls)


def _distance(view: SilhouetteView, reach: float) -> float:
    """Return how far away the camera of a view is that sees all within a reach."""
    return _MARGIN * reach / math.sin(math.radians(view.fov_deg) / 2)


def contour_of(mask: Flags) -> tuple[Floats, Floats]:
    """Return points (N, 2) on the contour of a mask (H, W), and outward unit normals (N, 2).

    Both rightward and upward, in pixels from the upper left corner, at most 400; between two pixels where the mask,
    smoothed, passes one half.
    """
    soft = ndimage.gaussian_filter(np.pad(mask, 3).astype(float), 1.0)
    down, across = np.gradient(soft)
    points, normals = [], []
    for axis in range(2):
        one = soft[:-1] if axis == 0 else soft[:, :-1]
        two = soft[1:] if axis == 0 else soft[:, 1:]
        rows, columns = np.nonzero((one > 0.5) != (two > 0.5))
        share = (0.5 - one[rows, columns]) / (two[rows, columns] - one[rows, columns])
        at = np.column_stack([rows, columns]).astype(float)
        at[:, axis] += share
        points.append(np.column_stack([at[:, 1] - 2.5, 2.5 - at[:, 0]]))
        slope = [ndimage.map_coordinates(each, at.T, order=1) for each in (across, down)]
        normals.append(np.column_stack([-slope[0], slope[1]]))
    point, normal = np.concatenate(points), np.concatenate(normals)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), _TINY)
    chosen = np.random.default_rng(0).permutation(len(point))[:_POINTS]
    return point[chosen], normal[chosen]


class _Covered:
    """What points (P, 2) seen in a picture cover: a mask (H, W), the size of its pixels, and its corner."""

    def __init__(self, seen: Floats) -> None:
        low, high = seen.min(0), seen.max(0)
        self.pixel = max(float((high - low).max()), _TINY) / _SIDE
        self.corner = np.array([low[0] - 2 * self.pixel, high[1] + 2 * self.pixel])
        columns = np.floor((seen[:, 0] - self.corner[0]) / self.pixel).astype(np.int64)
        rows = np.floor((self.corner[1] - seen[:, 1]) / self.pixel).astype(np.int64)
        self.mask = np.zeros((int(rows.max()) + 3, int(columns.max()) + 3), bool)
        self.mask[rows, columns] = True
        self.mask = ndimage.binary_closing(self.mask, np.ones((3, 3), bool))

    @property
    def centre(self) -> Floats:
        """The centre of area, where the points are."""
        row, column = mask_centre(self.mask)
        return self.corner + self.pixel * np.array([column, -row])

    def border(self) -> tuple[Floats, Floats]:
        """Return points (N, 2) of the border and their outward normals (N, 2)."""
        points, normals = contour_of(self.mask)
        return self.corner + self.pixel * points, normals


class Outlines:
    """Outlines as pulls of a smooth fit.

    `verts` (V, 3) and `faces` (F, 3): the surface that is fitted, as it is before.
    """

    def __init__(self, verts: Floats, faces: Index, outlines: Sequence[Outline]) -> None:
        self._outlines = list(outlines)
        used = np.unique(faces)
        some = used[:: max(1, math.ceil(len(used) / _VERTS))]
        self._positions = np.concatenate([verts[some], spread(verts, faces, _SAMPLES, 0).positions])
        self._diagonal = float(np.linalg.norm(np.ptp(verts[used], axis=0)))

    def rows(self, moved: Callable[[Floats], Floats], share: float) -> PullRows:
        """Return the rows of the linear least squares by which all outlines pull in a round."""
        now = moved(self._positions)
        limit = in_ratio(_LIMITS, share) * self._diagonal
        found = [self._pulled(outline, now, limit) for outline in self._outlines]
        return PullRows(*(np.concatenate(each) for each in zip(*found, strict=True)))

    def _pulled(self, outline: Outline, now: Floats, limit: float) -> PullRows:
        """Return the rows by which one outline pulls."""
        seen, larger = outline.seen_at(now)
        covered = _Covered(seen)
        rim, outward = self._rim(seen, covered)
        goal = outline.points + covered.centre
        own = np.hstack([seen[rim] / self._diagonal, _NORMAL * outward])
        other = np.hstack([goal / self._diagonal, _NORMAL * outline.normals])
        there, back = cKDTree(other).query(own)[1], cKDTree(own).query(other)[1]
        source = np.concatenate([np.arange(len(rim)), back])
        target = np.concatenate([there, np.arange(len(goal))])
        apart = goal[target] - seen[rim[source]]
        length = np.linalg.norm(apart, axis=1)
        alike = ((outward[source] * outline.normals[target]).sum(1) > _COSINE) & (length < limit)
        weight = alike / np.sqrt(1 + (2 * length / limit) ** 2)
        weight *= _WEIGHT / len(self._outlines) / np.repeat([2 * len(rim), 2 * len(goal)], [len(rim), len(goal)])
        apart /= larger[rim[source], None]
        normal = outline.normals[target]
        along = np.column_stack([-normal[:, 1], normal[:, 0]])
        both = np.concatenate([normal, along])
        toward = np.broadcast_to(np.cross(outline.right, outline.up), (len(source), 3))
        return PullRows(
            np.tile(self._positions[rim[source]], (3, 1)),
            np.concatenate([both @ np.stack([outline.right, outline.up]), toward]),
            np.concatenate([(both * np.tile(apart, (2, 1))).sum(1), np.zeros(len(source))]),
            np.concatenate([weight, _ALONG * weight, _ALONG * weight]),
        )

    @staticmethod
    def _rim(seen: Floats, covered: _Covered) -> tuple[Index, Floats]:
        """Return the outermost points near the border, and the border's outward normals there."""
        border, outward = covered.border()
        near = cKDTree(seen).query(border, k=_CANDIDATES)[1]
        offset = seen[near] - border[:, None]
        height = (offset * outward[:, None]).sum(2)
        beside = np.abs((offset * np.column_stack([-outward[:, 1], outward[:, 0]])[:, None]).sum(2))
        return np.take_along_axis(near, (height - beside).argmax(1)[:, None], 1)[:, 0], outward
