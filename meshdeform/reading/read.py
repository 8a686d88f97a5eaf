"""Read an asset: its noun, its front and the part of every face.

`deciding` finds noun and front. The best members of the noun are then fitted, and those nearly as good as the best
vote for the parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshdeform.nouns.deformed import Part
from meshdeform.nouns.labels import Flags, Index
from meshdeform.reading.articulated import AssetSamples, MemberFit, fit_candidate
from meshdeform.reading.cells import cells_of, ground_plate
from meshdeform.reading.choice import AssetMesh, FrontFrame, candidates
from meshdeform.reading.coarse import MOST_FACES, coarse
from meshdeform.reading.deciding import Decision, decide
from meshdeform.reading.evidence import Evidence, nouns_named, parts_told, weighed
from meshdeform.reading.result import GROUND, NO_PART, UP_TURNS, Reading
from meshdeform.reading.smoothing import settled, smoothed
from meshdeform.reading.trust import LEAST, confidences, part_measures
from meshdeform.reading.votes import TRUST, counted, part_votes
from meshdeform.vocabulary.solids import PART_NAMES

__all__ = ["FITTED", "read_asset"]

_TELLING = 1.2
"""What a difference of merits adds to the logarithm of the odds of the axis that points up: fitted to 40 assets."""
FITTED = 5
"""How many members are fitted by default."""
_VOTING = 4
_VOTING_WITHIN = 3 * TRUST
_SINGLE = frozenset(("beak", "head", "neck", "nose", "spout", "tail", "trunk"))
"""Parts that a noun has once; several solids of one touch."""


def read_asset(
    body: Part,
    nouns: Mapping[str, float],
    *,
    z_up: Mapping[str, float] | None = None,
    z_share: float = 0.2,
    evidence: Evidence | None = None,
    front_azimuth_deg: float | None = None,
    cache: Path | None = None,
    fitted: int = FITTED,
) -> Reading:
    """Read a mesh.

    Parameters
    ----------
    body : Part
        Welded vertices (V, 3) float64, +Y up unless `z_up` is given, and faces (F, 3) int64, in any unit.
    nouns : mapping
        What it may be, with probabilities that need not sum to 1; of several, the most probable six count, and those
        that names in the file tell. A single one is taken for what it is.
    z_up : mapping, optional
        What it may be, with probabilities, if +Z points up, for a format that leaves that open: which of +Y and +Z is
        up is then found, too. Of a noun that is known, give it here as well.
    z_share : float
        Of how many files of this kind +Z points up, between 0 and 1; most of STL. 1: it does.
    evidence : Evidence, optional
        Joints and names of its file.
    front_azimuth_deg : float, optional
        Where it faces, if that is known: degrees from +Z toward +X; where +Z is up, from -Y toward +X.
    cache : Path, optional
        A folder in which samples of the nouns' members are kept (`banks`), a megabyte a noun. Without it they are
        drawn by each process.
    fitted : int
        How many members are fitted, at least 1: most of the time goes there.

    Raises
    ------
    ValueError
        No noun is proposed, or the mesh has no area.
    """
    clues = _Clues(evidence or Evidence(), front_azimuth_deg, cache)
    if len(body.faces) <= MOST_FACES:
        return _read(body, _standing(body, nouns, z_up, z_share, clues), fitted, clues)
    less = coarse(body)
    clues = replace(clues, evidence=less.evidence(clues.evidence))
    reading = _read(less.body, _standing(less.body, nouns, z_up, z_share, clues), fitted, clues)
    return replace(reading, labels=less.labels(reading.labels, body.faces))


@dataclass(frozen=True)
class _Clues:
    """What is known of an asset besides its mesh, and the folder of the nouns' members."""

    evidence: Evidence
    front_azimuth_deg: float | None
    cache: Path | None


@dataclass(frozen=True)
class _Stand:
    """An asset with one of its axes up: the faces (F,) of the plate under it, and what it is if it stands so."""

    up: str
    ground: Flags
    decided_on: Decision

    @classmethod
    def decided(
        cls,
        body: Part,
        up: str,
        nouns: Mapping[str, float],
        clues: _Clues,
    ) -> _Stand:
        """Decide what it is if an axis points up."""
        verts, faces = np.asarray(body.verts, float) @ UP_TURNS[up].T, np.asarray(body.faces, np.int64)
        ground = ground_plate(verts, faces) if len(faces) else np.zeros(0, bool)
        standing = AssetMesh(verts, faces[~ground])
        if not nouns or not standing.areas.sum() > 0:
            raise ValueError("there is nothing to read: no noun is proposed, or the mesh has no area")
        named, near = nouns_named(clues.evidence, standing.faces, standing.areas)
        return cls(up, ground, decide(standing, nouns, named, near, clues.front_azimuth_deg, clues.cache))


def _standing(
    body: Part, nouns: Mapping[str, float], z_up: Mapping[str, float] | None, z_share: float, clues: _Clues
) -> _Stand:
    """Decide which axis points up, and what the asset is."""
    if z_up is None:
        return _Stand.decided(body, "+Y", nouns, clues)
    if z_share == 1:
        return _Stand.decided(body, "+Z", z_up, clues)
    stand, other = _Stand.decided(body, "+Y", nouns, clues), _Stand.decided(body, "+Z", z_up, clues)
    more = _TELLING * (other.decided_on.merit - stand.decided_on.merit)
    return other if more + np.log(z_share / (1 - z_share)) > 0 else stand


def _read(body: Part, stand: _Stand, fitted: int, clues: _Clues) -> Reading:
    """Fit members of what the asset is, and let them vote for its parts."""
    decided, frame = stand.decided_on, stand.decided_on.frame
    fits = _best_fits(frame, decided.noun, fitted, clues.cache)
    labels, confidence = _labelled(frame, fits, clues.evidence)
    all_labels = np.full(len(body.faces), GROUND, np.int64)
    all_labels[~stand.ground] = labels
    return Reading(
        decided.noun,
        decided.probabilities,
        frame.turn @ UP_TURNS[stand.up],
        decided.margin,
        all_labels,
        confidence,
        fits[0].candidate.number,
        fits[0].residual,
        stand.up,
    )


def _best_fits(frame: FrontFrame, noun: str, count: int, cache: Path | None) -> list[MemberFit]:
    """Return the fitted members that may vote, the best first."""
    samples = AssetSamples(frame)
    fits = [fit_candidate(samples, frame, one) for one in candidates(frame, noun, count, cache)]
    fits.sort(key=lambda fit: (fit.score, fit.candidate.number))
    return [fit for fit in fits[:_VOTING] if fit.score <= fits[0].score + _VOTING_WITHIN]


def _labelled(frame: FrontFrame, fits: Sequence[MemberFit], evidence: Evidence) -> tuple[Index, dict[str, float]]:
    """Return the part (F,) of each face, and the confidence of each part."""
    parts = np.unique(np.concatenate([fit.member.labels for fit in fits]))
    told_parts = parts_told(evidence, frame.faces, fits[0].candidate.noun, parts)
    parts = np.union1d(parts, told_parts)
    cells = cells_of(frame.verts, frame.faces)
    areas = frame.surface.areas
    votes = part_votes(frame.verts, frame.faces, cells, fits, parts)
    each = [weighed(one, parts, evidence, frame.faces, cells, areas) for one in (counted(votes, fits), *votes)]
    soft = np.split(smoothed(np.hstack(each), cells), len(each), axis=1)
    single = np.array([PART_NAMES[number] in _SINGLE for number in parts])
    best = settled(soft[0], cells, evidence.segments(frame.faces)[cells.face], single)
    confidence = confidences(part_measures(soft[0], soft[1:], best, cells, parts), fits[0].residual)
    told = {name: share for name, share in confidence.items() if share >= LEAST}
    labels = np.where([PART_NAMES[number] in told for number in parts], parts, NO_PART)
    return labels[best][cells.of_face], told
