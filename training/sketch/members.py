"""Draw the lines of members of all nouns as people draw them.

Thin solids, such as legs, may be single lines; parts may be left out; of what has a face, the head may be all there is;
proportions are not right, and nothing stands quite upright.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from meshdeform.kinds.sketch.lines import Pictures, View, line_pictures
from meshdeform.nouns.forms import drawn, own_forms
from meshdeform.nouns.labels import Flags, Floats, Index, LabelledMember
from meshdeform.nouns.poses import POSES, posed
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.nouns import NOUNS, PARTS

PIXELS = 80
_OF_EACH_KIND, _FEWEST, _MOST = 1, 5, 10
_FACES = frozenset(("ears", "eyes", "beak", "horns", "mane", "nose", "trunk"))
_BINS = 8
"""Pieces of a thin solid whose middles are its line."""
_SLIM, _SMALL, _LINE = 0.35, 0.25, 0.02
"""A solid is thin below these shares of its length and of the whole; a line is so thick a share of the whole."""


def pictures_of(noun: str, seed: int) -> Iterator[Pictures]:
    """Yield line pictures (PIXELS, PIXELS) of members of a noun."""
    rng = np.random.default_rng([seed, *noun.encode()])
    forms = own_forms(noun, ())
    for number in range(min(max(_FEWEST, _OF_EACH_KIND * len(forms)), _MOST)):
        member = _some(forms[number % len(forms)], number, rng)
        for head_alone in (False, True):
            part = _as_drawn(member, head_alone, rng)
            if part is not None:
                views = _of_a_face(rng) if head_alone else _likely(rng)
                for _, page in line_pictures(*part, views, PIXELS):
                    yield page


def _some(form: str, number: int, rng: np.random.Generator) -> LabelledMember:
    """Return a member of a form with some attributes, in some pose."""
    wanted = [Attribute(part, PARTS[part][int(rng.integers(2))]) for part in NOUNS.get(form, ()) if rng.random() < 0.15]
    member = drawn(form, wanted, np.random.default_rng([number, 71]))
    poses = [pose for pose in POSES.get(form, ()) if pose not in "TA"]
    if poses and rng.random() < 0.3:
        member = posed(member, str(rng.choice(poses)), np.random.default_rng(number))
    return member


def _as_drawn(member: LabelledMember, head_alone: bool, rng: np.random.Generator) -> tuple[Floats, Index, Index] | None:
    """Return vertices, faces and their parts of what is drawn of a member; None where a head is no face."""
    if rng.random() < 0.5:
        member = _with_thin_as_lines(member, rng)
    keep: Flags = np.ones(len(member.faces), bool)
    if head_alone:
        if "head" not in member.parts or not _FACES & set(member.parts):
            return None
        keep = np.asarray(member.carried("head")[member.faces].all(axis=1))
    elif rng.random() < 0.2:
        keep = np.asarray((rng.random(len(member.part_of_solid)) > 0.25)[member.solid_of_face])
        if keep.mean() < 0.6:
            keep[:] = True
    if keep.sum() < 20:
        return None
    used, faces = np.unique(member.faces[keep], return_inverse=True)
    return member.verts[used], faces.reshape(-1, 3), member.labels[keep]


def _with_thin_as_lines(member: LabelledMember, rng: np.random.Generator) -> LabelledMember:
    """Return a member whose thin solids are shrunk to their middle lines, most of them."""
    verts, size = member.verts.copy(), float(np.ptp(member.verts, axis=0).max())
    for number in range(int(member.solids.max()) + 1):
        rows = np.flatnonzero(member.solids == number)
        if len(rows) < _BINS or rng.random() > 0.8:
            continue
        places = verts[rows]
        axes = np.linalg.svd(places - places.mean(0), full_matrices=False)[2]
        along, across = (places @ axes.T)[:, :2].T
        length, width = float(np.ptp(along)), float(np.ptp(across))
        if width < _SLIM * length and width < _SMALL * size:
            middles = _middles(places, (along - along.min()) / length * _BINS - 0.5)
            verts[rows] = middles + (places - middles) * min(1.0, _LINE * size / max(width, 1e-9))
    return member.moved(verts)


def _middles(places: Floats, at: Floats) -> Floats:
    """Return the place (N, 3) on the middle line of a solid beside each vertex, which is `at` in pieces along it."""
    piece = np.clip(np.rint(at).astype(int), 0, _BINS - 1)
    known = np.unique(piece)
    line = np.stack([places[piece == number].mean(0) for number in known])
    return np.stack([np.interp(at, known, line[:, axis]) for axis in range(3)], 1)


def _likely(rng: np.random.Generator) -> list[View]:
    """Return views from where people draw: the side, the front, between them, and now and then above or anywhere."""
    side = rng.choice((-90.0, 90.0))
    last = (
        (rng.choice((0.0, 90.0)), rng.uniform(70, 89))
        if rng.random() < 0.4
        else (360 * rng.random(), rng.uniform(0, 35))
    )
    places = [
        (side + rng.uniform(-8, 8), rng.uniform(0, 14)),
        (rng.uniform(-6, 6), rng.uniform(0, 14)),
        (side / 90 * rng.uniform(28, 68), rng.uniform(2, 20)),
        last,
    ]
    return [_clumsy(azimuth, elevation, rng) for azimuth, elevation in places]


def _of_a_face(rng: np.random.Generator) -> list[View]:
    return [
        _clumsy(rng.uniform(-10, 10), rng.uniform(0, 8), rng),
        _clumsy(rng.uniform(-45, 45), rng.uniform(0, 8), rng),
    ]


def _clumsy(azimuth_deg: float, elevation_deg: float, rng: np.random.Generator) -> View:
    return View(azimuth_deg, elevation_deg, rng.normal(0, 0.06), float(np.exp(rng.normal(0, 0.13))))
