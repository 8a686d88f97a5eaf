"""Place the surface as viewers show it: skins in the pose of the file's nodes, not in their bind pose.

A vertex p of a skinned mesh, with weights w_j of joints whose world matrices are W_j and inverse bind matrices B_j, is
shown at ``sum_j w_j W_j B_j p``; the node's own transform does not count.

Source: glTF 2.0 specification, section 3.7.3.3 (Skinned mesh attributes).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.corners import skin_weights
from meshdeform.assets.document import Document, read_floats
from meshdeform.assets.surface import Block, Surface, unit_rows, world_matrices

_Floats = NDArray[np.float64]


def posed_surface(document: Document, surface: Surface, blocks: Sequence[Block]) -> Surface:
    """Return the surface with the positions and normals of skinned vertices in the pose of the nodes."""
    positions, normals = surface.positions.copy(), surface.normals.copy()
    for block, maps in _skinned(document, blocks):
        at = positions[block.rows]
        positions[block.rows] = np.einsum("nij,nj->ni", maps[:, :3, :3], at) + maps[:, :3, 3]
        normals[block.rows] = unit_rows(np.einsum("nij,nj->ni", _cofactors(maps), normals[block.rows]))
    return dataclasses.replace(surface, positions=positions, normals=normals)


def pose_maps(document: Document, surface: Surface, blocks: Sequence[Block]) -> _Floats:
    """Return the affine map (N, 3, 4) of each vertex from the bind pose in world space to the pose of the nodes."""
    maps = np.tile(np.eye(3, 4), (len(surface.positions), 1, 1))
    for block, of_block in _skinned(document, blocks):
        maps[block.rows] = of_block[:, :3]
    return maps


def _skinned(document: Document, blocks: Sequence[Block]) -> Iterator[tuple[Block, _Floats]]:
    """Yield the blocks with a skin, and the matrices (N, 4, 4) of their vertices."""
    worlds = np.stack(world_matrices(document.root.get("nodes", [])))
    for block in blocks:
        skin = document.root["nodes"][block.node].get("skin")
        if skin is not None:
            # From the bind pose in world space, where the surface is, by way of the mesh's own space.
            moves = _joint_matrices(document, skin, worlds) @ np.linalg.inv(block.placement)
            yield block, _blended(document, block, moves)


def _joint_matrices(document: Document, skin: int, worlds: _Floats) -> _Floats:
    """Return W_j B_j (J, 4, 4)."""
    described = document.root["skins"][skin]
    joints = worlds[described["joints"]]
    if "inverseBindMatrices" not in described:
        return np.asarray(joints)
    inverse_binds = read_floats(document, described["inverseBindMatrices"])[: len(joints)].astype(np.float64)
    return np.asarray(joints @ inverse_binds.reshape(-1, 4, 4).transpose(0, 2, 1))


def _blended(document: Document, block: Block, moves: _Floats) -> _Floats:
    """Return the matrix (N, 4, 4) of each vertex of a block; vertices that follow no joint stay in the bind pose."""
    count = len(block.positions)
    primitive = document.root["meshes"][block.mesh]["primitives"][block.primitives[0]]
    vertex, joint, weight = skin_weights(document, primitive, count, len(moves))
    total = np.bincount(vertex, weight, count)
    maps = np.zeros((count, 4, 4))
    np.add.at(maps, vertex, weight[:, None, None] * moves[joint])
    maps[total > 0] /= total[total > 0, None, None]
    maps[total <= 0] = np.eye(4)
    return maps


def _cofactors(maps: _Floats) -> _Floats:
    """Return the maps (N, 3, 3) of normals: the cofactors of the linear parts."""
    x, y, z = (maps[:, :3, column] for column in range(3))
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=2)
