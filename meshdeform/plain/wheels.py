"""Make wheels wider along their axle, or bigger, each about its own middle, with room for them in what is around.

Bigger wheels lift what stands on them. A vertex within the width of a wheel, of the wheel or of the rest, at a distance
d from the axle of a wheel of radius r that becomes f r, moves away from the axle by

    (f - 1) d  up to r,   (f - 1) r s((R - d) / (R - r))  from there to R = r + 2.5 (f - 1) r,   s a smooth step,

so that arches make room and nothing folds. What is near two wheels follows the one that moves it more. It stays where
it would fold because its triangles are few, and the wheel is a piece of its own, and where there is no arch: where the
wheel stands in the body, it grows into it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshdeform.plain.body import UP, Body, Flags, Floats, step
from meshdeform.plain.limbs import grown
from meshdeform.plain.moved import MeasuredPiece, Moved, mean_extent
from meshdeform.plain.parts import BodyParts
from meshdeform.plain.pieces import Piece

_REACH = 2.5
_BESIDE = 0.5
"""Width of the band beside a wheel in which the room for it ends, as a share of the wheel's."""
_HEIGHT = 0.1
"""Height over the lowest wheel, as a share of the whole, up to which another stands on the ground."""
_SMOOTHED = 2
_RIM = 99.0
"""Percentile of the distances from the axle that is the radius."""
_RIM_FROM = 0.8
"""Share of the radius beyond which a surface within the wheel is none of its brake or hub."""
_SIDEWALL = 0.1
"""Share of a wheel's width, at either side, that a surface beside it may reach into."""
_SECTORS = 12
"""Sectors of the rim; a surface that passes through it is in two at least."""
_SAMPLES = 20_000


def wheels(parts: BodyParts, operation: str, direction: str, factor: float, sides: tuple[str, ...]) -> Moved:
    """Return wheels that are wider, or bigger; of some sides alone, bigger ones stand on the ground as before.

    Raises PartMissingError: there are none, or none on these sides.
    """
    limb = parts.wheels
    if sides:
        limb = limb.on(sides, parts.forward, "wheel")
    if operation != "big":
        return grown(limb, direction, factor, from_root=False)
    body, axle = limb.body, limb.body.lateral
    others = np.logical_or.reduce([piece.weight > 0 for piece in parts.wheels.pieces])
    grounded = {id(each) for each in _on_ground(body, limb.pieces)}
    points, shift = body.points.copy(), np.zeros_like(body.points)
    around = _surface_of(body, ~others)
    for piece in limb.pieces:
        by, near = _away_from_axle(body, piece, factor)
        if sides and id(piece) in grounded:
            by[:, UP] += near * (factor - 1) * float(np.ptp(body.points[piece.rows, UP])) / 2
        points += np.where((piece.weight > 0)[:, None], by, 0.0)
        farther = ~others & (np.linalg.norm(by, axis=1) > np.linalg.norm(shift, axis=1))
        wider = body.points + np.where(farther[:, None], by, shift)
        if not _is_loose(body, piece) or not (_crosses_rim(body, piece, around) or body.flipped(wider).any()):
            shift[farther] = by[farther]
        along = (factor - 1) * (body.points[:, axle] - piece.pivot[axle])
        points[:, axle] += body.smooth(piece.weight, _SMOOTHED) * along
    if not sides:
        sunk = [float(np.ptp(body.points[each.rows, UP])) / 2 for each in limb.pieces if id(each) in grounded]
        shift[:, UP] += (factor - 1) * max(sunk)
        points[:, UP] += np.where(others, (factor - 1) * max(sunk), 0.0)
    points += np.where(others[:, None], 0.0, shift)
    measured = [MeasuredPiece(piece.rows, np.eye(3), (True, True, True)) for piece in limb.pieces]
    return Moved(points, limb.weight, mean_extent(measured), limb.found_by, measured, shift)


def _is_loose(body: Body, piece: Piece) -> bool:
    """Return whether a wheel shares no face with the rest, so that the rest may also stay where it is."""
    own = piece.weight > 0
    return bool((np.bincount(body.components, ~own)[body.components[own]] == 0).all())


def _surface_of(body: Body, chosen: Flags) -> Floats:
    """Return points (N, 3) of the faces whose vertices are all chosen."""
    points, _, faces = body.sampled(_SAMPLES)
    return points[chosen[body.faces[faces]].all(1)]


def _crosses_rim(body: Body, piece: Piece, around: Floats) -> bool:
    """Return whether a surface passes through the rim of a wheel: brakes and hubs are nearer to its axle."""
    own, plane = body.points[piece.rows], [UP, body.front]
    low, high = float(own[:, body.lateral].min()), float(own[:, body.lateral].max())
    edge = _SIDEWALL * (high - low)
    over = (around - piece.pivot)[:, plane]
    share = np.linalg.norm(over, axis=1) / _radius(body, piece)
    at = around[:, body.lateral]
    inside = (share > _RIM_FROM) & (share < 1) & (at > low + edge) & (at < high - edge)
    sectors = np.floor(np.arctan2(over[inside, 0], over[inside, 1]) / np.pi * _SECTORS / 2)
    return len(np.unique(sectors)) > 1


def _radius(body: Body, piece: Piece) -> float:
    over = (body.points[piece.rows] - piece.pivot)[:, [UP, body.front]]
    return float(np.percentile(np.linalg.norm(over, axis=1), _RIM))


def _away_from_axle(body: Body, piece: Piece, factor: float) -> tuple[Floats, Floats]:
    """Return how a wheel and what is around it move away from its axle, (V, 3), and how near (V,) to it they are."""
    own = body.points[piece.rows]
    plane = [UP, body.front]
    radius = _radius(body, piece)
    over = np.zeros_like(body.points)
    over[:, plane] = (body.points - piece.pivot)[:, plane]
    distance = np.linalg.norm(over, axis=1)
    beyond = max(_REACH * abs(factor - 1) * radius, 1e-300)
    low, high = float(own[:, body.lateral].min()), float(own[:, body.lateral].max())
    at = body.points[:, body.lateral]
    beside = np.maximum(np.maximum(low - at, at - high), 0) / max(_BESIDE * (high - low), 1e-300)
    near = step((radius + beyond - distance) / beyond) * step(1 - beside)
    amount = (factor - 1) * near * np.minimum(1.0, radius / np.maximum(distance, 1e-300))
    return amount[:, None] * over, near


def _on_ground(body: Body, pieces: Sequence[Piece]) -> list[Piece]:
    """Return the wheels that stand on the ground, as spare ones do not."""
    bottoms = [float(body.points[each.rows, UP].min()) for each in pieces]
    limit = min(bottoms) + _HEIGHT * float(body.size[UP])
    return [each for each, bottom in zip(pieces, bottoms, strict=True) if bottom < limit]
