"""Read an asset: its noun, its front and the part of every face.

`deciding` finds noun and front. The best members of the noun are then fitted, and those nearly as good as the best
vote for the parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from meshdeform.nouns.labels import Index
from meshdeform.nouns.solids import PART_NAMES
from meshdeform.priors.builtin.teaching.deformed import Part
from meshdeform.reading.articulated import AssetSamples, Fit, fit_candidate
from meshdeform.reading.cells import cells_of, ground_plate
from meshdeform.reading.choice import Frame, Surface, candidates
from meshdeform.reading.coarse import MOST_FACES, coarse
from meshdeform.reading.deciding import decide
from meshdeform.reading.evidence import Evidence, nouns_named, parts_told, weighed
from meshdeform.reading.result import GROUND, NO_PART, Reading
from meshdeform.reading.smoothing import settled, smoothed
from meshdeform.reading.trust import LEAST, confidences, part_measures
from meshdeform.reading.votes import TRUST, counted, part_votes

__all__ = ["read_asset"]

_FITTED = 5
_VOTING = 4
_VOTING_WITHIN = 3 * TRUST
_SINGLE = frozenset(("beak", "head", "neck", "nose", "spout", "tail", "trunk"))
"""Parts that a noun has once; several solids of one touch."""


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
        What it may be, with probabilities that need not sum to 1; of several, the most probable five count, and those
        that names in the file tell. A single one is taken for what it is.
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
    if len(body.faces) > MOST_FACES:
        return _read_coarsely(body, nouns, evidence or Evidence(), front_azimuth_deg, cache)
    verts, faces = np.asarray(body.verts, float), np.asarray(body.faces, np.int64)
    ground = ground_plate(verts, faces) if len(faces) else np.zeros(0, bool)
    standing = Surface(verts, faces[~ground])
    if not nouns or not standing.areas.sum() > 0:
        raise ValueError("there is nothing to read: no noun is proposed, or the mesh has no area")
    evidence = evidence or Evidence()
    named, near = nouns_named(evidence, standing.faces, standing.areas)
    decided = decide(standing, nouns, named, near, front_azimuth_deg, cache)
    frame = decided.frame
    fits = _best_fits(frame, decided.noun, cache)
    labels, confidence = _labelled(frame, fits, evidence)
    all_labels = np.full(len(faces), GROUND, np.int64)
    all_labels[~ground] = labels
    best = fits[0]
    return Reading(
        decided.noun,
        decided.probabilities,
        frame.turn,
        decided.margin,
        all_labels,
        confidence,
        best.candidate.number,
        best.residual,
    )


def _read_coarsely(
    body: Part, nouns: Mapping[str, float], evidence: Evidence, front_deg: float | None, cache: Path | None
) -> Reading:
    """Read a mesh of more than `MOST_FACES` faces by a coarser one."""
    less = coarse(body)
    reading = read_asset(less.body, nouns, evidence=less.evidence(evidence), front_azimuth_deg=front_deg, cache=cache)
    return replace(reading, labels=less.labels(reading.labels, body.faces))


def _best_fits(frame: Frame, noun: str, cache: Path | None) -> list[Fit]:
    """Return the fitted members that may vote, the best first."""
    samples = AssetSamples(frame)
    fits = [fit_candidate(samples, frame, one) for one in candidates(frame, noun, _FITTED, cache)]
    fits.sort(key=lambda fit: (fit.score, fit.candidate.number))
    return [fit for fit in fits[:_VOTING] if fit.score <= fits[0].score + _VOTING_WITHIN]


def _labelled(frame: Frame, fits: Sequence[Fit], evidence: Evidence) -> tuple[Index, dict[str, float]]:
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
