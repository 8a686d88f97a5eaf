"""Give an asset back with its parts, for tools that rig, texture and sort: as an attribute, as materials or as nodes.

All else stays: what is drawn, skins, morph targets and their weights, animations, textures, extras, cameras, lights and
unknown extensions; accessors and buffer views keep their indices. Triangles keep their order within a part. Points and
lines are left as they are. What a mesh is on several nodes with different parts becomes a mesh for each.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets.asset import Asset
from meshdeform.assets.compact import compact
from meshdeform.assets.part_attribute import read_part_attribute, write_part_attribute
from meshdeform.assets.part_labels import PartLabels, own_showings
from meshdeform.assets.part_pieces import split_materials, split_nodes
from meshdeform.assets.writer import embed_data_uris
from meshdeform.errors import AssetError
from meshdeform.requests.choices import PartsAs

__all__ = ["PartLabels", "PartsAs", "parts_of", "with_parts"]

_WRITERS = {PartsAs.ATTRIBUTE: write_part_attribute, PartsAs.MATERIALS: split_materials, PartsAs.NODES: split_nodes}


def with_parts(
    asset: Asset, parts: Mapping[str, NDArray[np.bool_]] | PartLabels, form: PartsAs = PartsAs.ATTRIBUTE
) -> bytes:
    """Write the asset with its parts and everything else unchanged.

    Parameters
    ----------
    parts : mapping of str to (T,) bool, or PartLabels
        Which triangles of `asset.surface` each part has. One that several have belongs to the first of them.
    form : PartsAs
        `attribute`: the vertex attribute `_PART` (`assets/part_attribute.py`). `materials`: a copy of each material for
        each part, named `head (Skin)`. `nodes`: a child for each part of the node that showed it, named `head`.

    Returns
    -------
    A GLB. The asset itself is not changed.

    Raises
    ------
    ShapeError
        A part has another number of triangles than the surface.
    AssetError
        There are more than 255 parts, a vertex attribute or a material is not valid, or names have no place.
    """
    count = len(asset.surface.triangles)
    labels = parts if isinstance(parts, PartLabels) else PartLabels.of_flags(parts, count)
    labels.checked(count)
    document = asset._document.fork()
    try:
        _WRITERS[form](document, own_showings(document, asset._blocks, labels), labels.names)
    except (IndexError, KeyError, TypeError, AttributeError, ValueError) as error:
        raise AssetError(
            f"The asset cannot be given its parts: {str(error)[:100]}.", advice="Export the asset again."
        ) from error
    embed_data_uris(document)
    compact(document, asset._usage, [])
    return document.to_bytes()


def parts_of(asset: Asset) -> dict[str, NDArray[np.bool_]]:
    """Return the flags (T,) of the triangles of each part that the file's attribute `_PART` has and names.

    Empty if there is no such attribute, or no names for it (`extras.parts` of the mesh or of `asset`). A triangle whose
    corners differ has the part of two of them, or of the first.
    """
    return read_part_attribute(asset)
