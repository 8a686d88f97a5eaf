"""Stand four-legged animals up on their hind legs, as figures in games stand, and take the front legs off a dragon.

The body turns up about the hips, the head back until it looks ahead; the front legs hang at the sides and are called
arms. All else is as it was drawn.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshdeform.nouns.families.parts import Part
from meshdeform.nouns.labels import LabelledMember, code
from meshdeform.nouns.poses import head_and_neck, hind_and_front, throat, top_of, turn

__all__ = ["on_hind_legs", "two_legged"]

_RISE_DEG = (72.0, 86.0)
_HEAD_BACK = 0.92
_SPLAY_DEG = (12.0, 30.0)
_APART = 0.6
"""How far from the middle the arms hang, as a share of half of the body's width."""


def on_hind_legs(member: LabelledMember, rng: np.random.Generator) -> LabelledMember:
    """Return a four-legged animal that stands upright, with arms for front legs."""
    verts = member.verts.copy()
    hind, front = hind_and_front(member, verts)
    hip = np.mean([top_of(verts, rows) for rows in hind], axis=0)
    rise = rng.uniform(*_RISE_DEG)
    upper = np.ones(len(verts), bool)
    upper[np.concatenate(hind)] = False
    shoulders = np.array([top_of(verts, rows) for rows in front])
    turn(verts, upper, hip, -rise, "x")
    turn(verts, head_and_neck(member), throat(member, verts), _HEAD_BACK * rise, "x")
    turn(shoulders, np.arange(len(shoulders)), hip, -rise, "x")
    splay = rng.uniform(*_SPLAY_DEG)
    body = verts[np.isin(member.solids, member.solids_named("body"))]
    for rows, shoulder in zip(front, shoulders, strict=True):
        side = float(np.sign(shoulder[0]))
        turn(verts, rows, shoulder, rise, "x")
        turn(verts, rows, shoulder, side * splay, "z")
        verts[rows, 0] += side * _APART * float(np.abs(body[:, 0]).max()) - shoulder[0] * _APART
    labels = member.labels.copy()
    arms = np.zeros(len(verts), bool)
    arms[np.concatenate(front)] = True
    labels[arms[member.faces[:, 0]]] = code("arm")
    return replace(member, verts=verts, labels=labels)


def two_legged(member: LabelledMember) -> LabelledMember:
    """Return a four-legged animal without its front legs."""
    _, front = hind_and_front(member, member.verts)
    kept = np.ones(len(member.verts), bool)
    kept[np.concatenate(front)] = False
    number = np.cumsum(kept) - 1
    faces = kept[member.faces[:, 0]]
    solids = np.unique(member.solids[kept], return_inverse=True)[1]
    shape = Part(member.verts[kept], number[member.faces[faces]])
    return LabelledMember(member.noun, shape.verts, shape.faces, np.asarray(solids, np.int64), member.labels[faces])
