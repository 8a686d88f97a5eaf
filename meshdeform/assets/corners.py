"""Read what the corners of a surface's triangles have beside their positions: weights of joints, and vertex colours."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np

from meshdeform.assets.accessors import read_floats, read_triangles
from meshdeform.assets.container import Json
from meshdeform.assets.document import Document
from meshdeform.assets.placement import Floats, skin_weights
from meshdeform.assets.surface import Block, block_primitives
from meshdeform.errors import AssetError


def corner_weights(document: Document, blocks: Sequence[Block], joints: Collection[int]) -> Floats:
    """Return how much each corner (T, 3) of the surface's triangles follows these joints, 0 to 1.

    `blocks`: as `read_surface` gathered them; `joints`: indices of nodes.
    """
    return _gathered(document, blocks, lambda block, primitive: _weights(document, block, primitive, joints), 1)[..., 0]


def corner_colors(document: Document, blocks: Sequence[Block]) -> Floats:
    """Return the linear vertex colour (T, 3, 3) of each corner of the surface's triangles; NaN where there is none."""
    return _gathered(document, blocks, lambda block, primitive: _colors(document, block, primitive), 3)


def _gathered(
    document: Document, blocks: Sequence[Block], values: Callable[[Block, Json], Floats], width: int
) -> Floats:
    gathered = [np.empty((0, 3, width))]
    for block, _, primitive, _ in block_primitives(document.root, blocks):
        corners = read_triangles(document, primitive, len(block.positions), "a primitive")
        gathered.append(values(block, primitive)[corners])
    return np.concatenate(gathered)


def _weights(document: Document, block: Block, primitive: Json, joints: Collection[int]) -> Floats:
    total = np.zeros((len(block.positions), 1))
    skin = document.root["nodes"][block.node].get("skin")
    if skin is None:
        return total
    chosen = np.isin(np.array(document.root["skins"][skin]["joints"]), list(joints))
    at, which, share = skin_weights(document, primitive, len(total), len(chosen))
    np.add.at(total[:, 0], at, chosen[which] * share)
    return total


def _colors(document: Document, block: Block, primitive: Json) -> Floats:
    missing = np.full((len(block.positions), 3), np.nan)
    if "COLOR_0" not in primitive["attributes"]:
        return missing
    try:
        values = read_floats(document, primitive["attributes"]["COLOR_0"])
    except AssetError:
        return missing
    return values[:, :3].astype(np.float64) if len(values) == len(missing) and values.shape[1] >= 3 else missing
