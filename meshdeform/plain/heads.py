"""Find the head of a body with its neck, and its tail: by the joints of a skeleton, else by the body's reading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from meshdeform.plain.body import UP, Body, Flags, Floats, Index, step
from meshdeform.plain.carried import touching
from meshdeform.plain.joints import JointParts
from meshdeform.plain.pieces import PartMissingError
from meshdeform.plain.read_parts import ReadParts

__all__ = ["Head", "Tail", "head_of_joints", "head_of_reading", "tail_of_joints", "tail_of_reading"]

_INSIDE = 0.5
_BLEND, _BLEND_AT = 0.6, 0.1
"""Width of the band in which a head without a neck turns into the body, as a share of its size, and where it begins."""
_BARE = 0.35
"""Share of a head's border with the neck that its border with the rest may have, where the neck is one."""


@dataclass(frozen=True)
class Head:
    """A head on its neck."""

    weight: Floats  # (V,) float64
    pivot: Floats  # (3,) float64: where it sits
    up: Floats  # (3,) float64: unit vector of the neck, from the body
    neck: Floats  # (V,) float64: 0 in the body to 1 in the head
    neck_length: float
    found_by: str


@dataclass(frozen=True)
class Tail:
    """A tail: weights (V,), the distance (V,) of each vertex from its tip, and its length."""

    weight: Floats
    from_tip: Floats
    length: float
    found_by: str


def head_of_joints(body: Body, joints: JointParts) -> Head | None:
    """Return the head that joints move; None if there are none."""
    own = joints.of_class("head")
    if own is None or own.max() <= _INSIDE:
        return None
    none = np.zeros(len(own))
    ears, neck = joints.of_class("ear"), joints.of_class("neck")
    share = np.minimum(1, own + (none if ears is None else ears))
    throat = none if neck is None else neck
    weight = body.smooth(np.minimum(1, share + 0.35 * throat), 2)
    middle = body.points[share > 0.5].mean(0)
    between = throat > 0.3 if (throat > 0.3).any() else (share > 0.2) & (share < 0.8)
    if between.any():
        pivot = body.points[between].mean(0)
    else:
        pivot = middle - np.array([0, 0.5 * np.ptp(body.points[share > 0.5, UP]), 0])
    up = _unit(middle - pivot, body.lateral)
    along = body.points @ up
    if (throat > 0.3).any():
        low, length = float(along[throat > 0.3].min()), float(np.ptp(along[throat > 0.3]))
        profile = np.minimum(1, share + throat * np.clip((along - low) / max(length, 1e-9), 0, 1))
    else:
        length = 0.3 * float(np.ptp(along[share > 0.5]))
        profile = np.minimum(1, share + 0.5 * throat)
    return Head(weight, pivot, up, body.smooth(profile, 3), length, "joints")


def head_of_reading(body: Body, read: ReadParts) -> Head:
    """Return the head that the reading found, on the neck if it has one.

    Raises PartMissingError: it found none.
    """
    if not read.has("head"):
        raise PartMissingError(read.missing("head"))
    share = read.share(read.faces("head"))
    head = share > _INSIDE
    if not head.any():
        raise PartMissingError(read.missing("head"))
    return _on_neck(body, read, head) or _on_body(body, read, head)


def _on_neck(body: Body, read: ReadParts, head: Flags) -> Head | None:
    """Return a head that a neck holds; None if it sits on the rest."""
    if not read.has("neck"):
        return None
    of_neck = read.share(read.faces("neck"))
    neck = (of_neck > _INSIDE) & ~head
    rest = ~head & ~neck
    top, low, bare = touching(body, head, neck), touching(body, neck, rest), _edges_between(body, head, rest)
    if not len(top) or not len(low) or bare > _BARE * max(_edges_between(body, head, neck), 1):
        return None
    to_head, to_body = cKDTree(top).query(body.points)[0], cKDTree(low).query(body.points)[0]
    profile = to_body / np.maximum(to_head + to_body, 1e-12)
    profile = np.where(head, 1.0, np.where(neck | (of_neck > 0), profile, 0.0))
    length = float(np.linalg.norm(top.mean(0) - low.mean(0)))
    up = _unit(top.mean(0) - low.mean(0), body.lateral)
    return Head(step(profile), (top.mean(0) + low.mean(0)) / 2, up, profile, length, read.found_by("head"))


def _on_body(body: Body, read: ReadParts, head: Flags) -> Head:
    """Return a head that sits on the rest, into which it turns within a band."""
    border = touching(body, head, ~head)
    own = body.points[head]
    size = float(np.sqrt(np.square(own - own.mean(0)).sum(1).mean()))
    width = _BLEND * max(size, 1e-12)
    distance = cKDTree(border).query(body.points)[0] * np.where(head, 1, -1)
    weight = step(_BLEND_AT + distance / width)
    joined = np.isin(body.components, np.unique(body.components[head]))
    near = cKDTree(own).query(body.points)[0] < width
    weight = _stiff(body, np.where(joined & near, weight, 0.0), head, width)
    pivot = border.mean(0)
    return Head(weight, pivot, _unit(own.mean(0) - pivot, body.lateral), weight, 0.3 * size, read.found_by("head"))


def _stiff(body: Body, weight: Floats, head: Flags, width: float) -> Floats:
    """Return weights (V,) of which small components, and those that are the head's in whole, have one each."""
    count = int(body.components.max()) + 1
    if count == 1:
        return weight
    sizes = np.bincount(body.components, minlength=count)
    mean = np.bincount(body.components, weight, count) / sizes
    whole = np.bincount(body.components, head, count) == sizes
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, body.components, body.points)
    np.maximum.at(high, body.components, body.points)
    small = np.linalg.norm(high - low, axis=1) < width
    value = np.where(whole, 1.0, mean)
    return np.where((small | whole)[body.components], value[body.components], weight)


def _edges_between(body: Body, one: Flags, other: Flags) -> int:
    edges = body.edges.tocoo()
    return int((one[edges.row] & other[edges.col]).sum())


def tail_of_joints(body: Body, joints: JointParts) -> Tail | None:
    """Return the tail that joints move; None if there are none."""
    own = joints.of_class("tail")
    if own is None or own.max() <= _INSIDE:
        return None
    weight = body.smooth(own, 2)
    rest = body.points[weight <= 0.3].mean(0)
    return _tail(body, weight, np.asarray(weight > 0.6), rest, "joints")


def tail_of_reading(body: Body, read: ReadParts) -> Tail:
    """Return the tail that the reading found.

    Raises PartMissingError: it found none.
    """
    limb = read.limb("tail")
    root = max(limb.pieces, key=lambda each: len(each.rows)).pivot
    share = read.share(read.faces("tail"))
    mine = np.asarray(share >= min(_INSIDE, float(share.max())))
    return _tail(body, limb.weight, mine, root, limb.found_by)


def _tail(body: Body, weight: Floats, mine: Flags, root: Floats, found_by: str) -> Tail:
    rows = np.flatnonzero(mine)
    tip = int(rows[np.argmax(np.linalg.norm(body.points[rows] - root, axis=1))])
    distance = _along_surface(body, tip, rows)
    return Tail(weight, distance, float(np.percentile(distance[rows], 98)), found_by)


def _along_surface(body: Body, start: int, rows: Index) -> Floats:
    """Return the distance (V,) of each vertex from one of them along edges; straight if some rows are not connected."""
    straight = np.linalg.norm(body.points - body.points[start], axis=1)
    if (body.components[rows] != body.components[start]).any():
        return np.asarray(straight)
    edges = body.edges.tocoo()
    lengths = np.linalg.norm(body.points[edges.row] - body.points[edges.col], axis=1)
    graph = sparse.csr_matrix((np.maximum(lengths, 1e-300), (edges.row, edges.col)), shape=edges.shape)
    distance = csgraph.dijkstra(graph, directed=False, indices=start)
    return np.asarray(np.where(np.isfinite(distance), distance, straight))


def _unit(vector: Floats, lateral: int) -> Floats:
    """Return the direction of a vector in the mirror plane."""
    flat = vector.copy()
    flat[lateral] = 0
    length = np.linalg.norm(flat)
    return flat / length if length > 0 else np.array([0.0, 1.0, 0.0])
