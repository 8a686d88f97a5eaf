"""Make shapes of words of meshes: with their parts, turned to the front, reduced, and in their frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from meshdeform.geometry.collapsing import collapsed
from meshdeform.nouns.families import Part
from meshdeform.nouns.labels import Floats, Index
from meshdeform.plain.body import Body
from meshdeform.plain.evidence import evidence_of
from meshdeform.plain.read_parts import ReadParts
from meshdeform.plain.reader import Reader
from meshdeform.reading.choice import AssetMesh, FrontFrame, facing
from meshdeform.reading.coarse import coarse
from meshdeform.reading.result import GROUND, UP_TURNS, Reading
from meshdeform.reading.samples import features, spread
from meshdeform.words import MAX_FACES, WordShape
from meshdeform.words.file import PART

__all__ = ["Parted", "parted", "reduced", "shape_of", "turn_between"]

_SAMPLES, _FEW = 8_000, 600
_BY_NORMAL = 0.04
_QUARTERS = (0.0, 90.0, 180.0, -90.0)
_CLEARLY = 1.15
"""Ratio of distances from which another quarter turn is the right one."""
_ALIKE = 0.06
"""Mean distance, a share of the diagonal, up to which two shapes are like each other at all."""


@dataclass(frozen=True)
class Parted:
    """A mesh turned to its front, in its own unit, with the name of the part of each face, empty of none."""

    verts: Floats
    faces: Index
    names: tuple[str, ...]
    of_face: Index  # (F,) int64: the place in `names`, or -1
    front_deg: float = 0.0  # where its front was, from +Z toward +X


def reduced(body: Body) -> Body:
    """Return a body of at most `MAX_FACES` faces, with what its file and people say of parts; nothing reads it."""
    points, faces = _collapsed(body.points, body.faces)
    if len(faces) == len(body.faces):
        return replace(body, reader=Reader())
    of_vert, of_face = cKDTree(body.points).query(points)[1], _nearest_faces(body, points, faces)
    names = {}
    for name, flags in body.names.items():
        own = np.asarray(flags[body.faces].all(axis=1))[of_face]
        names[name] = np.isin(np.arange(len(points)), faces[own])
    return replace(
        body,
        points=points,
        faces=faces,
        names=names,
        weights=body.weights[of_vert],
        vertex_map=np.full(len(body.vertex_map), -1, np.int64),
        rows=body.rows[of_vert],
        painted={name: flags[of_face] for name, flags in body.painted.items()},
        reader=Reader(),
    )


def parted(body: Body, reading: Reading | None, front_deg: float | None) -> Parted:
    """Return a body with its parts: those of its reading, and those that its file names.

    `reading`: None if it is like no noun of ours; `front_deg`: where it faces, if that is known.
    """
    painted = dict(body.painted)
    if reading is None:
        painted = {**evidence_of(body).told(body.faces), **painted}
    parts = ReadParts(replace(body, reader=Reader(lambda: reading), painted=painted))
    names = tuple(name for name in parts.names if PART.fullmatch(name))
    of_face = np.full(len(body.faces), -1, np.int64)
    for number, name in enumerate(names):
        of_face[parts.itself(name)] = number
    standing = np.ones(len(body.faces), bool) if reading is None else reading.labels != GROUND
    up = np.eye(3) if reading is None else UP_TURNS[reading.up]
    if front_deg is None:
        front_deg = reading.front_azimuth_deg if reading is not None and reading.front_sure else 0.0
    verts = body.points @ (facing(front_deg) @ up).T
    return Parted(verts, body.faces[standing], names, of_face[standing], front_deg)


def shape_of(mesh: Parted, numbers: dict[str, int]) -> WordShape:
    """Return the shape of a mesh; `numbers` has the number of each part in the word, and gets those that are new."""
    of_part = np.array([*(numbers.setdefault(name, len(numbers)) for name in mesh.names), -1])
    used, corners = np.unique(mesh.faces, return_inverse=True)
    faces, verts = corners.reshape(-1, 3), mesh.verts[used]
    low, high = verts.min(0), verts.max(0)
    verts = (verts - (low + high) / 2) / float(np.linalg.norm(high - low))
    return WordShape(verts, faces[:, ::-1] if _volume(verts, faces) < 0 else faces, of_part[mesh.of_face])


def _collapsed(verts: Floats, faces: Index) -> tuple[Floats, Index]:
    """Return a mesh of at most `MAX_FACES` faces."""
    if len(faces) > MAX_FACES:
        fewer, corners = collapsed(verts, faces, MAX_FACES)
        verts, faces = (fewer, corners) if len(corners) else (verts, faces)
    if len(faces) > MAX_FACES:  # of many pieces that cannot be collapsed
        verts, faces, *_ = coarse(Part(verts, faces), MAX_FACES).body
    return verts, faces


def _nearest_faces(body: Body, points: Floats, faces: Index) -> Index:
    """Return the face (F,) of a body that is nearest to each of these and faces alike."""
    samples = spread(body.points, body.faces, _SAMPLES, 1)
    a, b, c = points[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    tree = cKDTree(features(samples.positions / body.diagonal, samples.normals, _BY_NORMAL))
    nearest = tree.query(features((a + b + c) / 3 / body.diagonal, normals, _BY_NORMAL))[1]
    return np.asarray(samples.faces[nearest])


def _volume(verts: Floats, faces: Index) -> float:
    a, b, c = verts[faces].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum())


def turn_between(shape: WordShape, other: WordShape) -> float:
    """Return by which quarter turn about +Y, in degrees, another shape faces as a shape does, where that is clear."""
    own = FrontFrame(AssetMesh(shape.verts, shape.faces), np.eye(3))
    theirs = AssetMesh(other.verts, other.faces)
    distances = {turn: _apart(own, FrontFrame(theirs, facing(turn))) for turn in _QUARTERS}
    best = min(distances, key=distances.__getitem__)
    return best if distances[best] < _ALIKE and distances[best] * _CLEARLY < distances[0.0] else 0.0


def _apart(one: FrontFrame, other: FrontFrame) -> float:
    """Return the mean distance of the features of two surfaces, one of which is scaled to the box of the other."""
    scale = (one.high - one.low) / np.maximum(other.high - other.low, 1e-9)
    theirs = other.features[:_FEW].astype(float)
    theirs[:, :3] *= scale
    mine = one.features[:_FEW].astype(float)
    return float(cKDTree(mine).query(theirs)[0].mean() + cKDTree(theirs).query(mine)[0].mean()) / 2
