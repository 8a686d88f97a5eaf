"""Put parts of several assets together in one GLB. Each part keeps its materials, textures and vertex attributes.

A part is a set of triangles of an asset with new positions. Its look is copied: materials with their textures,
images and samplers, texture coordinates, colours and the attributes of applications. Skins, morph targets and
animations are not: they belong to the whole asset. The attribute `_PART` (`assets/part_attribute.py`) has the name of
each part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshdeform import __version__
from meshdeform.assets.accessors import read_floats
from meshdeform.assets.asset import Asset
from meshdeform.assets.codes import UNSIGNED_BYTE
from meshdeform.assets.container import Json, clone, dump_json
from meshdeform.assets.document import Document
from meshdeform.assets.materials import IMAGE_EXTENSIONS
from meshdeform.assets.part_attribute import PART, write_names
from meshdeform.assets.surface import Block, block_primitives
from meshdeform.errors import AssetError

_KEPT = ("TEXCOORD_", "COLOR_", "_")


@dataclass(frozen=True)
class AssetPart:
    """A part of an asset."""

    asset: Asset
    triangles: NDArray[np.bool_]  # (T,) bool: which triangles of the asset's surface it has
    positions: NDArray[np.float64]
    """(N, 3) float64: new positions of the surface's vertices; others than those of the part are not read."""
    # (N, 3), (N, 4) float64: new directions; rows that the asset has none for are not read
    normals: NDArray[np.float64]
    tangents: NDArray[np.float64]
    name: str  # of the node
    extras: Mapping[str, Any]  # JSON for the node


def assemble(parts: Sequence[AssetPart], provenance: Mapping[str, Any] | None = None) -> bytes:
    """Write the parts, one node each, in world space.

    `parts`: at least one has triangles; `provenance`: JSON to store as `asset.extras.meshdeform`. Returns a GLB.
    """
    about: Json = {"version": "2.0", "generator": f"Meshdeform {__version__}"}
    if provenance is not None:
        about["extras"] = {"meshdeform": dict(provenance)}
    root: Json = {"asset": about, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": []}
    document = Document(root, None, b"")
    looks: dict[int, _Looks] = {}
    names = list(dict.fromkeys(part.name for part in parts))
    write_names(about, names)
    for part in parts:
        primitives = []
        copied = looks.setdefault(id(part.asset), _Looks(part.asset._document, document))
        try:
            for block, _, original, rows in block_primitives(part.asset._document.root, part.asset._blocks):
                corners = part.asset.surface.triangles[rows][part.triangles[rows]]
                if len(corners):
                    primitives.append(_primitive(part, block, original, corners, document, copied))
        except (IndexError, KeyError, TypeError, AttributeError) as error:
            raise AssetError(
                f"A material of the asset cannot be copied: {str(error)[:100]}.", advice="Export the asset again."
            ) from error
        if not primitives:
            continue
        root["scenes"][0]["nodes"].append(len(root["nodes"]))
        root["nodes"].append({"name": part.name, "mesh": len(root["meshes"]), "extras": dict(part.extras)})
        root["meshes"].append({"name": part.name, "primitives": primitives})
        write_names(root["meshes"][-1], names)
        for primitive in primitives:
            count = root["accessors"][primitive["attributes"]["POSITION"]]["count"]
            numbers = np.full((count, 1), names.index(part.name) + 1, np.uint8)
            like = {"componentType": UNSIGNED_BYTE, "type": "SCALAR"}
            primitive["attributes"][PART] = document.append_stored(numbers, like)
    used = sorted({name for each in looks.values() for name in each.extensions})
    required = sorted({name for each in looks.values() for name in each.required})
    if used:
        root["extensionsUsed"] = used
    if required:
        root["extensionsRequired"] = required
    return document.to_bytes()


def _primitive(
    part: AssetPart, block: Block, original: Json, corners: NDArray[np.int64], document: Document, looks: _Looks
) -> Json:
    """Append what a primitive has of a part, `corners` (F, 3) of the surface, and return it."""
    source = part.asset._document
    rows, faces = np.unique(corners, return_inverse=True)
    verts = part.positions[rows].astype(np.float32)
    attributes = {"POSITION": document.append_accessor(verts, bounds=True)}
    for name, values in (("NORMAL", part.normals), ("TANGENT", part.tangents)):
        if name in original["attributes"] and np.isfinite(values[rows]).all():
            attributes[name] = document.append_accessor(values[rows].astype(np.float32))
    local = rows - block.rows.start
    for name, accessor in original["attributes"].items():
        if name.startswith(_KEPT) and name != PART:
            attributes[name] = document.append_accessor(read_floats(source, accessor)[local])
    written: Json = {"attributes": attributes, "indices": document.append_triangles(faces, len(rows))}
    if "material" in original:
        written["material"] = looks.material(original["material"])
    return written


class _Looks:
    """Copies the materials of one document into another; equal ones are copied once."""

    def __init__(self, source: Document, target: Document) -> None:
        self._source, self._target = source, target
        self._materials: dict[int, int] = {}
        self.extensions: set[str] = set()

    @property
    def required(self) -> set[str]:
        """The extensions that are copied and that the source cannot do without."""
        return self.extensions & set(self._source.root.get("extensionsRequired", []))

    def material(self, number: int) -> int:
        """Copy a material and return its new number."""
        if number not in self._materials:
            self._materials[number] = self._add("materials", self._copied(self._source.root["materials"][number]))
        return self._materials[number]

    def _copied(self, value: Any, name: str = "") -> Any:
        """Copy JSON; objects whose name ends in "Texture" hold the number of a texture."""
        if isinstance(value, list):
            return [self._copied(each) for each in value]
        if not isinstance(value, dict):
            return value
        if name == "extras":
            return clone(value)
        copies = {key: self._copied(each, key) for key, each in value.items()}
        if name == "extensions":
            self.extensions |= set(value)
        if name.endswith("Texture") and isinstance(value.get("index"), int):
            copies["index"] = self._texture(value["index"])
        return copies

    def _texture(self, number: int) -> int:
        texture = self._copied(self._source.root["textures"][number])
        if "sampler" in texture:
            texture["sampler"] = self._add("samplers", clone(self._source.root["samplers"][texture["sampler"]]))
        bodies = [texture["extensions"][name] for name in IMAGE_EXTENSIONS if name in texture.get("extensions", {})]
        for holder in (texture, *bodies):
            if "source" in holder:
                holder["source"] = self._image(holder["source"])
        return self._add("textures", texture)

    def _image(self, number: int) -> int:
        image = clone(self._source.root["images"][number])
        if "bufferView" not in image:
            return self._add("images", image)
        data = bytes(self._source.view_bytes(image.pop("bufferView")))
        for index, known in enumerate(self._target.items("images")):
            if "bufferView" in known and bytes(self._target.view_bytes(known["bufferView"])) == data:
                return index
        return self._target.add("images", {**image, "bufferView": self._target.append_view(data)})

    def _add(self, kind: str, item: Json) -> int:
        text = dump_json(item)
        for index, known in enumerate(self._target.items(kind)):
            if dump_json(known) == text:
                return index
        return self._target.add(kind, item)
