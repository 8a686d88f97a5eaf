"""Move the vertices of a body as the table says: the whole by one affine map, parts in their own axes.

With A the growth along the axes that were asked for, and p the middle of the ground below it, a change of the whole is
``x' = p + A (x - p)`` for every vertex, whatever its triangles look like. Only bodies that are to be fat or thin, and
what is twisted, bent or tapered, have another map (`fatness`, `_shaped`).
"""

from __future__ import annotations

import numpy as np

from meshdeform.plain import fatness, limbs, table, wheels
from meshdeform.plain.body import UP, Body, Floats, Index, step
from meshdeform.plain.limbs import grown
from meshdeform.plain.moved import MeasuredPiece, Moved, frame, mean_extent
from meshdeform.plain.parts import BodyParts
from meshdeform.plain.pieces import PartMissingError
from meshdeform.plain.read_parts import READ
from meshdeform.plain.table import SHAPES, WHOLE
from meshdeform.plain.words import Change

_SLENDER = 2.0
"""How many times as tall as wide something is whose length is its height."""
_BASE, _ABOVE_BASE = 0.06, 0.25
"""Heights, as shares of the whole, up to which a base is one, and from which on it is none."""


def move(parts: BodyParts, change: Change, factor: float) -> Moved:
    """Carry out one change with a factor, which may be another than that of the change.

    Raises PartMissingError: the part is not there.
    """
    direction = table.direction(change.operation, change.part)
    if direction is None:
        raise PartMissingError(f"The {change.part} cannot be changed like that.")
    if change.part == WHOLE:
        return _whole(parts, change.operation, direction, factor)
    try:
        moved = _known(parts, change, direction, factor)
    except PartMissingError:
        try:  # a node or a material may have the name of what is not found otherwise
            return _named(parts, change, direction, factor)
        except PartMissingError:
            pass
        raise
    return moved or _named(parts, change, direction, factor)


def _known(parts: BodyParts, change: Change, direction: str, factor: float) -> Moved | None:
    """Return a part that has a finder of its own after a change; None if names alone tell where it is."""
    part, operation, sides = change.part, change.operation, change.sides
    if part == "leg":
        return limbs.legs(parts, operation, factor, sides)
    if part == "arm":
        return limbs.arms(parts, operation, factor, sides)
    if part == "wheel":
        return wheels.wheels(parts, operation, direction, factor, sides)
    if sides:
        return None
    if part == "head":
        return limbs.head(parts, direction, factor)
    if part == "neck":
        return _neck(parts, operation, direction, factor)
    if part == "tail":
        return limbs.tail(parts, operation, factor)
    if part in ("seat", "top"):
        return _slab(parts, part, direction, factor)
    if part == "back":
        return _back(parts, direction, factor)
    if part == "belly":
        return fatness.belly(parts, direction, factor)
    if part == "roof" and operation == "tall":
        return _roof(parts, factor)
    return None


def _named(parts: BodyParts, change: Change, direction: str, factor: float) -> Moved:
    """Return a part that joints, nodes or materials name after a change."""
    if change.part == "base" and not parts.has("base"):
        return _base(parts, factor)
    if change.part == "body" and not parts.is_told("body") and parts.is_living:
        wanted = {"all": "girth", "side": "side", "girth": "girth"}.get(direction)
        if wanted is not None:
            return fatness.belly(parts, wanted, factor)
    if direction == "place":
        raise PartMissingError(f"No {change.part} on legs was found that can be moved.")
    limb = parts.named(change.part)
    if change.sides:
        limb = limb.on(change.sides, parts.forward, change.part)
    thing = table.kind_of(change.part) in ("thing", "roof", "shoulder") and limb.found_by != "joints"
    return grown(limb, direction, factor, from_root=not thing)


# ---------------------------------------------------------------- the whole


def _whole(parts: BodyParts, operation: str, direction: str, factor: float) -> Moved:
    body = parts.body
    if operation in SHAPES:
        return Moved(_shaped(body, operation, factor), np.ones(len(body.points)), lambda _: 1.0)
    if direction == "girth":
        if parts.on_wheels:
            raise PartMissingError('Things on wheels are not fat or thin: say "wider" or "narrower".')
        if parts.is_living:
            return fatness.fat(parts, factor)
        direction = "level"
    if direction == "along":
        axes, asked = np.eye(3), _along(parts)
    else:
        axes, asked = frame(direction, body)
    return _affine(body, np.where(asked, factor, 1.0), MeasuredPiece(np.arange(len(body.points)), axes, asked))


def _along(parts: BodyParts) -> tuple[bool, bool, bool]:
    """Return which axis is the length of the whole: the front of a body, the longer level side of another thing."""
    body = parts.body
    axis = 0 if body.size[0] >= body.size[2] else 2
    if parts.rigged or body.named_front is not None:
        axis = body.front
    elif body.size[UP] > _SLENDER * max(float(body.size[0]), float(body.size[2])):
        axis = UP
    return axis == 0, axis == UP, axis == 2


def _affine(body: Body, growth: Floats, measured: MeasuredPiece) -> Moved:
    """Return the body grown along the axes about the middle of the ground below it, by (3,)."""
    stays = body.low + body.size / 2
    stays[UP] = body.ground
    affine = np.column_stack([np.diag(growth), stays - growth * stays])
    points = body.points @ affine[:, :3].T + affine[:, 3]
    return Moved(points, np.ones(len(points)), mean_extent([measured]), "", [measured], affine=affine)


def _shaped(body: Body, operation: str, strength: float) -> Floats:
    """Return the points twisted, leaning, bent, tapered or pinched about the upright middle line."""
    side, front = body.lateral, body.front
    points = body.points.copy()
    middle = body.low + body.size / 2
    height = max(float(body.size[UP]), 1e-12)
    up = (points[:, UP] - body.ground) / height
    x, z = points[:, side] - middle[side], points[:, front] - middle[front]
    if operation == "leaning":
        points[:, side] += np.tan(np.radians(15 * strength)) * up * height
    elif operation == "twisted":
        angle = np.radians(90 * strength) * up
        points[:, side] = middle[side] + np.cos(angle) * x - np.sin(angle) * z
        points[:, front] = middle[front] + np.sin(angle) * x + np.cos(angle) * z
    elif operation == "bent":
        radius = max(height / np.radians(45 * strength), 0.7 * float(body.size[side]))
        angle = up * height / radius
        points[:, side] = middle[side] + radius - (radius - x) * np.cos(angle)
        points[:, UP] = body.ground + (radius - x) * np.sin(angle)
        points[:, UP] += body.ground - points[:, UP].min()
    else:
        if operation == "tapered":
            narrow = 1 - min(0.5 * strength, 0.9) * up
        else:
            narrow = 1 - min(0.45 * strength, 0.8) * np.exp(-(((up - 0.5) / 0.2) ** 2))
        points[:, side], points[:, front] = middle[side] + narrow * x, middle[front] + narrow * z
    return points


# ---------------------------------------------------------------- layers: what stands on them is lifted


def _layer(body: Body, low: float, high: float, factor: float, found_by: str) -> Moved:
    """Return the layer between two heights with another height, and what is above it lifted."""
    heights = body.points[:, UP]
    within = ((heights >= low) & (heights <= high)).astype(float)
    shift = np.zeros_like(body.points)
    shift[:, UP] = (factor - 1) * np.clip(heights - low, 0, high - low)
    measured = [MeasuredPiece(np.flatnonzero(within), np.eye(3), (False, True, False))]
    return Moved(body.points + shift, within, mean_extent(measured), found_by, measured, shift)


def _slab(parts: BodyParts, word: str, direction: str, factor: float) -> Moved:
    """Return a seat or a top that is thicker, elsewhere, or wider with all that it carries and stands on."""
    body = parts.body
    low, high, found_by = parts.slab(word)
    rows = np.flatnonzero((body.points[:, UP] >= low) & (body.points[:, UP] <= high))
    if direction == "up":
        return _layer(body, low, high, factor, found_by)
    if direction == "place":
        return _placed(parts, rows, factor, found_by)
    axes, asked = (np.eye(3), _along(parts)) if direction == "along" else frame(direction, body)
    middle = body.low + body.size / 2

    def field(points: Floats) -> Floats:
        return (factor - 1) * np.where(asked, points - middle, 0.0)

    shift = field(body.points)
    for piece in parts.leg_pieces().pieces:  # legs keep their girth
        shift += piece.weight[:, None] * (field(body.points[piece.rows].mean(0)[None]) - shift)
    within = np.zeros(len(body.points))
    within[rows] = 1
    measured = [MeasuredPiece(rows, axes, asked)]
    return Moved(body.points + shift, within, mean_extent(measured), found_by, measured, shift)


def _placed(parts: BodyParts, rows: Index, factor: float, found_by: str) -> Moved:
    """Return a slab higher or lower above the ground, as it is, on longer or shorter legs.

    Raises PartMissingError: legs cannot become that short.
    """
    body = parts.body
    length = parts.legs.hip - body.ground
    height = float(body.points[rows, UP].max()) - body.ground
    of_legs = 1 + (factor - 1) * height / length
    if of_legs < 1 / 5:
        raise PartMissingError("Its legs are too short to lower it by so much.")
    moved = limbs.legs(parts, "long", of_legs, ())
    return Moved(
        moved.points,
        moved.weight,
        lambda at: float(at[rows, UP].max() - at[:, UP].min()),
        found_by,
        [MeasuredPiece(rows, np.eye(3), (False, False, False))],
        moved.shift,
    )


def _back(parts: BodyParts, direction: str, factor: float) -> Moved:
    return grown(parts.back, direction, factor, from_root=False)


def _roof(parts: BodyParts, factor: float) -> Moved:
    """Return a roof that is taller with all that is in it; what stands on it is lifted."""
    limb = parts.named("roof")
    heights = limb.body.points[limb.weight > 0.5, UP]
    return _layer(limb.body, float(heights.min()), float(heights.max()), factor, limb.found_by)


def _base(parts: BodyParts, factor: float) -> Moved:
    """Return what something without legs stands on, wider; PartMissingError: it has legs or wheels."""
    body = parts.body
    if parts.rigged or parts.on_wheels or parts.on_legs:
        raise PartMissingError("No base was found: it stands on legs or wheels.")
    up = (body.points[:, UP] - body.ground) / max(float(body.size[UP]), 1e-12)
    weight = 1 - step((up - _BASE) / (_ABOVE_BASE - _BASE))
    return _wider(body, weight, np.flatnonzero(up <= _BASE), factor)


def _wider(body: Body, weight: Floats, rows: Index, factor: float) -> Moved:
    """Return a band of the body with another girth about its own upright middle line."""
    middle = (body.points[rows].max(0) + body.points[rows].min(0)) / 2
    over = body.points - middle
    over[:, UP] = 0
    measured = [MeasuredPiece(rows, np.eye(3), (True, False, True))]
    points = body.points + (weight * (factor - 1))[:, None] * over
    return Moved(points, weight, mean_extent(measured), READ, measured)


def _neck(parts: BodyParts, operation: str, direction: str, factor: float) -> Moved:
    """Return the neck of a body, or of a bottle."""
    body = parts.body
    if parts.is_living:
        return limbs.neck(parts, operation, factor)
    low, high, found_by = parts.bottle_neck
    if direction == "along":
        return _layer(body, low, high, factor, found_by)
    heights = body.points[:, UP]
    band = 0.15 * (high - low)
    weight = step((heights - low) / band) * step((float(heights.max()) + band - heights) / band)
    rows = np.flatnonzero((heights > low + band) & (heights <= high))
    if not len(rows):
        raise PartMissingError("No neck was found: it has too few vertices there.")
    wider = _wider(body, weight, rows, factor)
    if direction == "girth":
        return wider
    longer = _layer(body, low, high, factor, found_by)
    return Moved(longer.points + wider.points - body.points, weight, longer.length, found_by, longer.measured)
