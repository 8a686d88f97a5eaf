"""Place a target mesh on its source before the first step: up stays up, the turn is searched, moments give the rest.

Centre and scale are those at which both surfaces have the same centre of mass and the same spread about it (the square
root of the sum of the second moments). Faces farther from the centre than four times the median distance are left out,
since they are floaters. Each turn about +Y is graded by the distances of samples to the nearest ones of the other
surface, with their normals, in both directions; the farthest fifth does not count, since it may have no counterpart. 24
turns are tried, then finer ones around the best. A turn must be better than none by 3 %, so bodies of revolution
stay as they are.

Source: Rusinkiewicz and Levoy 2001, Efficient Variants of the ICP Algorithm (normals, rejection of the worst pairs).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from meshdeform.errors import AlignmentError
from meshdeform.geometry.mesh import RestMesh, TriangleMesh
from meshdeform.geometry.surface_samples import even_samples
from meshdeform.guidance.landmarks import LIMITS, Landmark, diagonal_of

LEAST_OVERLAP = 0.2
"""Share of either surface that must be near the other one."""

_FAR = 4.0
_ROUNDS = 5
_SAMPLES = 2000
_TURNS = 24
_HALVINGS = 6
_KEPT = 0.8
_NORMALS = 0.1
"""Distance, as a share of the diagonal, that counts as much as normals a unit apart."""
_GAIN = 0.03
_Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Alignment:
    """A map from the target's frame into that of the source, ``matrix @ (x, y, z, 1)``."""

    matrix: _Floats  # (4, 4) float64
    turn_deg: float | None  # turn about +Y, if it was searched
    overlap: float  # least of the shares of the two surfaces that are within 10 % of the target's diagonal of the other

    def place(self, points: _Floats) -> _Floats:
        """Return points (P, 3) of the target in the frame of the source."""
        return np.asarray(points @ self.matrix[:3, :3].T + self.matrix[:3, 3])

    def place_mesh(self, mesh: TriangleMesh) -> TriangleMesh:
        """Return the target in the frame of the source."""
        return TriangleMesh(self.place(mesh.verts), mesh.faces)

    def to_dict(self) -> dict[str, Any]:
        """Return the alignment for the report; the matrix as rows."""
        return {"matrix": self.matrix.tolist(), "turn_deg": self.turn_deg, "overlap": self.overlap}


def aligned(target: TriangleMesh, source: TriangleMesh, landmarks: Sequence[Landmark] = ()) -> Alignment:
    """Return the alignment of a target in any unit, place and turn about +Y.

    Parameters
    ----------
    landmarks : sequence of Landmark
        Their sources in the frame of the source and their targets in that of the target; turns that bring them together
        get a better grade.
    """
    goal, rest = RestMesh.of(target), RestMesh.of(source)
    centre, spread = _moments(goal)
    wanted_centre, wanted_spread = _moments(rest)
    scale = wanted_spread / spread
    sides = _Sides(goal, rest, centre, scale, wanted_centre)
    sources = np.array([each.source for each in landmarks]).reshape(-1, 3)
    goals = np.array([each.target for each in landmarks]).reshape(-1, 3)

    def grade(turn: float) -> float:
        matrix = _matrix(turn, scale, centre, wanted_centre)
        apart = np.linalg.norm(goals @ matrix[:3, :3].T + matrix[:3, 3] - sources, axis=1)
        return sides.grade(turn) + (float(apart.mean()) / sides.diagonal if len(apart) else 0.0)

    turn = _best_turn(grade)
    matrix = _matrix(turn, scale, centre, wanted_centre)
    return Alignment(matrix, (math.degrees(turn) + 180) % 360 - 180, _overlap(goal, rest, matrix))


def shared_coordinates(target: TriangleMesh, source: TriangleMesh) -> Alignment:
    """Return the alignment of a target that is in the frame of the source already."""
    matrix = np.eye(4)
    return Alignment(matrix, None, _overlap(RestMesh.of(target), RestMesh.of(source), matrix))


def require_overlap(alignment: Alignment, advice: str) -> None:
    """Refuse an alignment in which the surfaces are too far apart to be fitted.

    Raises AlignmentError: the overlap is less than `LEAST_OVERLAP`.
    """
    if alignment.overlap < LEAST_OVERLAP:
        raise AlignmentError(
            f"Only {alignment.overlap:.0%} of one surface is near the other after the alignment; a fit needs "
            f"{LEAST_OVERLAP:.0%}.",
            advice=advice,
            alignment=alignment.to_dict(),
        )


class _Sides:
    """Samples of both surfaces with their normals, centred and scaled as the source."""

    def __init__(self, goal: RestMesh, rest: RestMesh, centre: _Floats, scale: float, target: _Floats) -> None:
        self.diagonal = diagonal_of(rest)
        self._goal = self._samples(goal, centre, scale)
        self._rest = self._samples(rest, target, 1.0)
        self._trees = cKDTree(self._goal), cKDTree(self._rest)

    def _samples(self, mesh: RestMesh, centre: _Floats, scale: float) -> _Floats:
        points, normals = _surface_samples(mesh)
        return np.concatenate([scale * (points - centre) / self.diagonal, _NORMALS * normals], 1)

    def grade(self, turn: float) -> float:
        """Return the mean distance of the nearer samples, both ways, for a turn of the target in radians."""
        rotation = np.kron(np.eye(2), _about_y(turn))
        there = self._trees[1].query(self._goal @ rotation.T)[0]
        back = self._trees[0].query(self._rest @ rotation)[0]
        return sum(float(np.sort(each)[: int(_KEPT * len(each))].mean()) for each in (there, back)) / 2


def _best_turn(grade: Callable[[float], float]) -> float:
    step = 2 * math.pi / _TURNS
    best, least = 0.0, grade(0.0) * (1 - _GAIN)
    for number in range(1, _TURNS):
        if (error := grade(number * step)) < least:
            best, least = number * step, error
    for _ in range(_HALVINGS):
        step /= 2
        for turn in (best - step, best + step):
            if (error := grade(turn)) < least:
                best, least = turn, error
    return best


def _moments(mesh: RestMesh) -> tuple[_Floats, float]:
    """Return the centre of mass (3,) and the root of the sum of the second moments, without faces that are far away."""
    corners, areas = mesh.verts[mesh.faces], mesh.areas
    middles = corners.mean(1)
    kept = areas > 0
    for _ in range(_ROUNDS):
        centre = (areas[kept, None] * middles[kept]).sum(0) / areas[kept].sum()
        distances = np.linalg.norm(middles - centre, axis=1)
        order = np.argsort(distances, kind="stable")
        half = np.searchsorted(np.cumsum(areas[order]), areas.sum() / 2)
        near = (areas > 0) & (distances <= _FAR * distances[order[half]])
        if not near.any() or np.array_equal(near, kept):
            break
        kept = near
    shares = areas[kept] / areas[kept].sum()
    centre = (shares[:, None] * middles[kept]).sum(0)
    arms = corners[kept] - centre
    squared = ((arms**2).sum((1, 2)) + (arms.sum(1) ** 2).sum(1)) / 12  # exact for a triangle
    return centre, math.sqrt(float((shares * squared).sum()))


def _surface_samples(mesh: RestMesh) -> tuple[_Floats, _Floats]:
    face, weights = even_samples(mesh.areas, _SAMPLES, 0)
    return (mesh.verts[mesh.faces[face]] * weights[:, :, None]).sum(1), mesh.normals[face]


def _overlap(goal: RestMesh, rest: RestMesh, matrix: _Floats) -> float:
    ours, theirs = _surface_samples(rest)[0], _surface_samples(goal)[0] @ matrix[:3, :3].T + matrix[:3, 3]
    corners = goal.verts[np.unique(goal.faces)] @ matrix[:3, :3].T
    near = LIMITS[0] * float(np.linalg.norm(np.ptp(corners, axis=0)))
    shares = (cKDTree(a).query(b)[0] <= near for a, b in ((ours, theirs), (theirs, ours)))
    return min(float(share.mean()) for share in shares)


def _matrix(turn: float, scale: float, centre: _Floats, target: _Floats) -> _Floats:
    matrix = np.eye(4)
    matrix[:3, :3] = scale * _about_y(turn)
    matrix[:3, 3] = target - matrix[:3, :3] @ centre
    return matrix


def _about_y(turn: float) -> _Floats:
    c, s = math.cos(turn), math.sin(turn)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
