"""Read an asset: its noun, its front and the part of every face.

The grade g of the nearest member (`choice`) tells fronts apart better than residuals of fits do, since a fit bends
whatever is there to the asset. The probability of a noun is its proposal's times exp(-(g / least g - 1) / 0.06), g its
least grade over the fronts, of members whose form no other noun shares. What is held in a hand may also lie: its
length is then the asset's longest axis. The best members of the noun are then fitted, and those nearly as good as the
best vote for the parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshdeform.nouns.labels import Floats, Index
from meshdeform.nouns.solids import PART_NAMES
from meshdeform.priors.builtin.teaching.deformed import Part
from meshdeform.priors.builtin.vocabulary import TURNED
from meshdeform.reading.articulated import AssetSamples, Fit, fit_candidate
from meshdeform.reading.cells import Cells, cells_of, ground_plate
from meshdeform.reading.choice import Frame, candidates, facing, nearness
from meshdeform.reading.evidence import Evidence, weighed
from meshdeform.reading.result import GROUND, Reading
from meshdeform.reading.smoothing import settled, smoothed
from meshdeform.reading.votes import TRUST, part_votes

__all__ = ["FRONTS", "read_asset"]

FRONTS = (0.0, 90.0, 180.0, -90.0)
_FITTED = 5
_VOTING = 4
_VOTING_WITHIN = 3 * TRUST
_DECISIVE = 0.06
_CONVENTION = 0.03
"""By which share other fronts must be better than +Z, which is where assets face by glTF's convention."""
_HELD_NAMES = "axe banana bone bottle candle carrot corn dumbbell guitar hammer pan rocket shield sword torch umbrella"
_HELD = frozenset(_HELD_NAMES.split())
"""Nouns of things that may lie."""
_SINGLE = frozenset(("beak", "head", "neck", "nose", "spout", "tail", "trunk"))
"""Parts that a noun has once; several solids of one touch."""


@dataclass(frozen=True)
class _Asset:
    verts: Floats
    faces: Index


def read_asset(
    body: Part,
    nouns: Mapping[str, float],
    *,
    evidence: Evidence | None = None,
    front_azimuth_deg: float | None = None,
    cache: Path | None = None,
) -> Reading:
    """Read a mesh.

    Parameters
    ----------
    body : Part
        Welded vertices (V, 3) float64, +Y up, and faces (F, 3) int64, in any unit.
    nouns : mapping
        What it may be, with probabilities; these need not sum to 1.
    evidence : Evidence, optional
        Joints and names of its file.
    front_azimuth_deg : float, optional
        Where it faces, if that is known: degrees from +Z toward +X.
    cache : Path, optional
        A folder in which samples of the nouns' members are kept (`banks`), a megabyte a noun. Without it they are
        drawn by each process.

    Raises
    ------
    ValueError
        No noun is proposed, or the mesh has no area.
    """
    verts, faces = np.asarray(body.verts, float), np.asarray(body.faces, np.int64)
    ground = ground_plate(verts, faces) if len(faces) else np.zeros(0, bool)
    standing = _Asset(verts, faces[~ground])
    if not nouns or not len(faces) or not _area(standing) > 0:
        raise ValueError("there is nothing to read: no noun is proposed, or the mesh has no area")
    noun, probabilities, turn, margin = _chosen(standing, nouns, front_azimuth_deg, cache)
    frame = Frame.turned(standing.verts, standing.faces, turn)
    fits = _best_fits(frame, noun, cache)
    labels, confidence = _labelled(frame, fits, evidence or Evidence())
    all_labels = np.full(len(faces), GROUND, np.int64)
    all_labels[~ground] = labels
    best = fits[0]
    return Reading(noun, probabilities, turn, margin, all_labels, confidence, best.candidate.number, best.residual)


def _area(asset: _Asset) -> float:
    a, b, c = asset.verts[asset.faces].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _chosen(
    asset: _Asset, nouns: Mapping[str, float], front_deg: float | None, cache: Path | None
) -> tuple[str, dict[str, float], Floats, float | None]:
    """Return the noun, the probabilities of all, the turn, and by how much the second front is worse."""
    grades = {noun: _grades(asset, noun, front_deg, cache) for noun in nouns}
    if len(grades) == 1 and len(grades[next(iter(nouns))]) == 1:
        noun = next(iter(nouns))
        return noun, {noun: 1.0}, grades[noun][0][2], None
    nearest = {noun: min(grade for _, grade, _ in turns) for noun, turns in grades.items()}
    least = min(nearest.values())
    likely = {noun: nouns[noun] * np.exp(-(grade / least - 1) / _DECISIVE) for noun, grade in nearest.items()}
    total = sum(likely.values()) or 1.0
    probabilities = {noun: float(value / total) for noun, value in likely.items()}
    noun = max(probabilities, key=probabilities.__getitem__)
    best = grades[noun]
    return noun, probabilities, best[0][2], best[1][0] / best[0][0] - 1 if len(best) > 1 else None


def _grades(asset: _Asset, noun: str, front_deg: float | None, cache: Path | None) -> list[tuple[float, float, Floats]]:
    """Return both grades (`nearness`) for each turn in which an asset of a noun may stand, the best first."""
    fronts = (front_deg,) if front_deg is not None else FRONTS[:1] if noun in TURNED else FRONTS
    turns = [facing(front) for front in fronts]
    if noun in _HELD and front_deg is None:
        turns += _lying(asset)
    graded = []
    for turn in turns:
        grade, own = nearness(Frame.turned(asset.verts, asset.faces, turn), noun, cache)
        against = 1.0 if np.allclose(turn, np.eye(3)) or len(turns) == 1 else 1 + _CONVENTION
        graded.append((grade * against, own * against, turn))
    return sorted(graded, key=lambda one: one[0])


def _lying(asset: _Asset) -> list[Floats]:
    """Return the turns that stand up an asset whose longest axis is level, either end up, to all four sides."""
    size = np.ptp(asset.verts[np.unique(asset.faces)], axis=0)
    axis = int(size.argmax())
    if axis == 1:
        return []
    turns = []
    for sign in (1.0, -1.0):
        up = sign * np.eye(3)[axis]
        stand = np.stack([np.cross(up, [0.0, 1.0, 0.0]), up, [0.0, 1.0, 0.0]])
        turns += [facing(front) @ stand for front in FRONTS]
    return turns


def _best_fits(frame: Frame, noun: str, cache: Path | None) -> list[Fit]:
    """Return the fitted members that may vote, the best first."""
    samples = AssetSamples(frame)
    fits = [fit_candidate(samples, frame, one) for one in candidates(frame, noun, _FITTED, cache)]
    fits.sort(key=lambda fit: (fit.score, fit.candidate.number))
    return [fit for fit in fits[:_VOTING] if fit.score <= fits[0].score + _VOTING_WITHIN]


def _labelled(frame: Frame, fits: Sequence[Fit], evidence: Evidence) -> tuple[Index, dict[str, float]]:
    """Return the part (F,) of each face, and the confidence of each part."""
    parts = np.unique(np.concatenate([fit.member.labels for fit in fits]))
    cells = cells_of(frame.verts, frame.faces)
    a, b, c = frame.verts[frame.faces].transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    votes = part_votes(frame.verts, frame.faces, cells, fits, parts)
    soft = smoothed(weighed(votes, parts, evidence, frame.faces, cells, areas), cells)
    single = np.array([PART_NAMES[number] in _SINGLE for number in parts])
    best = settled(soft, cells, evidence.segments(frame.faces)[cells.face], single)
    return parts[best][cells.of_face], _confidence(soft, best, cells, parts)


def _confidence(soft: Floats, best: Index, cells: Cells, parts: Index) -> dict[str, float]:
    own = soft[np.arange(len(best)), best]
    return {
        PART_NAMES[parts[column]]: float(np.average(own[best == column], weights=cells.areas[best == column]))
        for column in np.unique(best)
    }
