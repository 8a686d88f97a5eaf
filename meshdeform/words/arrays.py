"""The arrays of a word's file: pack shapes into them, and check and unpack them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from meshdeform.errors import AssetError
from meshdeform.words.file import WordShape

__all__ = ["packed", "unpacked"]

_NO_LABEL = 255
_FARTHEST, _LEAST_AREA = 1.0, 1e-9
"""Largest coordinate, as the box has a diagonal of 1, and twice the area that a shape has at least."""


def packed(shapes: Sequence[WordShape], order: Sequence[int]) -> dict[str, NDArray[np.generic]]:
    """Return the arrays of shapes by name; parts get new numbers, `order` has the old ones in the order of the new."""
    if not shapes or any(len(each.verts) > np.iinfo(np.uint16).max for each in shapes):
        raise AssetError("The word has no shape, or one with too many vertices.")
    number = np.full(max([*order, -1]) + 2, _NO_LABEL)
    number[list(order)] = np.arange(len(order))
    number[-1] = _NO_LABEL  # of the label -1
    arrays = {
        "counts": np.array([(len(each.verts), len(each.faces)) for each in shapes], "<u2"),
        "faces": np.concatenate([each.faces for each in shapes]).astype("<u2"),
        "labels": np.concatenate([number[each.labels] for each in shapes]).astype("u1"),
        "verts": np.concatenate([each.verts for each in shapes]).astype("<f4"),
    }
    return {name: np.ascontiguousarray(array) for name, array in arrays.items()}


def unpacked(data: bytes, shapes: int, parts: int) -> tuple[WordShape, ...]:
    """Return the shapes of the bytes of arrays whose lengths were checked.

    Raises
    ------
    ValueError
        A number is not finite or out of range.
    """
    counts = np.frombuffer(data, "<u2", 2 * shapes).reshape(-1, 2).astype(np.int64)
    faces_end = counts[:, 1].sum()
    at = counts.size * 2
    faces = np.frombuffer(data, "<u2", 3 * faces_end, at).reshape(-1, 3).astype(np.int64)
    at += 6 * faces_end
    labels = np.frombuffer(data, "u1", faces_end, at).astype(np.int64)
    verts = np.frombuffer(data, "<f4", offset=at + faces_end).reshape(-1, 3).astype(np.float64)
    if not (np.isfinite(verts).all() and np.abs(verts).max() <= _FARTHEST):
        raise ValueError("a vertex is not finite, or outside of the frame")
    if ((labels >= parts) & (labels != _NO_LABEL)).any():
        raise ValueError("a face is of a part that has no name")
    if (faces.max(1) >= np.repeat(counts[:, 0], counts[:, 1])).any():
        raise ValueError("a face names a vertex that its shape does not have")
    a, b, c = verts[faces + np.repeat(np.cumsum(counts[:, 0]) - counts[:, 0], counts[:, 1])[:, None]].transpose(1, 0, 2)
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if (np.add.reduceat(doubled, np.cumsum(counts[:, 1]) - counts[:, 1]) <= _LEAST_AREA).any():
        raise ValueError("a shape has no area")
    labels[labels == _NO_LABEL] = -1
    ends = np.cumsum(counts, 0)[:-1]
    split = zip(np.split(verts, ends[:, 0]), np.split(faces, ends[:, 1]), np.split(labels, ends[:, 1]), strict=True)
    return tuple(WordShape(*each) for each in split)
