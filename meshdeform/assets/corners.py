"""Read attributes of the corners of a file's triangles: joint weights and vertex colours."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.container import Json
from meshdeform.assets.document import Document, read_accessor, read_floats, read_triangles
from meshdeform.assets.surface import Block
from meshdeform.errors import AssetError

_Floats = NDArray[np.float64]


def corner_weights(document: Document, blocks: Sequence[Block], joints: Collection[int]) -> _Floats:
    """Return how much each corner (T, 3) of the surface's triangles follows these joints, 0 to 1.

    `blocks`: as `read_surface` gathered them; `joints`: indices of nodes.
    """
    return _gathered(document, blocks, lambda block, primitive: _weights(document, block, primitive, joints), 1)[..., 0]


def corner_colors(document: Document, blocks: Sequence[Block]) -> _Floats:
    """Return the linear vertex colour (T, 3, 3) of each corner of the surface's triangles; NaN where there is none."""
    return _gathered(document, blocks, lambda block, primitive: _colors(document, block, primitive), 3)


def _gathered(
    document: Document, blocks: Sequence[Block], values: Callable[[Block, Json], _Floats], width: int
) -> _Floats:
    found = [np.empty((0, 3, width))]
    for block in blocks:
        for number in block.primitives:
            primitive = document.root["meshes"][block.mesh]["primitives"][number]
            corners = read_triangles(document, primitive, len(block.positions), "a primitive")
            found.append(values(block, primitive)[corners])
    return np.concatenate(found)


def skin_weights(
    document: Document, primitive: Json, count: int, joints: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], _Floats]:
    """Return the vertices, the places of joints in their skin, and the weights above 0, (K,) each.

    Returns three empty arrays if the attributes are not valid: the deformation does not need them.
    """
    nothing = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    attributes = primitive["attributes"]
    found = [nothing]
    number = 0
    while f"JOINTS_{number}" in attributes and f"WEIGHTS_{number}" in attributes:
        try:
            indices = read_accessor(document, attributes[f"JOINTS_{number}"]).astype(np.int64)
            weights = read_floats(document, attributes[f"WEIGHTS_{number}"]).astype(np.float64)
        except AssetError:
            return nothing
        if weights.shape != indices.shape or len(indices) != count:
            return nothing
        rows, columns = np.nonzero(weights > 0)
        chosen = np.minimum(indices[rows, columns], joints - 1)
        found.append((rows, chosen, weights[rows, columns]))
        number += 1
    at, which, share = (np.concatenate(part) for part in zip(*found, strict=True))
    return at, which, share


def joint_shares(
    document: Document, blocks: Sequence[Block], *, rigid: bool = False
) -> tuple[NDArray[np.int64], NDArray[np.int64], _Floats]:
    """Return the rows of the surface, the nodes of joints, and the weights above 0 of the ones for the others, (K,).

    With `rigid`, a mesh without a skin on or below a joint follows it as well.
    """
    nodes, skins = document.root["nodes"], document.root.get("skins", [])
    parents = {child: at for at, node in enumerate(nodes) for child in node.get("children", [])}
    all_joints = {joint for skin in skins for joint in skin["joints"]}
    found = [(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))]
    for block in blocks:
        skin, count, above = nodes[block.node].get("skin"), len(block.positions), block.node
        if skin is not None:
            joints = np.array(skins[skin]["joints"])
            primitive = document.root["meshes"][block.mesh]["primitives"][block.primitives[0]]
            at, which, share = skin_weights(document, primitive, count, len(joints))
            found.append((at + block.rows.start, joints[which], share))
        elif rigid:
            while above not in all_joints and above in parents:
                above = parents[above]
            if above in all_joints:
                found.append((np.arange(block.rows.start, block.rows.stop), np.full(count, above), np.ones(count)))
    rows, owners, shares = (np.concatenate(part) for part in zip(*found, strict=True))
    return rows, owners, shares


def _weights(document: Document, block: Block, primitive: Json, joints: Collection[int]) -> _Floats:
    total = np.zeros((len(block.positions), 1))
    skin = document.root["nodes"][block.node].get("skin")
    if skin is None:
        return total
    wanted = np.isin(np.array(document.root["skins"][skin]["joints"]), list(joints))
    at, which, share = skin_weights(document, primitive, len(total), len(wanted))
    np.add.at(total[:, 0], at, wanted[which] * share)
    return total


def _colors(document: Document, block: Block, primitive: Json) -> _Floats:
    missing = np.full((len(block.positions), 3), np.nan)
    if "COLOR_0" not in primitive["attributes"]:
        return missing
    try:
        values = read_floats(document, primitive["attributes"]["COLOR_0"])
    except AssetError:
        return missing
    return values[:, :3].astype(np.float64) if len(values) == len(missing) and values.shape[1] >= 3 else missing
