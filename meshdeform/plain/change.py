"""Carry out the changes of a sentence on a body, one after the other, and measure what came of each.

What is affine is exactly that. Elsewhere, a face that flips is smoothed with its neighbours; where that does not help,
less of the change is made, and a warning says so. The result is as symmetric as the source, unless a side was asked
for, and stands where it stood. A vertex on an edge of another face follows that edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from meshdeform.errors import PromptError
from meshdeform.geometry.junctions import Junctions
from meshdeform.geometry.slivers import along_slivers
from meshdeform.plain import effect, table
from meshdeform.plain.body import UP, Body, Flags, Floats
from meshdeform.plain.effect import Effect
from meshdeform.plain.maps import move
from meshdeform.plain.moved import Moved
from meshdeform.plain.parts import LIVING, BodyParts
from meshdeform.plain.pieces import PartMissingError
from meshdeform.plain.table import SHAPES, WHOLE
from meshdeform.plain.words import Change, Sentence, check_factor

_ROUNDS = 12
_SHARES = (1.0, 0.75, 0.5, 0.35, 0.25, 0.125)
"""Which share of a change is made, until no face flips."""
_MOST_CORRECTED = 1.7
"""Greatest share of what was asked for that a map may be given, so that its result is what was asked for."""
_ON_ORIGIN = 0.01
"""Height of the lowest point, as a share of the body's, up to which it stands on the origin."""
_STANDING = (WHOLE, "leg", "foot", "wheel", "base")
"""What the rest stands on."""
_SUNK, _OUTSIDE = 0.002, 0.02
"""Depth below the ground, as a share of the diagonal, from which something is there; weight below which a vertex is of
the rest."""
_TOLD_APART = 0.25
"""Share of what was asked for below which a part was found that is none."""
_LOPSIDED = frozenset({"leaning", "bent", "twisted"})
_TURNING = frozenset({"bent", "twisted"})
_WORDS = {
    "long": "long",
    "big": "large",
    "tall": "tall",
    "wide": "wide",
    "fat": "thick",
    "deep": "deep",
    "high": "high",
}


@dataclass(frozen=True)
class Done:
    """A change that was carried out."""

    change: Change
    found_by: str  # how its part was found: `given`, `joints`, `names` or `shapes`; empty for the whole
    factor: float  # the factor of the map, less where faces would have flipped
    got: float  # how much of what it measures grew
    flips: int  # faces that it flipped all the same
    effect: Effect
    affine: Floats | None = None  # (3, 4) float64: the map of all points, if it is one
    kept_above: bool = False  # whether it would have reached below the ground on which the rest stands

    @property
    def held_back(self) -> bool:
        """Whether less was made than was asked for, so that no face flips."""
        return f"{self.factor:.2f}" != f"{self.change.factor:.2f}"

    @property
    def warnings(self) -> list[str]:
        """Sentences about faces that would flip, or do."""
        change, what = self.change, "All of it" if self.change.part == WHOLE else f"The {self.change.name}"
        asked, made = f"{change.factor:.2f}", f"{self.factor:.2f}"
        warnings = []
        if self.held_back:
            word = _WORDS.get(change.operation)
            got = f"{change.operation} by {made}" if word is None else f"{made} times as {word}"
            warnings.append(f"{what}: {got}, not {asked}, which would flip faces.")
        if self.flips:
            warnings.append(f"{what}: {self.flips} faces were flipped.")
        if self.kept_above:
            warnings.append(f"{what}: less of it went down, since it would reach below the ground.")
        return warnings

    @property
    def doubts(self) -> list[str]:
        """Sentences, with figures, about what the result has too little or too much of."""
        change = self.change
        if change.operation in SHAPES or change.factor == 1:
            return []
        return self.effect.doubts(change.name, change.factor, _WORDS[change.operation])

    def turned_back(self, turn: Floats) -> Self:
        """Return it for a body that was stood up by a rotation (3, 3) before it was changed."""
        return self if self.affine is None else replace(self, affine=turn.T @ self.affine @ _with_shift(turn))

    def to_dict(self) -> dict[str, str | float | int | None]:
        """Return its entry in the report."""
        grown = self.effect.grown
        return {
            "operation": self.change.operation,
            "part": self.change.name,
            "found_by": self.found_by,
            "asked": round(self.change.factor, 4),
            "factor": round(self.factor, 4),
            "got": round(self.got, 4),
            "grown": None if grown is None else round(grown, 4),
            "other": round(self.effect.other, 4),
            "rest": round(self.effect.rest, 4),
            "flips": self.flips,
        }


def _with_shift(turn: Floats) -> Floats:
    """Return a rotation as (4, 4)."""
    whole = np.eye(4)
    whole[:3, :3] = turn
    return whole


def apply_changes(body: Body, changes: Sequence[Change]) -> tuple[Body, list[Done]]:
    """Carry out changes in their order.

    Raises PartMissingError: a part is not there; nothing is changed. Raises PromptError: a length is asked for of what
    has no unit, or one that is too far from what is there.
    """
    done = []
    standing = after = body.upright()
    junctions = Junctions.of(standing.points, standing.faces)
    for change in changes:
        after, each = _apply(after, change, junctions)
        done.append(each)
    if standing.turn is None:
        return after, done
    moved = (after.points - standing.points) @ standing.turn
    return body.moved(body.points + moved), [each.turned_back(standing.turn) for each in done]


def affine_of(done: Sequence[Done]) -> Floats | None:
    """Return the affine map (3, 4) that changes are together; None if one is no affine map."""
    total = np.eye(4)
    for each in done:
        if each.affine is None:
            return None
        total = np.vstack([each.affine, [0, 0, 0, 1]]) @ total
    return total[:3]


def meant(body: Body, sentence: Sentence) -> tuple[Change, ...]:
    """Return the changes of a sentence: in "a bigger helmet", of a part of the asset that has the noun as its name.

    Raises PartMissingError: a skeleton shows that the asset is not what the sentence calls it.
    """
    return meant_of(BodyParts(body.upright()), sentence)


def meant_of(parts: BodyParts, sentence: Sentence) -> tuple[Change, ...]:
    """Return the changes of a sentence as `meant`, of a body that stands."""
    noun = sentence.noun
    if noun is None or not sentence.compared:
        return tuple(
            replace(each, part=parts.spelled(each.part)) if each.part != WHOLE else each for each in sentence.changes
        )
    if not _is_part_of(parts, noun):
        if parts.rigged and noun not in LIVING:
            raise PartMissingError(f"No part called {noun!r} was found, and the asset is a body.")
        return sentence.changes
    changed = []
    for each in sentence.changes:
        operation = table.meaning(each.operation, noun)
        possible = each.part == WHOLE and table.direction(operation, noun) is not None
        changed.append(replace(each, part=noun, operation=operation) if possible else each)
    return tuple(changed)


def _is_part_of(parts: BodyParts, noun: str) -> bool:
    """Return whether a noun is a part of the asset: a bus has lamps, and is none."""
    word = noun.replace("-", " ")
    return parts.is_told(word) or (parts.has(word) and parts.read.noun != noun)


def missing_part(body: Body, sentence: Sentence) -> str | None:
    """Return why a change of a sentence cannot be carried out; None if all can.

    Raises PromptError: as `apply_changes`.
    """
    parts = BodyParts(body.upright())
    try:
        for change in meant_of(parts, sentence):
            calibrated(parts, _in_factors(parts, change))
    except PartMissingError as error:
        return str(error)
    return None


@dataclass(frozen=True)
class _Attempt:
    """What a change makes of a body."""

    moved: Moved
    points: Floats
    flipped: Flags
    share: float  # of the way that is made
    kept_above: bool = False

    @classmethod
    def of(cls, body: Body, change: Change, junctions: Junctions) -> Self:
        """Make as much of a change as flips no face."""
        parts = BodyParts(body)
        full = calibrated(parts, change)
        kept_above = False
        for share in _SHARES:
            moved = move(parts, change, _part_of_way(change, full, share))
            points, flipped = moved.points, np.zeros(len(body.faces), bool)
            if moved.affine is not None:
                break
            settled = _settled(body, change, moved)
            points = _above_ground(parts, change, moved, settled)
            kept_above = points is not settled
            points = junctions.closed(body.points, points)
            points, flipped = _relaxed(body, points, _flipped(body, points, change), change, junctions)
            if not flipped.any() or change.operation in _TURNING:
                break
        return cls(moved, points, flipped, share, kept_above)


def _apply(body: Body, change: Change, junctions: Junctions) -> tuple[Body, Done]:
    change = _in_factors(BodyParts(body), change)
    made = _Attempt.of(body, change, junctions)
    if change.part == WHOLE and body.joints and made.share < 1:
        # Skeletons of many bones divide a body where its shape does not.
        made = max(made, _Attempt.of(body.without_joints(), change, junctions), key=lambda each: each.share)
    moved, points = made.moved, made.points
    before = moved.length(body.points)
    got = moved.length(points) / before if before and change.operation not in SHAPES else change.factor * made.share
    factor = _part_of_way(change, change.factor, made.share)
    measured = effect.measure(body, moved, points)
    if measured.grown is None and change.operation not in SHAPES:
        # A neck, a height and a belly have measures of their own.
        measured = replace(measured, grown=float(got))
    flips = int(made.flipped.sum())
    done = Done(change, moved.found_by, factor, float(got), flips, measured, moved.affine, made.kept_above)
    return body.moved(points), done


def _in_factors(parts: BodyParts, change: Change) -> Change:
    """Return a change with the factor that a length in metres is on the body.

    Raises PromptError: the asset has no unit of length, or the factor is too large or too small.
    """
    if change.metres is None:
        return change
    unit, asked = parts.body.unit, f"{change.metres:g} m"
    if unit is None:
        raise PromptError(
            f"The asset's format has no unit of length, so {asked} says nothing of it.",
            advice="Say how many times: twice as tall, 20 % wider. A GLB is in metres.",
        )
    if table.direction(change.operation, change.part) == "all":
        raise PromptError(
            f"{asked} says nothing of a size in all directions.", advice="Say which length it is: 5 m tall."
        )
    moved = move(parts, change, 1.0)
    girth = table.direction(change.operation, change.part) == "girth" and moved.measured
    length = unit * (moved.extent(parts.body.points) if girth else moved.length(parts.body.points))
    factor = change.metres / length + (1.0 if change.added else 0.0) if length > 0 else 0.0
    check_factor(factor, f"{change.name} {asked}")
    return replace(change, factor=factor, metres=None, added=False)


def _part_of_way(change: Change, factor: float, share: float) -> float:
    """Return the factor of a share of the way from no change."""
    return factor * share if change.operation in SHAPES else 1 + share * (factor - 1)


def calibrated(parts: BodyParts, change: Change) -> float:
    """Return the factor with which a map gives what was asked for: bands take something away.

    Raises PartMissingError: the part is not there, or cannot be told from the rest.
    """
    factor, requested = change.factor, change.factor
    if change.operation in SHAPES or abs(requested - 1) < 0.02:
        return factor
    for _ in range(2):
        moved = move(parts, change, factor)
        if moved.affine is not None:
            return factor
        before = moved.length(parts.body.points)
        grown = moved.length(_settled(parts.body, change, moved)) / before - 1 if before else 0.0
        if change.part != WHOLE and grown / (requested - 1) < _TOLD_APART:
            raise PartMissingError(f"The {change.name} cannot be told from the rest well enough to change it.")
        if abs(grown - (requested - 1)) < 0.01 or grown * (requested - 1) <= 0:
            break
        most = _MOST_CORRECTED * abs(requested - 1)
        factor = 1 + float(np.clip((factor - 1) * (requested - 1) / grown, -min(most, 0.9), most))
    return factor


def _settled(body: Body, change: Change, result: Moved) -> Floats:
    """Return the points as symmetric as the source, and on the same ground if what stands on it was changed."""
    moved = result.points - body.points
    lopsided = change.operation in _LOPSIDED or change.sides
    points = body.points + (moved if lopsided else body.symmetric(moved))
    # Swimming and hanging things have no ground to sink into.
    grounded = change.operation != "fat" or abs(body.ground) <= _ON_ORIGIN * body.size[UP]
    if grounded and (change.part in _STANDING or change.operation == "high"):
        stands = result.weight > 0.5 if change.part in _STANDING else np.ones(len(points), bool)
        stands = stands if stands.any() else np.ones(len(points), bool)
        points[:, UP] += body.points[stands, UP].min() - points[stands, UP].min()
    return points


def _above_ground(parts: BodyParts, change: Change, moved: Moved, points: Floats) -> Floats:
    """Return the points with a part that would go below the ground, on which the rest stands, kept above it.

    All that goes down goes down by the same share less. What swims or hangs has no ground.
    """
    body = parts.body
    if change.part in _STANDING or points[:, UP].min() >= body.ground - _SUNK * body.diagonal:
        return points
    rest = body.points[moved.weight < _OUTSIDE, UP]
    if not len(rest) or rest.min() > body.ground + _SUNK * body.diagonal:
        return points
    if abs(body.ground) > _ON_ORIGIN * body.size[UP] and not parts.on_wheels and not parts.on_legs:
        return points
    down = np.maximum(body.points[:, UP] - points[:, UP], 0.0)
    below = points[:, UP] < body.ground
    share = float(np.min((body.points[below, UP] - body.ground) / np.maximum(down[below], 1e-300)))
    raised = points.copy()
    raised[:, UP] += (1 - max(share, 0.0)) * down
    return raised


def _flipped(body: Body, points: Floats, change: Change) -> Flags:
    """Return which faces (F,) turned over; under a map that turns them, those that fold against their neighbours."""
    return body.neighbours.folded(points) if change.operation in _TURNING else body.flipped(points)


def _relaxed(body: Body, points: Floats, flipped: Flags, change: Change, junctions: Junctions) -> tuple[Floats, Flags]:
    """Return the points with slivers on their edges and displacements smoothed around faces that are still flipped.

    Only where faces are flipped; what is turned is not smoothed. Also returns which are flipped then.
    """
    if flipped.any():
        points = junctions.closed(body.points, along_slivers(body.points, body.faces, points))
        flipped = _flipped(body, points, change)
    if change.operation in _TURNING:
        return points, flipped
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
