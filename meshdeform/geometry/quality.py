"""Measure the quality of a deformed mesh relative to its rest state, for the report and the benchmarks.

The texture's stretch: of the map from the texture to a triangle, affine with the partial derivatives S_u and S_v, the
larger singular value is the length to which the texture is drawn out in its worst direction (the L-infinity stretch of
Sander et al.)::

    a = S_u . S_u,  b = S_u . S_v,  c = S_v . S_v
    Gamma = sqrt((a + c + sqrt((a - c)^2 + 4 b^2)) / 2)
    stretch = (Gamma' / Gamma) / s,     s = sqrt(area' / area) of the whole textured surface

with a prime for the result. Division by the mean growth `s` makes it free of scale, as theirs is: a similarity of the
whole surface has 1, and a point where texels became twice as long as `s` explains has 2. Where they became shorter, it
is below 1. Lengths in the texture are in texels. Triangles without a texture, or without an area in it, do not count.

Sources: symmetric Dirichlet energy: Smith and Schaefer 2015, Bijective Parameterization with Free Boundaries, eq. 2,
here ``(s1^2 + s2^2 + s1^-2 + s2^-2) / 4`` of the singular values of each face's map, after removing the mean area
scale, so that a similarity has the value 1. Stretch: Sander et al. 2001, Texture Mapping Progressive Meshes, section 3.

`StructureChanges` has what a person would see at once, and no judge does. Its figures compare the result with the
source, are shares of the diagonal of the shape in question unless said otherwise, and are 0 for a result that is its
source, or that is its source scaled, moved, or stretched along an axis.

::

    asymmetry   mean_p |R x'(p) - x'(q)|     p, q: points of the source that are mirror images; R: the reflection
    flatness    rms distance of a flat piece from its best plane, over the diagonal of the piece; the mean by area
    contacts    mean distance of points on different components that touched at rest

A source counts as symmetric if four fifths of its surface have a mirror image within `_MATCHED`; of two such
planes that match equally, the better kept one counts.

`FitQuality` compares a mesh with a target: distances between samples of each and the nearest points of the other.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from meshdeform.geometry import COLLAPSED_SHAPE
from meshdeform.geometry.appearance import Appearance
from meshdeform.geometry.folds import FaceNeighbours, longest_squared, without_rounding
from meshdeform.geometry.intersections import TooManyPairsError, intersecting_faces, newly_cutting_pairs
from meshdeform.geometry.junctions import opened
from meshdeform.geometry.mesh import RestMesh, TriangleMesh, face_cross
from meshdeform.geometry.nearest_points import NearestPoints, SurfaceTree
from meshdeform.geometry.surface_samples import even_samples

_Floats = NDArray[np.float64]
_Faces = NDArray[np.int64]
_COLLAPSED_SHARE = 1e-6

_RESIZED = 1.5
"""Factor by which lengths in a face may differ from the overall scale before the face counts as reshaped. Furniture and
vehicles of one kind differ by about as much; twice is seen at once, also in a texture."""

_SAMPLES = 20_000
_MATCHED = 0.006
_SYMMETRIC_SHARE = 0.8

_AS_GOOD = 0.02
"""By how much less of the surface may match at a plane that is as good as the best one."""

_FLAT_COSINE = float(np.cos(np.radians(1.0)))

_FLAT_SHARE = 0.005
"""Share of the area from which a flat piece counts."""

_FLAT_RMS = 0.002
_CONTACT = 0.01
_PARTNERS = 8

_CORNERS = 100_000
"""Vertices at which contacts are sought beside the random points; twice as many are still all taken."""

_FIT_SAMPLES = 20_000
_NEAR = 0.01
_SPACING = 0.01
_STRONG = 2.0
_FLAT = 1e-9
"""Area in the texture, in texels, below which a triangle shows one colour."""


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
    area_old, area_new = _areas(rest_verts[faces]), _areas(verts[faces])
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


@dataclass(frozen=True)
class TextureStretch:
    """Stretch of a result's texture; percentiles and shares are of the result's measured area."""

    # Percentiles of the stretch
    p50: float
    p95: float
    above_2: float  # share with a stretch above 2
    scale: float  # s: how much longer the measured surface became on average
    measured: float  # share of the source's area that has a texture and was measured

    def to_dict(self) -> dict[str, float]:
        """Return the values by name, rounded."""
        return {name: round(value, 4) for name, value in asdict(self).items()}


def texel_corners(appearance: Appearance) -> _Floats:
    """Return the corners (T, 3, 2) of all triangles in their texture, in texels; NaN where there is none."""
    sizes = np.array(
        [(np.nan, np.nan) if p.texture is None else p.texture.pixels.shape[1::-1] for p in appearance.paints], float
    )
    corners: _Floats = appearance.texcoords[appearance.triangles] * sizes[appearance.paint_of_triangle][:, None]
    return corners


def face_stretch(texels: _Floats, before: _Floats, after: _Floats) -> tuple[_Floats, float]:
    """Return the stretch (T,) of triangles, NaN where it is not defined, and s.

    `texels`, (T, 3, 2): corners in the texture; NaN for triangles without one. `before` and `after`, (T, 3, 3): corners
    on the source and on the result.
    """
    old, new = _largest(texels, before), _largest(texels, after)
    valid = (old > 0) & np.isfinite(old) & np.isfinite(new)
    if not valid.any():
        return np.full(len(texels), np.nan), 1.0
    scale = float(np.sqrt(_areas(after)[valid].sum() / _areas(before)[valid].sum()))
    stretch = np.full(len(texels), np.nan)
    np.divide(new, old * max(scale, 1e-300), out=stretch, where=valid)
    return stretch, scale


def measure_texture_stretch(texels: _Floats, before: _Floats, after: _Floats) -> TextureStretch | None:
    """Measure the stretch; None if no triangle has a texture. The parameters are those of `face_stretch`."""
    values, scale = face_stretch(texels, before, after)
    valid = np.isfinite(values)
    old, new = _areas(before), _areas(after)
    if not valid.any() or new[valid].sum() <= 0:
        return None
    order = np.argsort(values[valid], kind="stable")
    sorted_values, weights = values[valid][order], new[valid][order]
    share = np.cumsum(weights) / weights.sum()
    p50, p95 = (float(sorted_values[np.searchsorted(share, q - 1e-12)]) for q in (0.5, 0.95))
    above = float(weights[sorted_values > _STRONG].sum() / weights.sum())
    return TextureStretch(p50, p95, above, scale, float(old[valid].sum() / old.sum()))


def _largest(texels: _Floats, points: _Floats) -> _Floats:
    """Return Gamma (T,), NaN without an area in the texture."""
    (u1, v1), (u2, v2) = (np.moveaxis(texels[:, k] - texels[:, 0], 1, 0) for k in (1, 2))
    first, second = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    double_area = u1 * v2 - u2 * v1
    divisor = np.where(np.abs(double_area) > 2 * _FLAT, double_area, np.nan)[:, None]
    along_u = (first * v2[:, None] - second * v1[:, None]) / divisor
    along_v = (second * u1[:, None] - first * u2[:, None]) / divisor
    a, b, c = (along_u**2).sum(1), (along_u * along_v).sum(1), (along_v**2).sum(1)
    largest: _Floats = np.sqrt((a + c + np.sqrt((a - c) ** 2 + 4 * b**2)) / 2)
    return largest


def _areas(points: _Floats) -> _Floats:
    """Return the area (T,) of triangles with these corners (T, 3, 3)."""
    areas: _Floats = np.linalg.norm(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), axis=1) / 2
    return areas


@dataclass(frozen=True)
class StructureChanges:
    """Changes of mirror symmetry, flat pieces and contacts."""

    asymmetry: float | None  # added; None if the source is not symmetric
    flatness: float | None  # lost; None if the source has no flat piece
    contacts: float | None  # growth of the mean gap; None if no components touch
    components: int

    def to_dict(self) -> dict[str, float | int | None]:
        """Return the figures by name."""
        return asdict(self)


@dataclass(frozen=True)
class _RandomPoints:
    """Random points on the source, uniform by area: their faces' corners (P, 3) and barycentric coordinates (P, 3)."""

    corners: NDArray[np.int64]
    weights: _Floats

    @classmethod
    def draw(cls, rest: RestMesh) -> _RandomPoints:
        rng = np.random.default_rng(0)
        share = np.cumsum(rest.areas)
        face = np.searchsorted(share, rng.random(_SAMPLES) * share[-1], side="right").clip(max=len(share) - 1)
        root, second = np.sqrt(rng.random(_SAMPLES)), rng.random(_SAMPLES)
        return cls(rest.faces[face], np.stack([1 - root, root * (1 - second), root * second], 1))

    def on(self, verts: _Floats) -> _Floats:
        return np.asarray((self.weights[..., None] * verts[self.corners]).sum(1))


def measure_structure(source: TriangleMesh, result: TriangleMesh) -> StructureChanges:
    """Compare a result with its source, a mesh of the same faces whose up axis is +Y."""
    rest, before, after = RestMesh.of(source), source.verts, result.verts
    drawn = _RandomPoints.draw(rest)
    components = rest.components
    return StructureChanges(
        _asymmetry(rest, drawn, after),
        _flatness(rest, after),
        _contacts(drawn, components, before, after),
        int(rest.num_components),
    )


def _diagonal(verts: _Floats) -> float:
    return float(np.linalg.norm(np.ptp(verts, axis=0)))


def _asymmetry(rest: RestMesh, drawn: _RandomPoints, after: _Floats) -> float | None:
    before = rest.verts
    points = drawn.on(before)
    asymmetry: dict[float, float] = {}
    axes = (0, 2)
    for axis, (mirrored, partners) in zip(axes, NearestPoints.of_mirrored(rest, points, axes), strict=True):
        matched = partners.distances(mirrored) < _MATCHED * _diagonal(before)
        if (share := float(matched.mean())) >= _SYMMETRIC_SHARE:
            old, new = (_mirror_error(drawn.on(v), partners.blend(v), matched, axis, v) for v in (before, after))
            asymmetry[share] = min(max(0.0, new - old), asymmetry.get(share, np.inf))
    # A cart is nearly its own mirror image from front to back: that is not the symmetry to keep.
    return min((error for share, error in asymmetry.items() if share >= max(asymmetry) - _AS_GOOD), default=None)


def _mirror_error(points: _Floats, partners: _Floats, matched: NDArray[np.bool_], axis: int, verts: _Floats) -> float:
    points, partners = points[matched].copy(), partners[matched]
    middle = np.median(points[:, axis] + partners[:, axis]) / 2
    points[:, axis] = 2 * middle - points[:, axis]
    return float(np.linalg.norm(points - partners, axis=1).mean()) / _diagonal(verts)


def _flatness(rest: RestMesh, after: _Floats) -> float | None:
    before, faces, areas = rest.verts, rest.faces, rest.areas
    pairs = sparse.coo_matrix(rest.edge_adjacency)
    normals = rest.normals
    level = (normals[pairs.row] * normals[pairs.col]).sum(1) > _FLAT_COSINE
    joined = sparse.coo_matrix((np.ones(level.sum()), (pairs.row[level], pairs.col[level])), shape=pairs.shape)
    count, piece = connected_components(joined, directed=False)
    area = np.bincount(piece, areas, count)
    lost, weights = [], []
    for number in np.flatnonzero((area >= _FLAT_SHARE * areas.sum()) & (np.bincount(piece, minlength=count) > 1)):
        corners = np.unique(faces[piece == number])
        # The faces of a finely divided sphere hardly bend from one to the next: it is not flat.
        if (old := _unevenness(before[corners])) < _FLAT_RMS:
            lost.append(max(0.0, _unevenness(after[corners]) - old))
            weights.append(area[number])
    return float(np.average(lost, weights=weights)) if lost else None


def _unevenness(points: _Floats) -> float:
    """Return the rms distance of points from their best plane, over their diagonal."""
    centred = points - points.mean(0)
    smallest = np.linalg.svd(centred, compute_uv=False)[-1] if len(points) > 3 else 0.0
    return float(smallest / np.sqrt(len(points)) / max(_diagonal(points), 1e-300))


def _contacts(drawn: _RandomPoints, components: NDArray[np.int64], before: _Floats, after: _Floats) -> float | None:
    if not components.any():
        return None
    corners = np.arange(0, len(before), max(1, len(before) // _CORNERS))
    owner = np.concatenate([components[drawn.corners[:, 0]], components[corners]])
    old, new = (np.concatenate([drawn.on(v), v[corners]]) for v in (before, after))
    near, index = cKDTree(old).query(old, k=_PARTNERS, distance_upper_bound=_CONTACT * _diagonal(before))
    first = np.repeat(np.arange(len(old)), _PARTNERS)
    second, valid = index.ravel(), np.isfinite(near.ravel())
    first, second = first[valid], second[valid]
    apart = owner[first] != owner[second]
    first, second = first[apart], second[apart]
    if not len(first):
        return None
    gaps = [np.linalg.norm(p[first] - p[second], axis=1).mean() / _diagonal(p) for p in (old, new)]
    return max(0.0, float(gaps[1] - gaps[0]))


@dataclass(frozen=True)
class FitQuality:
    """Distances between a mesh and its target, as shares of the diagonal of the target's bounding box."""

    within: float  # share of the target's surface that is within 1 % of the mesh
    # Mean distance from the mesh to the target, and from the target to the mesh
    to_target: float
    from_target: float

    def to_dict(self) -> dict[str, float]:
        """Return the figures by name."""
        return asdict(self)


def measure_fit(mesh: TriangleMesh, target: TriangleMesh) -> FitQuality:
    """Compare a mesh with a target in the same frame."""
    there, back = distances_between(mesh, target), distances_between(target, mesh)
    corners = target.verts[np.unique(target.faces)]
    diagonal = float(np.linalg.norm(np.ptp(corners, axis=0)))
    return FitQuality(
        float((back <= _NEAR * diagonal).mean()), float(there.mean()) / diagonal, float(back.mean()) / diagonal
    )


def distances_between(mesh: TriangleMesh, other: TriangleMesh) -> _Floats:
    """Return the distances of 20,000 samples that lie evenly on a mesh from the surface of another one."""
    rest, goal = RestMesh.of(mesh), RestMesh.of(other)
    face, shares = even_samples(rest.areas, _FIT_SAMPLES, 0)
    points = (rest.verts[rest.faces[face]] * shares[:, :, None]).sum(1)
    verts, faces = goal.verts, goal.faces
    spacing = _SPACING * float(np.linalg.norm(np.ptp(verts[np.unique(faces)], axis=0)))
    tree = SurfaceTree(verts, faces, goal.normals, spacing=spacing, opposite=0.0)
    nearest, weights = tree.find(points, np.zeros_like(points))
    return np.asarray(np.linalg.norm((verts[faces[nearest]] * weights[:, :, None]).sum(1) - points, axis=1))
