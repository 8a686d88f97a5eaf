"""List what refers to accessors, buffer views and bytes of a document.

Source: glTF 2.0 specification, sections 3.6 to 3.11; KHR_draco_mesh_compression, EXT_mesh_gpu_instancing and
EXT_meshopt_compression.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from meshdeform.assets.codes import DRACO, GPU_INSTANCING, MESHOPT_EXTENSIONS
from meshdeform.assets.container import Json
from meshdeform.assets.references import MANIFOLD
from meshdeform.assets.storage_checks import is_placeholder
from meshdeform.assets.unchecked import member_of, objects_in

_Slot = tuple[Json, str]
"""An object and the name of its member that holds an index."""
_WITHOUT_REFERENCES = (
    *(DRACO, GPU_INSTANCING, MANIFOLD, *MESHOPT_EXTENSIONS, "KHR_mesh_quantization", "KHR_animation_pointer"),
    *("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_xmp", "KHR_node_", "EXT_texture_", "MSFT_texture_"),
)
"""Extensions whose integers are no indices of accessors or views, or whose indices are listed here."""


@dataclass(frozen=True)
class Usage:
    """The entries and bytes that a document uses."""

    # Indices that something of the core format or of a known extension refers to
    accessors: frozenset[int]
    views: frozenset[int]
    accessor_count: int
    view_count: int
    ranges: tuple[tuple[int, int], ...]  # start and end of every stretch of buffer 0 that a buffer view describes
    end: int  # length of buffer 0

    @classmethod
    def of(cls, root: Json, binary_length: int | None) -> Usage:
        """Return the entries and bytes that a document uses; `binary_length` is that of its binary chunk, if any."""
        stored = bool(root.get("buffers")) and not is_placeholder(root, 0, binary_length)
        return cls(
            frozenset(holder[key] for holder, key in accessor_slots(root)),
            frozenset(holder[key] for holder, key in view_slots(root)),
            len(root.get("accessors", [])),
            len(root.get("bufferViews", [])),
            tuple((start, end) for _, start, end in buffer_ranges(root)) if stored else (),
            root["buffers"][0]["byteLength"] if stored else 0,
        )


def accessor_slots(root: Json) -> Iterator[_Slot]:
    """Yield every member that holds an accessor's index."""
    for mesh in objects_in(root.get("meshes")):
        for primitive in objects_in(mesh.get("primitives")):
            yield from _indices(primitive, "indices")
            for attributes in [primitive.get("attributes"), *objects_in(primitive.get("targets"))]:
                yield from _indices(attributes)
        manifold = member_of(mesh, "extensions", MANIFOLD)
        yield from _indices(manifold, "mergeIndices", "mergeValues")
        solid = manifold.get("manifoldPrimitive")
        if isinstance(solid, dict):
            yield from _indices(solid, "indices")
            yield from _indices(solid.get("attributes"))
    for skin in objects_in(root.get("skins")):
        yield from _indices(skin, "inverseBindMatrices")
    for animation in objects_in(root.get("animations")):
        for sampler in objects_in(animation.get("samplers")):
            yield from _indices(sampler, "input", "output")
    for node in objects_in(root.get("nodes")):
        yield from _indices(member_of(node, "extensions", GPU_INSTANCING).get("attributes"))


def view_slots(root: Json) -> Iterator[_Slot]:
    """Yield every member that holds a buffer view's index."""
    for accessor in objects_in(root.get("accessors")):
        yield from _indices(accessor, "bufferView")
        sparse = accessor.get("sparse", {})
        for member in ("indices", "values"):
            yield from _indices(sparse.get(member), "bufferView")
    for image in objects_in(root.get("images")):
        yield from _indices(image, "bufferView")
    for mesh in objects_in(root.get("meshes")):
        for primitive in objects_in(mesh.get("primitives")):
            yield from _indices(member_of(primitive, "extensions", DRACO), "bufferView")


def buffer_ranges(root: Json) -> Iterator[tuple[Json, int, int]]:
    """Yield each buffer view and compressed view in buffer 0 with its start and end."""
    for view in objects_in(root.get("bufferViews")):
        for holder in (view, *(member_of(view, "extensions", name) for name in MESHOPT_EXTENSIONS)):
            if holder.get("buffer") == 0:
                start = holder.get("byteOffset", 0)
                yield holder, start, start + holder["byteLength"]


def possible_references(root: Json) -> set[int]:
    """Return every integer in extras and in extensions that Meshdeform does not know: any may be an index."""
    numbers: set[int] = set()
    _search(root, numbers, opaque=False)
    return numbers


def _search(value: Any, numbers: set[int], *, opaque: bool) -> None:
    if isinstance(value, list):
        for item in value:
            _search(item, numbers, opaque=opaque)
    elif isinstance(value, dict):
        for key, item in value.items():
            if key == "extensions" and isinstance(item, dict):
                for name, body in item.items():
                    _search(body, numbers, opaque=opaque or not name.startswith(_WITHOUT_REFERENCES))
            else:
                _search(item, numbers, opaque=opaque or key == "extras")
    elif opaque and isinstance(value, int) and not isinstance(value, bool):
        numbers.add(value)


def _indices(holder: Any, *keys: str) -> Iterator[_Slot]:
    if isinstance(holder, dict):
        for key in keys or tuple(holder):
            if isinstance(holder.get(key), int) and not isinstance(holder[key], bool):
                yield holder, key
