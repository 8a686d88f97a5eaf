"""Move the vertices of a body as an operation on a part says: with full strength in the part, blended over its band.

Legs lift what stands on them, and feet keep their shape on the ground. Fatness scales sections about each part's own
centre line, most at the belly, and carries limbs along. A change of one axis goes where it hurts least: slabs of
oblique surface, narrow peaks of the solid (seats, tops, posts) and wheels keep their slope (after Kraevoy et al. 2008,
Non-homogeneous resizing of complex models).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from meshdeform.plain.body import UP, Body, Floats, ease, step
from meshdeform.plain.parts import Head, Legs, Limb, PartMissingError, Parts, attachment
from meshdeform.plain.words import SHAPES, WHOLE, Change

_SLABS = 160
_SAMPLES = 2000
_ALONG_AN_AXIS = 0.99
_BOXY = 0.8
"""Share of the surface whose normals are along an axis, above which a thing without legs is made of plates."""
_Line = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Moved:
    """A body after a change."""

    points: Floats  # (V, 3) float64
    weight: Floats  # (V,) float64: how much each vertex belongs to the part
    length: Callable[[Floats], float]  # measures what was to grow, on any places (V, 3) of the vertices
    found_by: str = ""  # how the part was found; empty for the whole


def move(parts: Parts, change: Change, factor: float) -> Moved:
    """Carry out one change with a factor, which may be another than that of the change.

    Raises PartMissingError: the part is not there.
    """
    if change.part == WHOLE:
        return _whole(parts, change.operation, factor)
    if change.operation in SHAPES:
        raise PartMissingError(f"Only the whole can be {change.operation}, no part of it.")
    special: dict[str, Callable[[Parts, str, float], Moved | None]] = {
        "leg": _leg,
        "head": _head,
        "neck": _neck,
        "tail": _tail,
        "arm": _arm,
        "wheel": _wheel,
        "seat": _slab,
        "top": _slab,
        "back": _back,
        "body": lambda parts, operation, factor: _whole(parts, operation, factor) if operation == "fat" else None,
    }
    try:
        moved = special[change.part](parts, change.operation, factor) if change.part in special else None
        return moved or _limb(parts.named(change.part), change.operation, factor)
    except PartMissingError:
        if change.part not in special:
            raise
        try:  # a node or a material may have the name of what is not found otherwise
            return _limb(parts.named(change.part), change.operation, factor)
        except PartMissingError:
            pass
        raise


# ---------------------------------------------------------------- the whole


def _whole(parts: Parts, operation: str, factor: float) -> Moved:
    body = parts.body
    everything = np.ones(len(body.points))
    if operation == "fat":
        return _fat(parts, factor)
    if operation in SHAPES:
        return Moved(_shaped(body, operation, factor), everything, lambda _: 1.0)
    if operation == "big":
        foot = np.array([body.points[:, 0].mean(), body.ground, body.points[:, 2].mean()])
        return Moved(
            foot + factor * (body.points - foot), everything, lambda at: float(np.linalg.norm(np.ptp(at, axis=0)))
        )
    axis = {"tall": UP, "wide": body.lateral, "long": body.front}[operation]
    if operation == "long" and (body.either or not parts.rigged):
        axis = 0 if body.size[0] >= body.size[2] else 2
    arms = parts.of_class("arm")
    if operation == "wide" and arms is not None and arms.max() > 0.5 and body.size[UP] > body.size[body.front]:
        return _fat(parts, factor)  # a person with arms spread is made wide, not longer-armed
    return Moved(_resized(parts, axis, factor), everything, lambda at: float(np.ptp(at[:, axis])))


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


def _resized(parts: Parts, axis: int, factor: float) -> Floats:
    """Return the points with another extent along an axis; wheels move as they are."""
    body, wheels = parts.body, parts.wheels
    kept: list[tuple[float, float]] = []
    for component in np.unique(body.components[wheels]):
        along = body.points[(body.components == component) & wheels, axis]
        kept.append((float(along.min()), float(along.max())))
    if sum(high - low for low, high in {(round(a, 3), round(b, 3)) for a, b in kept}) > 0.7 * body.size[axis]:
        kept = []
    edges, moved = _slopes(body, axis, factor, kept, solid=not parts.rigged)
    # Large triangles cannot bend: a map that is alike everywhere flips none.
    moved += parts.even * (np.linspace(moved[0], moved[-1], len(moved)) - moved)
    points = body.points.copy()
    points[:, axis] = np.interp(points[:, axis], edges, moved)
    for component in np.unique(body.components[wheels]):  # each wheel moves as one
        own = (body.components == component) & wheels
        points[own, axis] = body.points[own, axis] + np.median((points - body.points)[own, axis])
    return points


def _slopes(
    body: Body, axis: int, factor: float, kept: list[tuple[float, float]], *, solid: bool
) -> tuple[Floats, Floats]:
    """Return edges of slabs along an axis, and where they go."""
    low, extent = float(body.low[axis]), max(float(body.size[axis]), 1e-12)
    edges = np.linspace(low, low + extent, _SLABS + 1)
    middles = (edges[:-1] + edges[1:]) / 2
    cost = ndimage.gaussian_filter1d(_obliqueness(body, axis, low, extent), 2, mode="nearest")
    if solid:
        # A plate or a row of posts is a narrow peak of the solid section: it keeps its thickness.
        grid = body.solid
        section = grid.filled.sum(tuple(a for a in range(3) if a != axis)).astype(float)
        section /= section.max()
        places = grid.origin[axis] + (np.arange(len(section)) + 0.5) * grid.side
        width = max(4, int(np.ceil(0.2 * extent / grid.side)) + 1)
        peaks = section - ndimage.grey_opening(np.pad(section, width), width)[width:-width]
        cost += 2.5 * ndimage.maximum_filter1d(np.interp(middles, places, ndimage.maximum_filter1d(peaks, 3)), 3)
    flow = 1 / (cost + 0.12)
    for first, last in kept:
        flow[(middles > first - 0.01 * extent) & (middles < last + 0.01 * extent)] = 0
    if flow.max() == 0:
        flow[:] = 1
    flow /= flow.mean()
    for _ in range(20):
        flow = np.minimum(flow, 2.2)
        flow /= flow.mean()
    if factor < 1:
        for most in (0.85, 0.92):
            flow = np.minimum(flow, most / (1 - factor))
            flow /= flow.mean()
    flow = ndimage.gaussian_filter1d(flow, 3, mode="nearest")
    flow /= flow.mean()
    slope = np.maximum(1 + (factor - 1) * flow, 0.05)
    slope *= factor / slope.mean()
    moved = low + np.append(0, np.cumsum(slope)) * extent / _SLABS
    fixed = low if axis == UP else low + extent / 2
    return edges, moved - (np.interp(fixed, edges, moved) - fixed)


def _obliqueness(body: Body, axis: int, low: float, extent: float) -> Floats:
    """Return how much of the surface in each slab is neither along nor across the axis, from 0 to 1."""
    areas = np.linalg.norm(body.crosses, axis=1)
    facing = np.abs(body.crosses[:, axis]) / np.maximum(areas, 1e-300)
    oblique = areas * facing * np.sqrt(np.maximum(0, 1 - facing**2))
    ends = [body.corners[:, :, axis].min(1), body.corners[:, :, axis].max(1)]
    first, last = (np.clip(((end - low) / extent * _SLABS).astype(int), 0, _SLABS - 1) for end in ends)
    sums = []
    for values in (oblique, areas):
        share, totals = values / (last - first + 1), np.zeros(_SLABS + 1)
        np.add.at(totals, first, share)
        np.add.at(totals, last + 1, -share)
        sums.append(np.maximum(np.cumsum(totals[:-1]), 0))
    ratio = sums[0] / np.maximum(sums[1], 1e-9 * max(float(sums[1].max()), 1e-300))
    return 0.5 * ratio / max(float(ratio.max()), 1e-9) + 0.5 * sums[0] / max(float(sums[0].max()), 1e-300)


# ---------------------------------------------------------------- parts of creatures and furniture


def _leg(parts: Parts, operation: str, factor: float) -> Moved:
    body, legs = parts.body, parts.legs
    length = legs.hip - body.ground
    points = body.points.copy()
    if operation == "fat":
        posts = legs
        if legs.found_by == "geometry" and legs.foot > body.ground + 0.1 * length:  # a base keeps its shape
            weight = legs.weight * step((body.points[:, UP] - legs.foot) / (0.1 * length))
            posts = replace(legs, weight=weight, limb=body.nearest(body.groups(weight > 0.5)))
        for weight, line in _leg_lines(body, posts, degree=2):
            top = step((body.points[:, UP] - legs.hip + 0.15 * length) / (0.15 * length))
            grown = weight * (1 - top) * (factor - 1)
            for axis, centre in zip((body.lateral, body.front), line(body.points[:, UP]).T, strict=True):
                points[:, axis] += grown * (body.points[:, axis] - centre)
        return Moved(points, legs.weight, _girth(body, posts), legs.found_by)
    share = ease((body.points[:, UP] - legs.foot) / max(legs.hip - legs.foot, 1e-12))
    points[:, UP] += (factor - 1) * length * (legs.weight * share + 1 - legs.weight)
    carried = np.flatnonzero((legs.weight < 0.05) & (body.points[:, UP] > legs.hip))
    if not len(carried):
        carried = np.argsort(np.abs(body.points[:, UP] - legs.hip))[: max(3, len(points) // 100)]
    before = float(body.points[carried, UP].mean()) - length
    # From the ground to the hips, which are lifted as what stands on the legs is.
    return Moved(
        points,
        legs.weight,
        lambda at: float(at[carried, UP].mean() - at[:, UP].min()) - before + body.ground,
        legs.found_by,
    )


def _girth(body: Body, legs: Legs) -> Callable[[Floats], float]:
    """Return the measure of how thick legs are half way up."""
    half = (body.ground + legs.hip) / 2
    far = np.abs(body.points[:, UP] - half) / max(legs.hip - body.ground, 1e-12)
    own = [np.flatnonzero((legs.limb == k) & (legs.weight > 0.9) & (far < 0.3)) for k in np.unique(legs.limb)]
    own = [rows for rows in own if len(rows) > 2]
    axes = [body.lateral, body.front]

    def girth(at: Floats) -> float:
        return float(np.mean([np.linalg.norm(np.ptp(at[rows][:, axes], axis=0)) for rows in own])) if own else 1.0

    return girth


def _leg_lines(body: Body, legs: Legs, *, degree: int) -> list[tuple[Floats, _Line]]:
    """Return each leg's weight (V,) and its centre line: sideways and forward by height."""
    lines = []
    for number in np.unique(legs.limb[legs.weight > 0.3]):
        weight = np.where(legs.limb == number, legs.weight, 0)
        own = weight > 0.5
        if own.sum() < 4:
            continue
        heights = body.points[:, UP]
        line = _centre_line(
            heights,
            body.points[:, [body.lateral, body.front]],
            weight,
            (heights[own].min(), heights[own].max()),
            degree,
        )
        lines.append((weight, line))
    return lines


def _centre_line(
    along: Floats, across: Floats, weight: Floats, ends: tuple[float, float], degree: int = 4, bins: int = 12
) -> _Line:
    """Return the middles of a part's extent (.., K) by the place along it, as polynomials of bins."""
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


def _head(parts: Parts, _operation: str, factor: float) -> Moved:
    body, head = parts.body, parts.head
    points = body.points + (head.weight * (factor - 1))[:, None] * (body.points - head.pivot)
    return Moved(points, head.weight, _spread(body, head.weight), head.found_by)


def _spread(body: Body, weight: Floats) -> Callable[[Floats], float]:
    """Return the measure of a part's size, or of the mean size of its pieces, by their inner vertices."""
    pieces = []
    for piece in body.groups(weight > 0.5):
        inner = piece[weight[piece] >= np.quantile(weight[piece], 0.6)]
        pieces.append(inner if len(inner) >= 4 else piece)

    def spread(at: Floats) -> float:
        return float(np.mean([np.sqrt(np.square(at[rows] - at[rows].mean(0)).sum(1).mean()) for rows in pieces]))

    return spread if pieces else lambda _: 1.0


def _neck(parts: Parts, operation: str, factor: float) -> Moved:
    body, head = parts.body, parts.head
    if operation == "fat":
        return _round(body, head, factor)
    length = max(head.neck_length, 0.12 * body.diagonal)
    points = body.points + (ease(head.neck) * (factor - 1) * length)[:, None] * head.up
    weight = 4 * head.neck * (1 - head.neck)
    top, low = head.neck > 0.95, head.neck < 0.05
    reach = length / max(float(head.up @ head.up), 1e-12)

    def measure(at: Floats) -> float:
        if not top.any() or not low.any():
            return 1.0
        apart = (at[top].mean(0) - at[low].mean(0)) @ head.up
        before = (body.points[top].mean(0) - body.points[low].mean(0)) @ head.up
        return float(reach + apart - before)

    return Moved(points, weight, measure, head.found_by)


def _round(body: Body, head: Head, factor: float) -> Moved:
    """Return a neck with another girth."""
    weight = np.clip(4 * head.neck * (1 - head.neck), 0, 1)
    arms = body.points - head.pivot
    across = arms - (arms @ head.up)[:, None] * head.up
    return Moved(body.points + (weight * (factor - 1))[:, None] * across, weight, _spread(body, weight), head.found_by)


def _tail(parts: Parts, operation: str, factor: float) -> Moved:
    body, tail = parts.body, parts.tail
    along = tail.length - tail.from_tip
    line = _centre_line(along, body.points, tail.weight, (0.0, tail.length))
    here = line(np.clip(along, 0, tail.length))
    if operation in ("fat", "wide"):
        band = step(along / (0.3 * tail.length))
        points = body.points + (tail.weight * band * (factor - 1))[:, None] * (body.points - here)
        return Moved(points, tail.weight, _spread(body, tail.weight * band), tail.found_by)
    root = line(np.zeros(1))
    points = body.points + (tail.weight * (factor - 1))[:, None] * (here - root)
    tip, foot = int(np.argmin(tail.from_tip)), root[0]
    return Moved(points, tail.weight, lambda at: float(np.linalg.norm(at[tip] - foot)), tail.found_by)


def _arm(parts: Parts, operation: str, factor: float) -> Moved:
    """Return arms that are longer to the wrist, hands as they are; or thicker."""
    body, arm = parts.body, parts.arms
    points, measures = body.points.copy(), []
    for sign in (-1, 1):
        weight = np.where(sign * (body.points[:, body.lateral] - body.middle) > 0, arm.weight, 0)
        own = weight > 0.5
        if own.sum() < 6:
            continue
        root = attachment(body, weight)
        axis = body.points[own].mean(0) - root
        axis /= max(float(np.linalg.norm(axis)), 1e-12)
        along = (body.points - root) @ axis
        length = float(np.percentile(along[own], 99))
        if length <= 0:
            continue
        if operation == "long":
            share = ease(along / (0.8 * length), 0.15)
            points += (weight * share * (factor - 1) * length)[:, None] * axis
            measures.append((int(np.argmax(np.where(own, along, -np.inf))), root, axis))
        else:
            line = _centre_line(along, body.points, weight, (0.0, length), degree=3)
            band = step(along / (0.25 * length)) * (1 - 0.75 * step((along - 0.7 * length) / (0.2 * length)))
            if operation == "big":
                band = np.ones_like(band)
            across = body.points - line(along)
            across -= (across @ axis)[:, None] * axis
            points += (weight * band * (factor - 1))[:, None] * across
            if operation == "big":
                points += (weight * (factor - 1) * np.maximum(along, 0))[:, None] * axis
    if operation != "long" or not measures:
        return Moved(points, arm.weight, _spread(body, arm.weight), arm.found_by)
    return Moved(
        points,
        arm.weight,
        lambda at: float(np.mean([(at[tip] - root) @ axis for tip, root, axis in measures])),
        arm.found_by,
    )


def _wheel(parts: Parts, operation: str, factor: float) -> Moved | None:
    """Return bigger wheels, each about its own middle, and what stands on them lifted."""
    if operation != "big":
        return None
    body, part = parts.body, parts.wheel_parts()
    wheels = part.weight > 0.5
    points, lift = body.points.copy(), 0.0
    for component in body.groups(wheels):
        own = body.points[component]
        middle = (own.max(0) + own.min(0)) / 2
        points[component] = middle + factor * (own - middle)
        lift = (
            max(lift, (factor - 1) * float(np.ptp(own[:, UP])) / 2)
            if factor > 1
            else min(lift, (factor - 1) * float(np.ptp(own[:, UP])) / 2)
        )
    points[:, UP] += lift
    return Moved(
        points, part.weight, lambda at: float(np.mean([np.ptp(at[c, UP]) for c in body.groups(wheels)])), "components"
    )


def _slab(parts: Parts, operation: str, factor: float) -> Moved:
    """Return a seat or a top that is thicker; wider or longer ones take along what they carry."""
    body = parts.body
    low, high = parts.slab
    within = ((body.points[:, UP] >= low) & (body.points[:, UP] <= high)).astype(float)
    if operation in ("wide", "long"):
        moved = _whole(parts, operation, factor)
        return Moved(moved.points, within, moved.length, "geometry")
    if operation == "big":
        points = _resized(parts, 0, factor)
        points[:, 2] = _resized(parts, 2, factor)[:, 2]
        return Moved(points, within, lambda at: float(np.ptp(at[:, 0]) + np.ptp(at[:, 2])), "geometry")
    points = body.points.copy()
    points[:, UP] += (factor - 1) * np.clip(points[:, UP] - low, 0, high - low)
    inside = within > 0
    return Moved(points, within, lambda at: float(np.ptp(at[inside, UP])), "geometry")


def _back(parts: Parts, operation: str, factor: float) -> Moved | None:
    if parts.rigged or operation not in ("tall", "long", "big"):
        return None
    back = parts.back()
    seat = float(back.pivot[UP])
    points = parts.body.points.copy()
    points[:, UP] += (factor - 1) * np.maximum(points[:, UP] - seat, 0)
    return Moved(points, back.weight, lambda at: float(at[:, UP].max() - seat), "geometry")


def _limb(limb: Limb, operation: str, factor: float) -> Moved:
    """Return a named part changed about where it is attached; each of several pieces, such as ears, about its own."""
    body, points = limb.body, limb.body.points.copy()
    pieces, numbers, pivots = limb.pieces
    for number, pivot in enumerate(pivots):
        weight = np.where(numbers == number, limb.weight, 0)
        arms = body.points - pivot
        if operation == "big":
            moved = arms
        elif operation in ("tall", "wide"):
            moved = np.zeros_like(arms)
            axis = UP if operation == "tall" else body.lateral
            moved[:, axis] = arms[:, axis]
        else:
            axis_of = body.points[pieces[number]].mean(0) - pivot
            if np.linalg.norm(axis_of) < 0.1 * np.linalg.norm(np.ptp(body.points[pieces[number]], axis=0)):
                spread = body.points[pieces[number]] - body.points[pieces[number]].mean(0)
                axis_of = np.linalg.svd(spread, full_matrices=False)[2][0]
            axis_of = axis_of / np.linalg.norm(axis_of)
            along = (arms @ axis_of)[:, None] * axis_of
            moved = along if operation == "long" else arms - along
        points += (weight * (factor - 1))[:, None] * moved
    return Moved(points, limb.weight, _spread(body, limb.weight), limb.found_by)


# ---------------------------------------------------------------- fat and thin


@dataclass(frozen=True)
class _Shares:
    """How much of each vertex (V,) belongs to each kind of part; they add up to 1."""

    head: Floats
    neck: Floats
    tail: Floats
    leg: Floats
    arm: Floats
    trunk: Floats


def _shares(parts: Parts, legs: Legs | None) -> _Shares:
    body, none = parts.body, np.zeros(len(parts.body.points))

    def joined(rounds: int, *names: str) -> Floats:
        flags = [parts.of_class(name) for name in names]
        return body.smooth(sum((each for each in flags if each is not None), none), rounds)

    leg = none if legs is None else legs.weight
    if parts.rigged:
        head, neck, tail, arm = joined(4, "head", "ear"), joined(4, "neck"), joined(4, "tail"), joined(3, "arm")
    else:
        neck = arm = none
        head = _or_none(lambda: parts.head.weight, none)
        tail = _or_none(lambda: parts.tail.weight, none)
        if legs is not None:
            leg = leg * step((legs.hip - body.points[:, UP]) / (0.75 * (legs.hip - body.ground)))
    leg = np.clip(leg * (1 - np.clip(head + tail, 0, 1)), 0, 1)
    arm = np.clip(arm * (1 - leg), 0, 1)
    if legs is None:  # of a fish or a duck, the tail is where the trunk ends
        tail = none
    trunk = np.clip(1 - head - neck - tail - leg - arm, 0, 1)
    total = np.maximum(head + neck + tail + leg + arm + trunk, 1e-9)
    return _Shares(*(each / total for each in (head, neck, tail, leg, arm, trunk)))


def _or_none(find: Callable[[], Floats], none: Floats) -> Floats:
    try:
        return find()
    except PartMissingError:
        return none


class _Belly:
    """How the trunk's sections grow: its axis, its centre line, and where it is fattest."""

    def __init__(self, body: Body, shares: _Shares, legs: Legs | None, factor: float) -> None:
        self._body, self.legs = body, legs
        own = body.points[shares.trunk > 0.6]
        if not len(own):
            own = body.points
        extent = np.ptp(own, axis=0)
        self.upright = bool(extent[UP] > 1.25 * extent[body.front])
        self.axis, self.across = (UP, body.front) if self.upright else (body.front, UP)
        self.low, self.high = float(own[:, self.axis].min()), float(own[:, self.axis].max())
        self._line = _centre_line(
            body.points[:, self.axis], body.points[:, [self.across]], shares.trunk, (self.low, self.high), bins=14
        )
        self.drop = 0.8
        if legs is not None and not self.upright and factor > 1:
            depth = float(np.max(self._line(own[:, self.axis])[:, 0] - own[:, UP]))
            self.drop = min(0.8, 0.36 * (legs.hip - body.ground) / max((factor - 1) * depth, 1e-9))

    def outward(self, places: Floats) -> Floats:
        """Return the displacements (N, 3) of sections that double."""
        body, moved = self._body, np.zeros_like(places)
        moved[:, body.lateral] = places[:, body.lateral] - body.middle
        over = places[:, self.across] - self._line(places[:, self.axis])[:, 0]
        rise = 0.8 if self.legs is None else 0.35
        moved[:, self.across] = over * (0.9 if self.upright else np.where(over < 0, self.drop, rise))
        return moved

    def fatness(self, places: Floats) -> Floats:
        """Return how much of the change each place (N,) takes: most in the middle."""
        t = (places[:, self.axis] - self.low) / max(self.high - self.low, 1e-12)
        if self.upright:
            return np.asarray(0.35 + 0.65 * np.exp(-(((t - 0.32) / 0.33) ** 2)))
        if self.legs is None:
            return np.asarray(0.2 + 0.8 * np.exp(-(((t - 0.42) / 0.4) ** 2)))
        return np.asarray(0.55 + 0.45 * np.exp(-(((t - 0.45) / 0.32) ** 2)))


def _fat(parts: Parts, factor: float) -> Moved:
    """Scale sections about each part's own centre line, most at the belly; limbs are carried by what they hang on."""
    body = parts.body
    if parts.wheels.any():
        raise PartMissingError('Things on wheels are not fat or thin: say "wider" or "narrower".')
    if parts.built:
        return _fat_thing(parts, factor)
    try:
        legs: Legs | None = parts.legs
    except PartMissingError:
        legs = None
    if legs is None and not parts.rigged and _is_boxy(body):
        return _fat_thing(parts, factor)
    shares = _shares(parts, legs)
    amount = factor - 1
    belly = _Belly(body, shares, legs, factor)
    outward = belly.outward(body.points)
    moved = (shares.trunk * amount * belly.fatness(body.points))[:, None] * outward
    for weight, less in ((shares.head, 0.25), (shares.neck, 0.5), (shares.tail, 0.25)):
        if weight.max() > 0.2:
            along = outward * amount * less
            if not belly.upright:  # what hangs on the trunk is lifted as a whole
                root = attachment(body, weight)[None]
                along[:, belly.across] = 0
                if legs is None:
                    along[:, UP] = amount * belly.outward(root)[0, UP] * belly.fatness(root)[0]
            moved += weight[:, None] * along
    if legs is not None and shares.leg.max() > 0.3:
        moved += _fat_legs(body, legs, shares.leg, belly, amount)
    if shares.arm.max() > 0.3:
        moved += _fat_arms(body, shares.arm, belly, amount)
    if legs is not None:  # nothing sinks into the ground
        height = 0.8 * (legs.hip - body.ground)
        moved[:, UP] *= np.where(moved[:, UP] < 0, step((body.points[:, UP] - body.ground) / max(height, 1e-12)), 1)
    fattest = np.flatnonzero((shares.trunk > 0.8) & (belly.fatness(body.points) > 0.9))
    if not len(fattest):
        fattest = np.arange(len(body.points))
    return Moved(body.points + moved, np.ones(len(moved)), lambda at: float(np.ptp(at[fattest, body.lateral])), "")


def _fat_thing(parts: Parts, factor: float) -> Moved:
    """Return a thing of plates that is wider and deeper, with thicker legs if it stands on some."""
    body = parts.body
    with suppress(PartMissingError):
        parts = Parts(body.moved(_leg(parts, "fat", factor).points))
    points = _resized(parts, 0, factor)
    points[:, 2] = _resized(parts, 2, factor)[:, 2]
    return Moved(points, np.ones(len(points)), lambda at: float(np.ptp(at[:, 0]) + np.ptp(at[:, 2])))


def _is_boxy(body: Body) -> bool:
    """Return whether nearly all of the surface is level or upright along an axis, as shelves are."""
    _, normals = body.samples(_SAMPLES)
    return bool((np.abs(normals).max(axis=1) > _ALONG_AN_AXIS).mean() > _BOXY)


def _fat_legs(body: Body, legs: Legs, share: Floats, belly: _Belly, amount: float) -> Floats:
    moved = np.zeros_like(body.points)
    for weight, line in _leg_lines(body, replace(legs, weight=share), degree=3):
        heights = body.points[weight > 0.05, UP]
        low, high = float(heights.min()), float(heights.max())
        place = np.zeros((1, 3))
        place[0, [body.lateral, body.front]] = line(np.array([high]))[0]
        place[0, UP] = high
        shift = 0.75 * amount * float(belly.outward(place)[0, body.lateral] * belly.fatness(place)[0])
        t = (body.points[:, UP] - low) / max(high - low, 1e-12)
        grown = 0.45 * amount * step((t - 0.04) / 0.16) * (0.6 + 0.4 * step(t / 0.8))
        centre = line(body.points[:, UP])
        own = np.zeros_like(moved)
        own[:, body.lateral] = shift + grown * (body.points[:, body.lateral] - centre[:, 0])
        own[:, body.front] = grown * (body.points[:, body.front] - centre[:, 1])
        moved += weight[:, None] * own
    return moved


def _fat_arms(body: Body, share: Floats, belly: _Belly, amount: float) -> Floats:
    moved = np.zeros_like(body.points)
    for sign in (-1, 1):
        weight = np.where(sign * (body.points[:, body.lateral] - body.middle) > 0, share, 0)
        own = weight > 0.5
        if own.sum() < 6:
            continue
        spread = np.ptp(body.points[own, body.lateral]) > np.ptp(body.points[own, UP])
        axis = body.lateral if spread else UP
        across = [a for a in range(3) if a != axis]
        along = np.abs(body.points[:, body.lateral] - body.middle) if spread else -body.points[:, UP]
        low, high = float(along[own].min()), float(along[own].max())
        line = _centre_line(along, body.points[:, across], weight, (low, high), degree=3, bins=10)
        place = np.zeros((1, 3))
        place[0, across] = line(np.array([low]))[0]
        place[0, axis] = body.middle + sign * low if spread else -low
        shift = amount * float(belly.outward(place)[0, body.lateral] * belly.fatness(place)[0])
        grown = 0.5 * amount * (1 - 0.75 * step((along - low) / max(0.75 * (high - low), 1e-12)))
        centre, changed = line(along), np.zeros_like(moved)
        changed[:, body.lateral] += shift
        for k, a in enumerate(across):
            changed[:, a] += grown * (body.points[:, a] - centre[:, k])
        moved += weight[:, None] * changed
    return moved
