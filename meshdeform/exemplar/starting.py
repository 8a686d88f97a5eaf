"""Bring a surface near its goal by few maps, before it is fitted closely.

- What is built moves along each axis by itself (`axis_maps`), as the affine maps of its pieces would have it; its
  wheels go along, with one scale in their plane, and stay on the ground.
- What rolls on wheels, as its goal does, takes the goal's outline seen from the side instead (`side_maps`), if the two
  are not too unlike.
- What is no animal and alike from all four sides, as its goal is, takes the goal's outline (`profiles`).
- Else each piece goes to its partner, and the maps are blended (`affine_maps`, `blending`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from meshdeform.exemplar.affine_maps import AffineMaps, Cloud, PieceMotion, articulated, touching
from meshdeform.exemplar.axis_maps import axis_maps
from meshdeform.exemplar.blending import blend_weights, blended
from meshdeform.exemplar.kinds import is_boxed, is_built, is_living, is_turned
from meshdeform.exemplar.pieces import Matching, Pieces
from meshdeform.exemplar.profiles import outlined
from meshdeform.exemplar.shapes import Shape
from meshdeform.exemplar.side_maps import by_side
from meshdeform.exemplar.symmetry import quarter_asymmetry
from meshdeform.geometry.mesh import face_areas
from meshdeform.nouns.labels import Floats, Index
from meshdeform.reading.cells import neighbouring_faces
from meshdeform.reading.samples import hidden, spread

__all__ = ["cloud_of", "piece_weights", "started"]

_SAMPLES, _OUTLINE_SAMPLES = 2200, 6000
_WHOLE = 0.85
"""Share of the samples of both that is to be of matched pieces for their heights to count."""
_ALIKE = 0.012
_ROUND = "wheel"
_ON_GROUND = 0.02


def cloud_of(own: Shape, matching: Matching) -> Cloud:
    """Return samples of the pieces of a source."""
    return _seen(own, matching.source)


def _seen(shape: Shape, pieces: Pieces) -> Cloud:
    """Return samples of pieces that are not inside others of a shape's solids: equal shapes have equal ones."""
    samples = spread(shape.verts, shape.faces, _SAMPLES, 1)
    if shape.solids is not None:
        samples = samples.rows(~hidden(samples, shape.solids[samples.faces]))
    return Cloud(samples.positions, samples.normals, pieces.of_face[samples.faces]).in_pieces()


def piece_weights(own: Shape, pieces: Pieces) -> Floats:
    """Return the weight (V, G) of each piece for each vertex; wheels are not blended with what they touch."""
    loose = np.array([name == _ROUND for name in pieces.names])
    return blend_weights(own.verts, own.faces, pieces.of_face, loose)


def started(
    own: Shape, goal: Shape, matching: Matching, cloud: Cloud, weights: Floats, *, mirrored: bool
) -> dict[str, Floats]:
    """Return ways to bring a source near its goal: vertices (V, 3) by `axes`, `side` or `pieces`, and by the `outline`.

    `weights` (V, G) are those of the pieces; `mirrored`: whether it is to stay its own mirror image.
    """
    nouns = (own.noun, goal.noun)
    manner = PieceMotion(
        straight=not any(map(is_living, nouns)),
        boxed=all(map(is_boxed, nouns)),
        mirrored=mirrored,
    )
    ties = touching(cloud, len(matching.source), _borders(own, matching))
    goal_cloud = _seen(goal, matching.goal)
    names = matching.source.names
    maps = articulated(cloud, goal_cloud, names, matching.partner, ties, manner)
    ways = {}
    if all(map(is_built, nouns)):
        wheels = [_faces_of(pieces, _ROUND) for pieces in (matching.source, matching.goal)]
        side = by_side(own, goal, *wheels) if all(wheels) else None
        if side is None:
            ways["axes"] = _by_axes(own, matching, cloud, maps, weights, mirrored=mirrored)
        else:
            ways["side"] = side
    else:
        ways["pieces"] = blended(own.verts, maps, weights)
    if manner.straight and not manner.boxed and (all(map(is_turned, nouns)) or _is_lathed(own, goal)):
        height = _heights(own, goal, matching, cloud, goal_cloud, maps)
        positions, goal_positions = (spread(one.verts, one.faces, _OUTLINE_SAMPLES, 5).positions for one in (own, goal))
        ways["outline"] = outlined(own.verts, positions, goal_positions, height, _span(own))
    idle = weights.sum(1) == 0
    for verts in ways.values():
        verts[idle] = own.verts[idle]
    return ways


def _faces_of(pieces: Pieces, name: str) -> list[Index]:
    """Return the faces of each piece of a name."""
    return [np.flatnonzero(pieces.of_face == number) for number in pieces.named(name)]


def _borders(own: Shape, matching: Matching) -> dict[tuple[int, int], Floats]:
    """Return the middles (P, 3) of the edges between two pieces."""
    pairs = neighbouring_faces(own.faces, len(own.verts))[0]
    pieces = np.sort(matching.source.of_face[pairs], 1)
    hit = (pieces[:, 0] != pieces[:, 1]) & (pieces[:, 0] >= 0)
    pairs, pieces = pairs[hit], pieces[hit]
    middles = own.verts[own.faces[pairs]].mean((1, 2))
    keys = [tuple(row) for row in np.unique(pieces, axis=0).tolist()]
    return {key: middles[(pieces == key).all(1)] for key in keys}


def _goals(matching: Matching, cloud: Cloud, maps: AffineMaps) -> tuple[Floats, Floats]:
    """Return the points (N, 3) of matched pieces, and where their maps take them."""
    rows = np.flatnonzero(matching.partner[cloud.pieces] >= 0)
    positions, own = cloud.positions[rows], cloud.pieces[rows]
    goals = np.empty_like(positions)
    for piece in np.unique(own):
        goals[own == piece] = maps.map_points(positions[own == piece], int(piece))
    return positions, goals


def _heights(
    own: Shape, goal: Shape, matching: Matching, cloud: Cloud, goal_cloud: Cloud, maps: AffineMaps
) -> Callable[[Floats], Floats]:
    """Return the way from heights of the source to those of the goal: by its pieces, if nearly all are matched."""
    low, high = own.verts[own.faces][..., 1].min(), own.verts[own.faces][..., 1].max()
    goal_low, goal_high = goal.verts[:, 1].min(), goal.verts[:, 1].max()
    whole = (matching.partner[cloud.pieces] >= 0).mean() > _WHOLE
    if not whole or not (~matching.grows[goal_cloud.pieces]).mean() > _WHOLE:
        scale = (goal_high - goal_low) / max(high - low, 1e-9)
        return lambda y: goal_low + (y - low) * scale
    positions, goals = _goals(matching, cloud, maps)
    axes = axis_maps(positions, goals, np.ones(len(positions)), mirrored=True)
    reached = axes.along(1, np.array([low, high]))
    stretch = (goal_high - goal_low) / max(float(reached[1] - reached[0]), 1e-9)
    return lambda y: goal_low + (axes.along(1, y) - reached[0]) * stretch


def _is_lathed(own: Shape, goal: Shape) -> bool:
    """Return whether both are alike from all four sides, the goal by its noun if not by its shape."""
    alike = quarter_asymmetry(own.verts, own.faces) < _ALIKE
    return alike and (is_turned(goal.noun) or quarter_asymmetry(goal.verts, goal.faces) < _ALIKE)


def _span(own: Shape) -> float:
    """Return the height that faces span in the mean, weighed by area."""
    heights = own.verts[own.faces][..., 1]
    return float(np.average(np.ptp(heights, axis=1), weights=face_areas(own.verts, own.faces) + 1e-12))


def _by_axes(
    own: Shape, matching: Matching, cloud: Cloud, maps: AffineMaps, weights: Floats, *, mirrored: bool
) -> Floats:
    """Return the vertices moved along each axis by itself; wheels keep round."""
    positions, goals = _goals(matching, cloud, maps)
    axes = axis_maps(positions, goals, np.ones(len(positions)), mirrored=mirrored)
    verts = axes.map_points(own.verts)
    ground, new_ground = cloud.positions[:, 1].min(), axes.along(1, cloud.positions[:, 1].min(keepdims=True))[0]
    for piece in matching.source.named(_ROUND):
        rows = np.flatnonzero(weights[:, piece] > 0.5)
        if not len(rows):
            continue
        wheel = own.verts[rows]
        middle = (wheel.min(0) + wheel.max(0)) / 2
        linear = maps.linear[piece]
        plane = float(np.sqrt(max(np.linalg.det(linear[1:, 1:]), 1e-3)))
        across = np.ptp(verts[rows, 0]) / max(float(np.ptp(wheel[:, 0])), 1e-9)
        to = axes.map_points(middle[None])[0]
        if wheel[:, 1].min() < ground + _ON_GROUND:
            to[1] = new_ground + plane * (middle[1] - ground)
        verts[rows] = to + (wheel - middle) * [across, plane, plane]
    return verts
