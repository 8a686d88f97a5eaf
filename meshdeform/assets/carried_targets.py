"""Carry the morph targets that a mesh has along with its surface: a smile stays a smile on a fat face.

With J the linear map of the deformation around a vertex, in the space of the mesh, a target's displacement d becomes
``J d``. Normals and tangents of a target are those of the target's shape, so they are transformed as such, with the
cofactors of J and with J itself, before the new base is subtracted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.container import Json
from meshdeform.assets.document import Document, read_floats
from meshdeform.assets.surface import Block, Floats, transformed_normals, unit_rows


def carry_targets(
    document: Document,
    block: Block,
    mesh: Json,
    jacobians: Floats,
    normals: NDArray[np.float32] | None,
    tangents: NDArray[np.float32] | None,
) -> list[tuple[int, int]]:
    """Give the targets of a block's primitives new accessors; return each old one with its new one.

    Parameters
    ----------
    document : Document
        Changed in place.
    mesh : dict
        The block's mesh, which no other node uses.
    jacobians : (V, 3, 3) float64
        In world space.
    normals : (V, 3) float32, optional
    tangents : (V, 4) float32, optional
        Those of the new base, in mesh space.
    """
    moved = np.asarray((jacobians != np.eye(3)).any((1, 2)))
    if not moved.any():
        return []
    linear = block.placement[:3, :3]
    maps = np.linalg.inv(linear) @ jacobians @ linear
    bases = {"NORMAL": (block.normals, normals), "TANGENT": (block.tangents, tangents)}
    made: dict[tuple[str, int], int] = {}
    for number in block.primitives:
        for target in mesh["primitives"][number].get("targets", []):
            for name in ("POSITION", "NORMAL", "TANGENT"):
                old = target.get(name)
                if not isinstance(old, int):
                    continue
                if (name, old) not in made:
                    before = read_floats(document, old)
                    if len(before) != len(maps) or before.shape[1] != 3:
                        continue
                    after = _position(before, maps)
                    if name != "POSITION":
                        after = _direction(name, before, maps, *bases[name])
                    changed = np.asarray(moved & np.isfinite(after).all(1))
                    values = np.where(changed[:, None], after, before)
                    like = document.root["accessors"][old]
                    made[name, old] = document.append_accessor(
                        values.astype(np.float32), like=like, bounds=name == "POSITION"
                    )
                target[name] = made[name, old]
    return [(old, new) for (_, old), new in made.items()]


def _position(before: NDArray[np.float32], maps: Floats) -> Floats:
    return np.asarray(np.einsum("vij,vj->vi", maps, before.astype(np.float64)))


def _direction(
    name: str,
    before: NDArray[np.float32],
    maps: Floats,
    base: NDArray[np.float32] | None,
    new_base: NDArray[np.float32] | None,
) -> Floats:
    """Return the new displacements (V, 3) of a target's normals or tangents; the old ones where there is no base."""
    if base is None or new_base is None:
        return before.astype(np.float64)
    shown = base[:, :3].astype(np.float64) + before
    turned = transformed_normals(maps, shown) if name == "NORMAL" else unit_rows(np.einsum("vij,vj->vi", maps, shown))
    return np.asarray(turned * np.linalg.norm(shown, axis=1, keepdims=True) - new_base[:, :3])
