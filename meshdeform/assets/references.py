"""List what refers to accessors, buffer views and bytes of a document. Pure Python.

Source: glTF 2.0 specification, sections 3.6 to 3.11; KHR_draco_mesh_compression, EXT_mesh_gpu_instancing and
EXT_meshopt_compression.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from meshdeform.assets.json_text import Json
from meshdeform.assets.scenegraph import DRACO, GPU_INSTANCING
from meshdeform.assets.storage import MESHOPT_EXTENSIONS, is_placeholder

__all__ = ["Usage", "accessor_slots", "buffer_ranges", "possible_references", "view_slots"]

Slot = tuple[Json, str]
"""An object and the name of its member that holds an index."""

_WITHOUT_REFERENCES = (
    *(DRACO, GPU_INSTANCING, *MESHOPT_EXTENSIONS, "KHR_mesh_quantization", "KHR_animation_pointer"),
    *("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_xmp", "KHR_node_", "EXT_texture_", "MSFT_texture_"),
)
"""Extensions whose integers are no indices of accessors or views, or whose indices are listed here."""


@dataclass(frozen=True)
class Usage:
    """What a document uses.

    Attributes
    ----------
    accessors, views : frozenset of int
        Indices that something of the core format or of a known extension refers to.
    accessor_count, view_count : int
    ranges : tuple of (int, int)
        Start and end of every stretch of buffer 0 that a buffer view describes.
    end : int
        Length of buffer 0.
    """

    accessors: frozenset[int]
    views: frozenset[int]
    accessor_count: int
    view_count: int
    ranges: tuple[tuple[int, int], ...]
    end: int

    @classmethod
    def of(cls, root: Json, binary_length: int | None) -> Usage:
        """Return what a document uses whose binary chunk has this length, if it has one."""
        stored = bool(root.get("buffers")) and not is_placeholder(root, 0, binary_length)
        return cls(
            frozenset(holder[key] for holder, key in accessor_slots(root)),
            frozenset(holder[key] for holder, key in view_slots(root)),
            len(root.get("accessors", [])),
            len(root.get("bufferViews", [])),
            tuple((start, end) for _, start, end in buffer_ranges(root)) if stored else (),
            root["buffers"][0]["byteLength"] if stored else 0,
        )


def accessor_slots(root: Json) -> Iterator[Slot]:
    """Yield every place that holds an accessor's index."""
    for mesh in _objects(root, "meshes"):
        for primitive in _objects(mesh, "primitives"):
            yield from _indices(primitive, "indices")
            for attributes in [primitive.get("attributes"), *_objects(primitive, "targets")]:
                yield from _indices(attributes)
    for skin in _objects(root, "skins"):
        yield from _indices(skin, "inverseBindMatrices")
    for animation in _objects(root, "animations"):
        for sampler in _objects(animation, "samplers"):
            yield from _indices(sampler, "input", "output")
    for node in _objects(root, "nodes"):
        yield from _indices(_extension(node, GPU_INSTANCING).get("attributes"))


def view_slots(root: Json) -> Iterator[Slot]:
    """Yield every place that holds a buffer view's index."""
    for accessor in _objects(root, "accessors"):
        yield from _indices(accessor, "bufferView")
        sparse = accessor.get("sparse", {})
        for part in ("indices", "values"):
            yield from _indices(sparse.get(part), "bufferView")
    for image in _objects(root, "images"):
        yield from _indices(image, "bufferView")
    for mesh in _objects(root, "meshes"):
        for primitive in _objects(mesh, "primitives"):
            yield from _indices(_extension(primitive, DRACO), "bufferView")


def buffer_ranges(root: Json) -> Iterator[tuple[Json, int, int]]:
    """Yield each buffer view and compressed view in buffer 0 with its start and end."""
    for view in _objects(root, "bufferViews"):
        for holder in (view, *(_extension(view, name) for name in MESHOPT_EXTENSIONS)):
            if holder.get("buffer") == 0:
                start = holder.get("byteOffset", 0)
                yield holder, start, start + holder["byteLength"]


def possible_references(root: Json) -> set[int]:
    """Return every integer in extras and in extensions that Meshdeform does not know: any may be an index."""
    found: set[int] = set()
    _search(root, found, opaque=False)
    return found


def _search(value: Any, found: set[int], *, opaque: bool) -> None:
    if isinstance(value, list):
        for item in value:
            _search(item, found, opaque=opaque)
    elif isinstance(value, dict):
        for key, item in value.items():
            if key == "extensions" and isinstance(item, dict):
                for name, body in item.items():
                    _search(body, found, opaque=opaque or not name.startswith(_WITHOUT_REFERENCES))
            else:
                _search(item, found, opaque=opaque or key == "extras")
    elif opaque and isinstance(value, int) and not isinstance(value, bool):
        found.add(value)


def _objects(holder: Json, key: str) -> list[Json]:
    items = holder.get(key)
    return [item for item in items if isinstance(item, dict)] if isinstance(items, list) else []


def _extension(holder: Json, name: str) -> Json:
    extensions = holder.get("extensions")
    body = extensions.get(name) if isinstance(extensions, dict) else None
    return body if isinstance(body, dict) else {}


def _indices(holder: Any, *keys: str) -> Iterator[Slot]:
    if isinstance(holder, dict):
        for key in keys or tuple(holder):
            if isinstance(holder.get(key), int) and not isinstance(holder[key], bool):
                yield holder, key
