"""Find how the joints of skins move with the volume around them, so that a character still animates in its new shape.

A joint's displacement is that of an affine map, fitted by weighted least squares to the displacements d_v of the
vertices that follow it, at its origin p::

    w_v = (weight of the joint at v) / (|x_v - p|^2 + e^2)
    D   = (K + l H) (C + l I)^-1        C, K the weighted covariances of x with x and of d with x, H the mean of J_v - I
    p'  = p + mean(d) + D (p - mean(x))

so that every affine deformation, a scaling for instance, moves joints exactly, and near joints count near vertices. A
joint that no vertex follows, such as the end of a finger, is moved by all vertices of its skins. All of this is in the
pose of the file's nodes, which viewers show.

Sources: glTF 2.0 specification, section 3.7.3 (Skins); Schaefer et al. 2006, Image deformation using moving least
squares, section 2.1 (affine deformations).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.document import Document
from meshdeform.assets.placement import Floats, parents_of, skin_weights, upwards, world_matrices
from meshdeform.assets.surface import Block

_NEAR = 0.1
"""Distance within which vertices count alike, as a share of the spread of those that move a node."""
_STIFFNESS = 0.1
"""How much the mean of the Jacobians counts in the fit, relative to the spread of the vertices."""


@dataclass(frozen=True)
class RigMotion:
    """How the surface moves, in world space; rows as in `Surface`."""

    # (N, 3) float64: positions at rest, and displacements
    positions: Floats
    moved: Floats
    jacobians: Floats  # (N, 3, 3) float64: the linear map of the deformation around each vertex


@dataclass(frozen=True)
class NodeMove:
    """A node's origin (3,) and its displacement (3,), in world space.

    `growth` is that of the volume around it along one axis, and `linear` its linear map (3, 3).
    """

    origin: Floats
    shift: Floats
    growth: float
    linear: Floats = field(default_factory=lambda: np.eye(3))


def joint_moves(document: Document, blocks: Sequence[Block], motion: RigMotion) -> dict[int, NodeMove]:
    """Return how the joints of all skins of the deformed meshes move with the surface, by their nodes."""
    nodes, skins = document.root.get("nodes", []), document.root.get("skins", [])
    rows_of: dict[int, list[NDArray[np.int64]]] = {}
    for block in blocks:
        if "skin" in nodes[block.node]:
            for joint in skins[nodes[block.node]["skin"]]["joints"]:
                rows_of.setdefault(joint, []).append(np.arange(block.rows.start, block.rows.stop))
    if not rows_of:
        return {}
    worlds = world_matrices(nodes)
    at, owners, share = joint_shares(document, blocks)
    order = np.argsort(owners, kind="stable")
    owners, at, share = owners[order], at[order], share[order]
    moves = {}
    for joint, of_skins in rows_of.items():
        first, last = np.searchsorted(owners, [joint, joint + 1])
        own, by = at[first:last], share[first:last]
        if not by.sum() > 0:
            own = np.concatenate(of_skins)
            by = np.ones(len(own))
        if len(own):
            moves[joint] = fitted_move(worlds[joint][:3, 3], own, by, motion)
    return moves


def fitted_move(
    origin: Floats, rows: NDArray[np.int64], weights: Floats, motion: RigMotion, power: int = 1
) -> NodeMove:
    """Return how an affine map fitted to weighted vertices moves the origin (3,) of a node.

    `rows`, `weights`: (K,) of the vertices, and how much they count beside their distance, whose square counts to the
    power of `power`.
    """
    if not motion.moved[rows].any():
        return NodeMove(origin, np.zeros(3), 1.0)
    positions, moved = motion.positions[rows], motion.moved[rows]
    spread = float(((positions - np.average(positions, axis=0, weights=weights)) ** 2).sum(1).mean())
    weights = weights / (((positions - origin) ** 2).sum(1) + _NEAR**2 * spread + 1e-300) ** power
    weights = weights / weights.sum()
    middle, shift = weights @ positions, weights @ moved
    arms, pulls = positions - middle, moved - shift
    slope = np.einsum("v,vij->ij", weights, motion.jacobians[rows]) - np.eye(3)
    spread_matrix, pull_matrix = (weights[:, None] * arms).T @ arms, (weights[:, None] * pulls).T @ arms
    stiff = _STIFFNESS * float(np.trace(spread_matrix)) / 3
    if stiff > 0:
        slope = np.linalg.solve(spread_matrix + stiff * np.eye(3), (pull_matrix + stiff * slope).T).T
    growth = float(np.cbrt(max(np.linalg.det(np.eye(3) + slope), 0.0)))
    return NodeMove(origin, shift + slope @ (origin - middle), growth, np.eye(3) + slope)


def joint_shares(document: Document, blocks: Sequence[Block]) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
    """Return the rows of the surface, the nodes of joints, and the weights above 0 of the ones for the others, (K,).

    A mesh without a skin on or below a joint follows it.
    """
    nodes, skins = document.root["nodes"], document.root.get("skins", [])
    parents = parents_of(nodes)
    all_joints = {joint for skin in skins for joint in skin["joints"]}
    groups = [(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))]
    for block in blocks:
        skin, count = nodes[block.node].get("skin"), len(block.positions)
        if skin is not None:
            joints = np.array(skins[skin]["joints"])
            primitive = document.root["meshes"][block.mesh]["primitives"][block.primitives[0]]
            at, which, share = skin_weights(document, primitive, count, len(joints))
            groups.append((at + block.rows.start, joints[which], share))
            continue
        joint = next((at for at in upwards(block.node, parents) if at in all_joints), None)
        if joint is not None:
            groups.append((np.arange(block.rows.start, block.rows.stop), np.full(count, joint), np.ones(count)))
    rows, owners, shares = (np.concatenate(each) for each in zip(*groups, strict=True))
    return rows, owners, shares
