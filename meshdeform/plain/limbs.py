"""Move limbs and other parts that hang on something, each piece in its own axes.

With x a vertex, w its weight in the piece, A the growth along the axes that were asked for about the point p that
stays, and c what hangs on the piece at r::

    x' = x + w (A - I)(x - p),    c' = c + (A - I)(r - p)

Girth is about the piece's centre line. Legs lift what stands on them, and feet keep their shape on the ground.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from meshdeform.plain.body import UP, Body, Floats, ease, step
from meshdeform.plain.heads import Head
from meshdeform.plain.moved import MeasuredPiece, Moved, frame, mean_extent
from meshdeform.plain.parts import BodyParts, Legs
from meshdeform.plain.pieces import Limb, PartMissingError, Piece, attachment

Line = Callable[[Floats], Floats]


def grown(limb: Limb, direction: str, factor: float, *, from_root: bool) -> Moved:
    """Return a part with each piece grown along a direction of the table.

    `from_root`: whether all of a piece grows from where it is attached; else along each axis from the end that is, or
    from its middle.
    """
    body, points = limb.body, limb.body.points.copy()
    shift, measured = np.zeros_like(points), []
    girths: list[Callable[[Floats], float]] = []
    for piece in limb.pieces:
        if not len(piece.rows):
            continue
        axes, asked = frame(direction, body, piece)
        measured.append(MeasuredPiece(piece.rows, axes, asked))
        if direction == "girth":
            field, girth = _girth_field(body, piece)
            girths.append(girth)
        else:
            field = _axes_field(piece, axes[list(asked)], from_root=from_root and direction in ("all", "along"))
        points += (piece.weight * (factor - 1))[:, None] * field(body.points)
        for chain in piece.carried:
            shift += chain[:, None] * (factor - 1) * field(attachment(body, chain)[None])
    length = mean_extent(measured) if not girths else lambda at: float(np.mean([girth(at) for girth in girths]))
    return Moved(points + shift, limb.weight, length, limb.found_by, measured, shift)


def _axes_field(piece: Piece, axes: Floats, *, from_root: bool) -> Callable[[Floats], Floats]:
    """Return the displacements of points when a piece doubles along axes (A, 3)."""
    anchors = [piece.pivot if from_root else piece.anchor(axis) for axis in axes]

    def field(points: Floats) -> Floats:
        moved = np.zeros_like(points)
        for axis, anchor in zip(axes, anchors, strict=True):
            moved += ((points - anchor) @ axis)[:, None] * axis
        return moved

    return field


def _girth_field(body: Body, piece: Piece) -> tuple[Callable[[Floats], Floats], Callable[[Floats], float]]:
    """Return the displacements of points when a piece's girth doubles, and the measure of its girth."""
    axis = piece.axes[0]
    along = body.points @ axis
    own = along[piece.rows]
    line = centre_line(along, body.points, piece.weight, (float(own.min()), float(own.max())), degree=2)

    def field(points: Floats) -> Floats:
        over = points - line(points @ axis)
        return np.asarray(over - (over @ axis)[:, None] * axis)

    centre = line(along)[piece.rows]

    def girth(at: Floats) -> float:
        over = at[piece.rows] - centre
        over = over - (over @ axis)[:, None] * axis
        return float(np.sqrt(np.square(over).sum(1).mean()))

    return field, girth


def centre_line(
    along: Floats, across: Floats, weight: Floats, ends: tuple[float, float], degree: int = 4, bins: int = 12
) -> Line:
    """Return the middles of a part's extent (.., K) by the position along it, as polynomials of bins."""
    low, high = ends
    edges = np.linspace(low, high, bins + 1)
    middles, values = [], []
    for first, last in itertools.pairwise(edges):
        own = (along >= first) & (along <= last) & (weight > 0.5)
        if own.sum() > 2:
            middles.append(along[own].mean())
            values.append((across[own].max(0) + across[own].min(0)) / 2)
    if len(set(middles)) < 2:
        own = weight > 0.5
        mean = (across[own] if own.any() else across).mean(0)
        return lambda at: np.repeat(mean[None], len(at), 0)
    scaled = (np.array(middles) - low) / max(high - low, 1e-12)
    fit = np.polyfit(scaled, np.array(values), min(degree, len(middles) - 1))
    first, last = float(scaled.min()), float(scaled.max())

    def line(at: Floats) -> Floats:
        t = np.clip((at - low) / max(high - low, 1e-12), first, last)
        return np.stack([np.polyval(fit[:, k], t) for k in range(fit.shape[1])], 1)

    return line


# ---------------------------------------------------------------- legs


def legs(parts: BodyParts, operation: str, factor: float, sides: tuple[str, ...]) -> Moved:
    """Return legs that are longer, thicker or both; all of them, or those on some sides."""
    found = parts.legs
    limb = parts.leg_pieces()
    if sides:
        limb = limb.on(sides, parts.forward, "leg")
        found = replace(found, weight=limb.weight)
    if operation == "big":
        longer, thicker = legs(parts, "long", factor, sides), legs(parts, "fat", factor, sides)
        return replace(longer, points=longer.points + thicker.points - parts.body.points)
    asked = (False, True, False) if operation == "long" else (True, False, True)
    measured = [MeasuredPiece(piece.rows, np.eye(3), asked) for piece in limb.pieces]
    if operation == "fat":
        return replace(_thicker_legs(parts.body, found, factor), measured=measured)
    return replace(_longer_legs(parts.body, found, factor, lift=not sides), measured=measured)


def _longer_legs(body: Body, found: Legs, factor: float, *, lift: bool) -> Moved:
    """Return longer legs: they lift what stands on them, or, of some of them alone, reach further down."""
    length = found.hip - body.ground
    points = body.points.copy()
    share = ease((body.points[:, UP] - found.foot) / max(found.hip - found.foot, 1e-12))
    grown_by = (factor - 1) * length
    if not lift:
        points[:, UP] -= grown_by * found.weight * (1 - share)
        rows = np.flatnonzero(found.weight > 0.5)
        return Moved(points, found.weight, lambda at: float(np.ptp(at[rows, UP])), found.found_by)
    points[:, UP] += grown_by * (found.weight * share + 1 - found.weight)
    carried = np.flatnonzero((found.weight < 0.05) & (body.points[:, UP] > found.hip))
    if not len(carried):
        carried = np.argsort(np.abs(body.points[:, UP] - found.hip))[: max(3, len(points) // 100)]
    before = float(body.points[carried, UP].mean()) - length
    own = found.weight > 0.5
    shift = np.zeros_like(points)
    shift[:, UP] = grown_by
    # From the ground to the hips, which are lifted as what stands on the legs is.
    return Moved(
        points,
        found.weight,
        lambda at: float(at[carried, UP].mean() - at[own, UP].min()) - before + float(body.points[own, UP].min()),
        found.found_by,
        shift=shift,
    )


def _thicker_legs(body: Body, found: Legs, factor: float) -> Moved:
    length = found.hip - body.ground
    points = body.points.copy()
    for weight, line in leg_lines(body, found, degree=2):
        top = step((body.points[:, UP] - found.hip + 0.15 * length) / (0.15 * length))
        by = weight * (1 - top) * (factor - 1)
        for axis, centre in zip((body.lateral, body.front), line(body.points[:, UP]).T, strict=True):
            points[:, axis] += by * (body.points[:, axis] - centre)
    return Moved(points, found.weight, _girth(body, found), found.found_by)


def _girth(body: Body, found: Legs) -> Callable[[Floats], float]:
    """Return the measure of how thick legs are half way up."""
    half = (body.ground + found.hip) / 2
    far = np.abs(body.points[:, UP] - half) / max(found.hip - body.ground, 1e-12)
    own = [np.flatnonzero((found.limb == k) & (found.weight > 0.9) & (far < 0.3)) for k in np.unique(found.limb)]
    own = [rows for rows in own if len(rows) > 2]
    axes = [body.lateral, body.front]

    def girth(at: Floats) -> float:
        return float(np.mean([np.linalg.norm(np.ptp(at[rows][:, axes], axis=0)) for rows in own])) if own else 1.0

    return girth


def leg_lines(body: Body, found: Legs, *, degree: int) -> list[tuple[Floats, Line]]:
    """Return each leg's weight (V,) and its centre line: sideways and forward by height."""
    lines = []
    for number in np.unique(found.limb[found.weight > 0.3]):
        weight = np.where(found.limb == number, found.weight, 0)
        own = weight > 0.5
        if own.sum() < 4:
            continue
        heights = body.points[:, UP]
        line = centre_line(
            heights,
            body.points[:, [body.lateral, body.front]],
            weight,
            (heights[own].min(), heights[own].max()),
            degree,
        )
        lines.append((weight, line))
    return lines


# ---------------------------------------------------------------- arms, necks, tails


def arms(parts: BodyParts, operation: str, factor: float, sides: tuple[str, ...]) -> Moved:
    """Return arms that are longer to the wrist, hands as they are; or thicker, or larger."""
    limb = parts.arms
    if sides:
        limb = limb.on(sides, parts.forward, "arm")
    if operation != "long":
        return grown(limb, "girth" if operation == "fat" else "all", factor, from_root=True)
    body = limb.body
    points, tips, measured = body.points.copy(), [], []
    for piece in limb.pieces:
        axis = body.points[piece.rows].mean(0) - piece.pivot
        axis /= max(float(np.linalg.norm(axis)), 1e-12)
        along = (body.points - piece.pivot) @ axis
        length = float(np.percentile(along[piece.rows], 99))
        if length <= 0:
            continue
        share = ease(along / (0.8 * length), 0.15)
        points += (piece.weight * share * (factor - 1) * length)[:, None] * axis
        tips.append((int(piece.rows[np.argmax(along[piece.rows])]), piece.pivot, axis))
        second, third = piece.axes[1] - (piece.axes[1] @ axis) * axis, np.zeros(3)
        second /= max(float(np.linalg.norm(second)), 1e-12)
        third = np.cross(axis, second)
        measured.append(MeasuredPiece(piece.rows, np.stack([axis, second, third]), (True, False, False)))
    if not tips:
        raise PartMissingError("No arms were found that reach away from the body.")
    return Moved(
        points,
        limb.weight,
        lambda at: float(np.mean([(at[tip] - root) @ axis for tip, root, axis in tips])),
        limb.found_by,
        measured,
    )


def head(parts: BodyParts, direction: str, factor: float) -> Moved:
    """Return a head of another size on its neck."""
    body, found = parts.body, parts.head
    limb = Limb(body, [Piece(body, found.weight, found.pivot)], found.found_by)
    return grown(limb, direction, factor, from_root=True)


def neck(parts: BodyParts, operation: str, factor: float) -> Moved:
    """Return a neck that is longer and carries the head, or thicker, or both."""
    body, found = parts.body, parts.head
    if operation == "fat":
        return _thicker_neck(body, found, factor)
    length = max(found.neck_length, 0.12 * body.diagonal)
    raised = (ease(found.neck) * (factor - 1) * length)[:, None] * found.up
    weight = 4 * found.neck * (1 - found.neck)
    top, low = found.neck > 0.95, found.neck < 0.05
    reach = length / max(float(found.up @ found.up), 1e-12)

    def measure(at: Floats) -> float:
        if not top.any() or not low.any():
            return 1.0
        apart = (at[top].mean(0) - at[low].mean(0)) @ found.up
        before = (body.points[top].mean(0) - body.points[low].mean(0)) @ found.up
        return float(reach + apart - before)

    shift = (found.neck > 0.5)[:, None] * (factor - 1) * length * found.up
    moved = Moved(body.points + raised, weight, measure, found.found_by, shift=shift)
    if operation == "big":
        return replace(moved, points=moved.points + _thicker_neck(body, found, factor).points - body.points)
    return moved


def _thicker_neck(body: Body, found: Head, factor: float) -> Moved:
    weight = np.clip(4 * found.neck * (1 - found.neck), 0, 1)
    over = body.points - found.pivot
    across = over - (over @ found.up)[:, None] * found.up
    rows = np.flatnonzero(weight > min(0.5, 0.9 * float(weight.max())))

    def girth(at: Floats) -> float:
        around = at[rows] - found.pivot
        around = around - (around @ found.up)[:, None] * found.up
        return float(np.sqrt(np.square(around).sum(1).mean())) if len(rows) else 1.0

    return Moved(body.points + (weight * (factor - 1))[:, None] * across, weight, girth, found.found_by)


def tail(parts: BodyParts, operation: str, factor: float) -> Moved:
    """Return a tail that is longer along its centre line, or thicker about it, or both."""
    body, found = parts.body, parts.tail
    along = found.length - found.from_tip
    line = centre_line(along, body.points, found.weight, (0.0, found.length), degree=2)
    here = line(np.clip(along, 0, found.length))
    root = line(np.zeros(1))
    band = step(along / max(0.3 * found.length, 1e-12))
    own = Piece(body, found.weight, root[0])
    over = (found.weight * band * (factor - 1))[:, None] * (body.points - here)
    onward = (found.weight * (factor - 1))[:, None] * (here - root)
    if operation == "fat":
        rows = np.flatnonzero(found.weight * band > 0.5)

        def girth(at: Floats) -> float:
            return float(np.sqrt(np.square(at[rows] - here[rows]).sum(1).mean())) if len(rows) else 1.0

        measured = [MeasuredPiece(rows, own.axes, (False, True, True))]
        return Moved(body.points + over, found.weight, girth, found.found_by, measured)
    tip, foot = int(np.argmin(found.from_tip)), root[0]
    points = body.points + onward + (over if operation == "big" else 0)
    measured = [MeasuredPiece(own.rows, own.axes, (True, operation == "big", operation == "big"))]
    return Moved(points, found.weight, lambda at: float(np.linalg.norm(at[tip] - foot)), found.found_by, measured)
