"""Read the labels of an asset of a collection for its triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshdeform.assets import Asset
from meshdeform.assets.collection import AssetLabels
from meshdeform.errors import AssetError

__all__ = ["labels_of"]


def labels_of(asset: Asset, name: str, labels: AssetLabels, parts: list[str]) -> NDArray[np.int64]:
    """Return the part of each triangle (F,); -1 where none is given.

    Nodes come first, then materials, then single triangles, each over those before.

    Raises
    ------
    AssetError
        A node or a material does not exist, or there is not one label for each triangle.
    """
    numbers = {part: number for number, part in enumerate(parts)}
    count = len(asset.surface.triangles)
    found = np.full(count, -1, np.int64)
    known = asset.parts()
    for what, wanted, listed, flags in (
        ("node", labels.nodes, known.nodes, known.in_node),
        ("material", labels.materials, known.materials, known.of_material),
    ):
        places: dict[str, list[int]] = {}
        for each in listed:
            places.setdefault(each["name"], []).append(each["index"])
        for title, part in wanted.items():
            if title not in places:
                names = ", ".join(sorted(place for place in places if place)[:10]) or "none with a name"
                raise AssetError(f"labels.json: {name} has no {what} {title[:64]!r}.", advice=f"It has: {names}.")
            for index in places[title]:
                found[flags(index)] = numbers[part]
    if labels.triangles is not None:
        if len(labels.triangles) != count:
            raise AssetError(
                f"labels.json: {name} has {count} triangles, but {len(labels.triangles)} labels.",
                advice="Give one label for each triangle, in the file's order.",
            )
        found = np.array([numbers[part] for part in labels.triangles], np.int64)
    return found
