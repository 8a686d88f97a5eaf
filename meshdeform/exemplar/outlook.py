"""Tell before a fit whether it can be, and what would work instead.

A smooth map moves and stretches parts; it makes no towers, masts or tracks. With the distance d of the nearest member
(`choosing`) and the share r of the surfaces that is of parts which only one of the two has, half of
sum_k |s_k - t_k| for the shares s, t of part k, an outlook is doubtful

    between animals and figures               if d > 0.18,
    if one is built and not both are turned   if d + 0.1 r > 0.165,
    else                                      if d > 0.172.

The three bounds were set by eye on 44 pairs of assets and nouns: of the 15 that they call doubtful 12 were not worth
keeping, of the other 29 three were not. A lump without parts becomes whatever is wished (`clay`), and an asset that is
the noun already changes.

What is suggested are prompts: other nouns of the same group, the nearest of which lies within the bound, and the noun
that the asset is with an adjective that brings it nearer to the proportions of the wish and a greater part.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshdeform.exemplar.choosing import Exemplar, exemplars, nearest_of
from meshdeform.exemplar.clay import is_clay
from meshdeform.exemplar.kinds import is_living, is_turned
from meshdeform.exemplar.shapes import Shape, Wish
from meshdeform.geometry.mesh import face_areas
from meshdeform.nouns.labels import Floats
from meshdeform.reading.result import GROUND
from meshdeform.vocabulary.grammar import ParsedPrompt
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.near_words import nearest
from meshdeform.vocabulary.nouns import NOUN_GROUPS, NOUNS, PARTS
from meshdeform.vocabulary.solids import PART_NAMES, part_label

__all__ = ["FitOutlook", "outlook"]

_LIVING, _BUILT, _PARTS, _ELSE = 0.18, 0.165, 0.1, 0.172
_MOST_NOUNS, _OFFERED = 8, 2
_MADE = ("vehicles", "furniture", "buildings")
_GROUPS = ("animals", "figures", *_MADE)
"""Groups of which all nouns may be offered for each other."""
_TELLING = 0.15
"""Share of a surface from which a part that the other lacks is named."""
_VAGUE = ("body", "base", "frame", "load", "top")
"""Names of parts that say little to a reader."""
_UNLIKE = 1.15
"""Ratio of proportions from which an adjective is suggested."""


@dataclass(frozen=True)
class FitOutlook:
    """How likely a fit is to succeed: whether that is doubtful, the distance of the nearest member, and words.

    `reasons`: sentences for a user; `suggestions`: prompts that are likelier to succeed, the best first.
    """

    doubtful: bool
    distance: float
    reasons: tuple[str, ...] = ()
    suggestions: tuple[str, ...] = ()


def outlook(source: Shape, wish: Wish, exemplar: Exemplar | None = None, *, cache: Path | None = None) -> FitOutlook:
    """Return the outlook of a fit of an asset to the nearest member of what is wished.

    `exemplar`: that member, which is found without it; `cache`: a folder with tables of members (`reading.banks`).
    """
    exemplar = exemplar or exemplars(source, wish, 1, cache=cache)[0]
    if source.noun == wish.noun or is_clay(source) or not _excess(source, exemplar) > 0:
        return FitOutlook(False, exemplar.distance)
    return FitOutlook(True, exemplar.distance, _reasons(source, exemplar), _suggestions(source, wish, exemplar))


def _shares(shape: Shape) -> Floats:
    """Return the share (P,) of each part of the surface."""
    known = shape.labels >= 0
    areas = face_areas(shape.verts, shape.faces)
    sums = np.bincount(shape.labels[known], areas[known], len(PART_NAMES))
    return np.asarray(sums / max(float(areas[shape.labels != GROUND].sum()), 1e-300))


def _excess(source: Shape, exemplar: Exemplar) -> float:
    """Return by how much a fit is beyond what can be, by the bounds at the head."""
    goal = exemplar.shape
    if is_living(source.noun) and is_living(goal.noun):
        return exemplar.distance - _LIVING
    turned = is_turned(source.noun) and is_turned(goal.noun)
    if source.noun and not turned and (_is_made(source.noun) or _is_made(goal.noun)):
        unlike = float(np.abs(_shares(source) - _shares(goal)).sum()) / 2
        return exemplar.distance + _PARTS * unlike - _BUILT
    return exemplar.distance - _ELSE


def _is_made(noun: str) -> bool:
    """Return whether a noun is a vehicle, furniture or a building."""
    return any(noun in NOUN_GROUPS[group] for group in _MADE)


def _reasons(source: Shape, exemplar: Exemplar) -> tuple[str, ...]:
    """Return which large parts only one of the two has, or that the shapes are too unlike."""
    own, other = _shares(source), _shares(exemplar.shape)
    noun, wished = source.noun or "asset", exemplar.shape.noun
    reasons = []
    if source.noun:
        lacking, over = _missing_parts(other, own), _missing_parts(own, other)
        reasons += [f"Much of {_article(wished)} is {part}, and this {noun} has no {part}." for part in lacking[:1]]
        reasons += [f"Much of this {noun} is {part}, and {_article(wished)} has no {part}." for part in over[:1]]
    if not reasons:
        reasons.append(f"The nearest {wished} is too unlike this {noun}.")
    return tuple(reasons)


def _missing_parts(shares: Floats, others: Floats) -> list[str]:
    """Return the large parts with shares (P,) that are missing from others, the largest first."""
    large = np.flatnonzero((shares > _TELLING) & (others == 0))
    names = [PART_NAMES[k] for k in large[np.argsort(-shares[large], kind="stable")]]
    return [name for name in names if name not in _VAGUE]


def _article(noun: str) -> str:
    return str(ParsedPrompt(noun))


def _suggestions(source: Shape, wish: Wish, exemplar: Exemplar) -> tuple[str, ...]:
    """Return prompts that are likelier to succeed."""
    return (*_nearer_nouns(source, wish), *_of_its_own(source, exemplar))


def _nearer_nouns(source: Shape, wish: Wish) -> list[str]:
    """Return the nouns near to both in meaning, and of the asset's own group, that can be, the nearest first."""
    groups = (NOUN_GROUPS[group] for group in _GROUPS)
    group = next((nouns for nouns in groups if source.noun in nouns), ())
    around = [*nearest(wish.noun, NOUNS), *nearest(source.noun, NOUNS), *group]
    nouns = [noun for noun in dict.fromkeys(around) if noun not in (wish.noun, source.noun)][:_MOST_NOUNS]
    found = [(one, _excess(source, one)) for noun in nouns for one in [nearest_of(source, noun)]]
    found.sort(key=lambda pair: pair[1])
    return [_article(one.shape.noun) for one, excess in found if excess <= 0][:_OFFERED]


def _of_its_own(source: Shape, exemplar: Exemplar) -> list[str]:
    """Return the asset's own noun with attributes that bring it nearer to the wish, if it has any."""
    if source.noun not in NOUNS:
        return []
    attributes = []
    adjective = _adjective(source, exemplar)
    if adjective:
        attributes.append(Attribute("whole", adjective))
    present = {PART_NAMES[k] for k in np.unique(source.labels[source.labels >= 0])}
    parts = [part for part in NOUNS[source.noun] if part_label(part) in present]
    attributes += [Attribute(part, PARTS[part][1]) for part in parts[:1]]
    return [str(ParsedPrompt(source.noun, tuple(attributes) or (Attribute("whole", "tall"),)))]


def _adjective(source: Shape, exemplar: Exemplar) -> str:
    """Return what an asset must become to have the proportions of a member; empty if it has them."""
    used = [np.ptp(shape.verts[np.unique(shape.faces)], axis=0) for shape in (source, exemplar.shape)]
    ratio = np.log(np.maximum(used[1], 1e-9) / np.maximum(used[0], 1e-9))
    ratio -= ratio.mean()
    axis = int(np.abs(ratio).argmax())
    if abs(ratio[axis]) < np.log(_UNLIKE):
        return ""
    return (("thin", "wide"), ("short", "tall"), ("", "long"))[axis][int(ratio[axis] > 0)]
