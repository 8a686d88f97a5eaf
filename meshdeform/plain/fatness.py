"""Make bodies fat or thin: sections scale about each part's own centre line, most at the belly, and no lengths.

Limbs and heads are carried by what they hang on. A belly alone takes its share where the trunk is fattest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from meshdeform.plain.body import UP, Body, Floats, step
from meshdeform.plain.limbs import centre_line, leg_lines
from meshdeform.plain.moved import MeasuredPiece, Moved
from meshdeform.plain.parts import BodyParts, Legs
from meshdeform.plain.pieces import PartMissingError, attachment
from meshdeform.plain.read_parts import READ


@dataclass(frozen=True)
class _Shares:
    """How much of each vertex (V,) belongs to each kind of part; they add up to 1."""

    head: Floats
    neck: Floats
    tail: Floats
    leg: Floats
    arm: Floats
    trunk: Floats


def _shares(parts: BodyParts, legs: Legs | None) -> _Shares:
    body, none = parts.body, np.zeros(len(parts.body.points))

    def joined(rounds: int, *names: str) -> Floats:
        flags = [parts.joints.of_class(name) for name in names]
        return body.smooth(sum((each for each in flags if each is not None), none), rounds)

    leg = none if legs is None else legs.weight
    if parts.rigged:
        head, neck, tail, arm = joined(4, "head", "ear"), joined(4, "neck"), joined(4, "tail"), joined(3, "arm")
    else:
        neck, arm = none, _or_none(lambda: parts.arms.weight, none)
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
        self._line = centre_line(
            body.points[:, self.axis], body.points[:, [self.across]], shares.trunk, (self.low, self.high), bins=14
        )
        self.drop = 0.8
        if legs is not None and not self.upright and factor > 1:
            depth = float(np.max(self._line(own[:, self.axis])[:, 0] - own[:, UP]))
            self.drop = min(0.8, 0.36 * (legs.hip - body.ground) / max((factor - 1) * depth, 1e-9))

    def outward(self, points: Floats) -> Floats:
        """Return the displacements (N, 3) of sections that double."""
        body, moved = self._body, np.zeros_like(points)
        moved[:, body.lateral] = points[:, body.lateral] - body.middle
        over = points[:, self.across] - self._line(points[:, self.axis])[:, 0]
        rise = 0.8 if self.legs is None else 0.35
        moved[:, self.across] = over * (0.9 if self.upright else np.where(over < 0, self.drop, rise))
        return moved

    def bulge(self, points: Floats) -> Floats:
        """Return how much of a change of the belly alone each point (N,) takes."""
        t = (points[:, self.axis] - self.low) / max(self.high - self.low, 1e-12)
        return np.asarray(
            np.exp(-(((t - (0.32 if self.upright else 0.45)) / 0.3) ** 2)) * step(t / 0.15) * step((1 - t) / 0.15)
        )

    def fatness(self, points: Floats) -> Floats:
        """Return how much of the change each point (N,) takes: most in the middle."""
        t = (points[:, self.axis] - self.low) / max(self.high - self.low, 1e-12)
        if self.upright:
            return np.asarray(0.35 + 0.65 * np.exp(-(((t - 0.32) / 0.33) ** 2)))
        if self.legs is None:
            return np.asarray(0.2 + 0.8 * np.exp(-(((t - 0.42) / 0.4) ** 2)))
        return np.asarray(0.55 + 0.45 * np.exp(-(((t - 0.45) / 0.32) ** 2)))


def belly(parts: BodyParts, direction: str, factor: float) -> Moved:
    """Return the trunk with another girth where it is fattest; limbs and what lies above and below stay where they are.

    Raises PartMissingError: it is nothing with a belly.
    """
    body = parts.body
    if not parts.is_living:
        raise PartMissingError("No belly was found: this is no body of a person or an animal.")
    legs = _legs_or_none(parts)
    shares = _shares(parts, legs)
    trunk = _Belly(body, shares, legs, factor)
    amount = shares.trunk * trunk.bulge(body.points)
    outward = trunk.outward(body.points)
    if direction == "side":
        outward[:, trunk.across] = 0
    fattest = np.flatnonzero((shares.trunk > 0.8) & (trunk.bulge(body.points) > 0.7))
    if len(fattest) < 3:
        raise PartMissingError("No belly was found: the trunk has too few vertices there.")
    asked = tuple(axis == body.lateral or (axis == trunk.across and direction != "side") for axis in range(3))
    found_by = "joints" if parts.rigged else READ
    measured = [MeasuredPiece(fattest, np.eye(3), (asked[0], asked[1], asked[2]))]
    return Moved(
        body.points + (amount * (factor - 1))[:, None] * outward,
        amount,
        lambda at: float(np.ptp(at[fattest, body.lateral])),
        found_by,
        measured,
    )


def _legs_or_none(parts: BodyParts) -> Legs | None:
    try:
        return parts.legs
    except PartMissingError:
        return None


def fat(parts: BodyParts, factor: float) -> Moved:
    """Scale sections about each part's own centre line, most at the belly; limbs are carried by what they hang on."""
    body = parts.body
    legs = _legs_or_none(parts)
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


def _fat_legs(body: Body, legs: Legs, share: Floats, belly: _Belly, amount: float) -> Floats:
    moved = np.zeros_like(body.points)
    for weight, line in leg_lines(body, replace(legs, weight=share), degree=3):
        heights = body.points[weight > 0.05, UP]
        low, high = float(heights.min()), float(heights.max())
        point = np.zeros((1, 3))
        point[0, [body.lateral, body.front]] = line(np.array([high]))[0]
        point[0, UP] = high
        shift = 0.75 * amount * float(belly.outward(point)[0, body.lateral] * belly.fatness(point)[0])
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
        line = centre_line(along, body.points[:, across], weight, (low, high), degree=3, bins=10)
        point = np.zeros((1, 3))
        point[0, across] = line(np.array([low]))[0]
        point[0, axis] = body.middle + sign * low if spread else -low
        shift = amount * float(belly.outward(point)[0, body.lateral] * belly.fatness(point)[0])
        grown = 0.5 * amount * (1 - 0.75 * step((along - low) / max(0.75 * (high - low), 1e-12)))
        centre, changed = line(along), np.zeros_like(moved)
        changed[:, body.lateral] += shift
        for k, a in enumerate(across):
            changed[:, a] += grown * (body.points[:, a] - centre[:, k])
        moved += weight[:, None] * changed
    return moved
