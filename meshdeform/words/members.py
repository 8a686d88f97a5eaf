"""Members of a word of one's own, as fits and readings take them: its shapes, with attributes."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from meshdeform.nouns.deformed import deformed
from meshdeform.nouns.families import Part
from meshdeform.nouns.labels import Index, LabelledMember, code, solids_of
from meshdeform.vocabulary.lookup import Attribute
from meshdeform.vocabulary.solids import PART_NAMES, part_label
from meshdeform.words.file import Word
from meshdeform.words.sizes import sized

__all__ = ["word_member"]


def word_member(word: Word, number: int, attributes: Iterable[Attribute] = ()) -> LabelledMember:
    """Return the member of a number; those of the numbers beyond its shapes are the first ones again.

    Faces whose part has a name that no noun of ours has, or none, are of the body.
    """
    shape = word.shapes[number % len(word.shapes)]
    codes = np.array([*(code(name if name in PART_NAMES else "body") for name in word.parts), code("body")])
    labels = codes[shape.labels]
    verts, faces = _parted(shape.verts, shape.faces, labels)
    solids = solids_of(Part(verts, faces))
    member = LabelledMember(word.noun, verts, faces, solids, labels)
    wanted = tuple(attributes)
    for each in wanted:
        if each.part != "whole":
            member = sized(member, part_label(each.part), each.degree)
    whole = deformed(Part(member.verts, faces), wanted, np.random.default_rng([number, 72]))
    return member.moved(whole.verts)


def _parted(verts: np.ndarray, faces: Index, labels: Index) -> tuple[np.ndarray, Index]:
    """Return vertices and faces of which no vertex is of two parts."""
    pairs, corners = np.unique(np.column_stack([faces.ravel(), np.repeat(labels, 3)]), axis=0, return_inverse=True)
    return verts[pairs[:, 0]], corners.reshape(-1, 3).astype(np.int64)
