"""Carry out the changes of a sentence on a body, one after the other, and check what came of each.

A face that flips is smoothed with its neighbours; where that does not help, the factor is halved, and a warning says
so. The result is as symmetric as the source, and stands where it stood. A vertex on an edge of another face follows
that edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshdeform.geometry.junctions import Junctions
from meshdeform.plain.body import UP, Body, Flags, Floats
from meshdeform.plain.maps import Moved, move
from meshdeform.plain.parts import PartMissingError, Parts
from meshdeform.plain.words import SHAPES, WHOLE, Change, Sentence

_ROUNDS = 12
_ATTEMPTS = ((0.0, 1.0), (0.5, 1.0), (1.0, 1.0), (1.0, 0.5), (1.0, 0.25), (1.0, 0.125))
"""How evenly a change is spread, and which share of it is made, until no face flips."""
_MOST_CORRECTED = 1.7
"""Greatest share of what was asked for that a map may be given, so that its result is what was asked for."""
_ON_ORIGIN = 0.01
"""Height of the lowest point, as a share of the body's, up to which it stands on the origin."""
_TOLD_APART = 0.25
"""Share of what was asked for below which a part was found that is none."""
_SHORT = 0.5
"""Share of what was asked for below which a warning says that there was less."""
_LOPSIDED = frozenset({"leaning", "bent", "twisted"})
_TURNING = frozenset({"bent", "twisted"})


@dataclass(frozen=True)
class Done:
    """A change that was carried out."""

    change: Change
    found_by: str  # how its part was found: `joints`, `names`, `components` or `geometry`; empty for the whole
    factor: float  # the factor of the map, halved where faces would have flipped
    got: float  # how much of what it measures grew
    flips: int  # faces that it flipped all the same

    @property
    def warnings(self) -> list[str]:
        """Sentences about what is less than was asked for."""
        requested, what = self.change.factor, _phrase(self.change)
        warnings = []
        if self.factor != requested:
            warnings.append(f"{what}: {requested:.2f} would flip faces, so it was {self.factor:.2f}.")
        elif (
            requested not in (0, 1)
            and self.change.operation not in SHAPES
            and (self.got - 1) / (requested - 1) < _SHORT
        ):
            warnings.append(
                f"{what}: {requested:.2f} was asked for, and {self.got:.2f} came of it. Where triangles are large, "
                "output.subdivide helps."
            )
        if self.flips:
            warnings.append(f"{what}: {self.flips} faces were flipped.")
        return warnings

    def to_dict(self) -> dict[str, str | float | int]:
        """Return its entry in the report."""
        return {
            "operation": self.change.operation,
            "part": self.change.part,
            "found_by": self.found_by,
            "asked": round(self.change.factor, 4),
            "factor": round(self.factor, 4),
            "got": round(self.got, 4),
            "flips": self.flips,
        }


def _phrase(change: Change) -> str:
    return change.operation if change.part == WHOLE else f"{change.operation} ({change.part})"


def apply_changes(body: Body, changes: Sequence[Change]) -> tuple[Body, list[Done]]:
    """Carry out changes in their order.

    Raises PartMissingError: a part is not there; nothing is changed.
    """
    done = []
    junctions = Junctions.of(body.points, body.faces)
    for change in changes:
        body, each = _apply(body, change, junctions)
        done.append(each)
    return body, done


def meant(body: Body, sentence: Sentence) -> tuple[Change, ...]:
    """Return the changes of a sentence: in "a bigger helmet", of a part of the asset that has the noun as its name."""
    if sentence.noun is None or not sentence.compared:
        return sentence.changes
    try:
        Parts(body).named(sentence.noun.replace("-", " "))
    except PartMissingError:
        return sentence.changes
    return tuple(replace(each, part=sentence.noun) if each.part == WHOLE else each for each in sentence.changes)


def missing_part(body: Body, changes: Sequence[Change]) -> str | None:
    """Return why a change cannot be carried out; None if all can."""
    parts = Parts(body)
    try:
        for change in changes:
            calibrated(parts, change)
    except PartMissingError as error:
        return str(error)
    return None


def _apply(body: Body, change: Change, junctions: Junctions) -> tuple[Body, Done]:
    parts = Parts(body)
    full = calibrated(parts, change)
    for parts.even, share in _ATTEMPTS:
        moved = move(parts, change, _part_of_way(change, full, share))
        points = junctions.closed(body.points, _settled(body, change, moved))
        points, flipped = _relaxed(body, points, _flipped(body, points, change), change, junctions)
        if not flipped.any():
            break
    before = moved.length(body.points)
    got = moved.length(points) / before if before and change.operation not in SHAPES else change.factor * share
    factor = _part_of_way(change, change.factor, share)
    return body.moved(points), Done(change, moved.found_by, factor, float(got), int(flipped.sum()))


def _part_of_way(change: Change, factor: float, share: float) -> float:
    """Return the factor of a share of the way from no change."""
    return factor * share if change.operation in SHAPES else 1 + share * (factor - 1)


def calibrated(parts: Parts, change: Change) -> float:
    """Return the factor with which a map gives what was asked for: bands take something away.

    Raises PartMissingError: the part is not there, or cannot be told from the rest.
    """
    factor, requested = change.factor, change.factor
    if change.operation in SHAPES or abs(requested - 1) < 0.02:
        return factor
    for _ in range(2):
        moved = move(parts, change, factor)
        before = moved.length(parts.body.points)
        grown = moved.length(_settled(parts.body, change, moved)) / before - 1 if before else 0.0
        if change.part != WHOLE and grown / (requested - 1) < _TOLD_APART:
            raise PartMissingError(f"The {change.part} cannot be told from the rest well enough to change it.")
        if abs(grown - (requested - 1)) < 0.01 or grown * (requested - 1) <= 0:
            break
        most = _MOST_CORRECTED * abs(requested - 1)
        factor = 1 + float(np.clip((factor - 1) * (requested - 1) / grown, -min(most, 0.9), most))
    return factor


def _settled(body: Body, change: Change, result: Moved) -> Floats:
    """Return the points as symmetric as the source, and on the same ground if what stands on it was changed."""
    moved = result.points - body.points
    points = body.points + (moved if change.operation in _LOPSIDED else body.symmetric(moved))
    # Swimming and hanging things have no ground to sink into.
    grounded = change.operation != "fat" or abs(body.ground) <= _ON_ORIGIN * body.size[UP]
    if grounded and change.part in (WHOLE, "leg", "foot", "wheel", "base"):
        points[:, UP] += body.ground - points[:, UP].min()
    return points


def _flipped(body: Body, points: Floats, change: Change) -> Flags:
    """Return which faces (F,) turned over; those of a turning map turn with it."""
    if change.operation in _TURNING:
        return np.zeros(len(body.faces), bool)
    a, b, c = points[body.faces].transpose(1, 0, 2)
    thick = np.linalg.norm(body.crosses, axis=1) > 1e-9 * body.diagonal**2
    return np.asarray(thick & (np.einsum("fi,fi->f", np.cross(b - a, c - a), body.crosses) < 0))


def _relaxed(body: Body, points: Floats, flipped: Flags, change: Change, junctions: Junctions) -> tuple[Floats, Flags]:
    """Return the points with displacements smoothed around flipped faces, and which are still flipped."""
    degree = np.maximum(np.asarray(body.edges.sum(1)).ravel(), 1)
    moved = points - body.points
    for _ in range(_ROUNDS):
        if not flipped.any():
            break
        around = np.zeros(len(points), bool)
        around[body.faces[flipped].ravel()] = True
        around |= (body.edges @ around.astype(float)) > 0
        mean = (body.edges @ moved) / degree[:, None]
        moved[around] = 0.5 * (moved[around] + mean[around])
        moved = junctions.carried(moved)
        flipped = _flipped(body, body.points + moved, change)
    return body.points + moved, flipped
