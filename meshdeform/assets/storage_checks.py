"""Check buffers, buffer views and accessors from the JSON alone: all must fit the data in the file.

Source: glTF 2.0 specification, sections 3.6 and 5.1 to 5.6; EXT_meshopt_compression.
"""

from __future__ import annotations

from dataclasses import dataclass

from meshdeform.assets.codes import (
    COMPONENT_BYTES,
    MESHOPT_EXTENSIONS,
    TYPE_COMPONENTS,
    UNSIGNED_BYTE,
    UNSIGNED_INT,
    UNSIGNED_SHORT,
)
from meshdeform.assets.container import Json, extension, index, integer, member, objects, text
from meshdeform.assets.limits import Limits
from meshdeform.errors import (
    AssetError,
    AssetExternalError,
    AssetTooLargeError,
    AssetTruncatedError,
    AssetUnsupportedError,
)

_FILTER_STRIDES = {
    "NONE": range(1, 257),
    "OCTAHEDRAL": (4, 8),
    "QUATERNION": (8,),
    "EXPONENTIAL": range(4, 257, 4),
    "COLOR": (4, 8),
}


@dataclass(frozen=True)
class CompressedView:
    """The members of a buffer view's meshopt extension."""

    buffer: int
    offset: int
    length: int
    stride: int
    count: int
    mode: str
    filter: str


def check_storage(
    root: Json, binary_length: int | None, limits: Limits, decoded_later: set[int], unread: set[int]
) -> None:
    """Check buffers, buffer views and accessors.

    `root`: the parsed JSON; `binary_length`: length of the GLB's binary chunk; `limits`: upper bounds on the asset;
    `decoded_later`: accessors that a Draco stream fills; `unread`: accessors that are never decoded. Raises
    AssetExternalError: a buffer is in another file. Raises AssetTruncatedError: a buffer, view or accessor reaches past
    its data. Raises AssetTooLargeError: a count is over its limit, or compressed data decodes to more bytes than a file
    may have. Raises AssetError: anything else is not valid.
    """
    # Check each array once; doing so for every element would take hours for a hostile file.
    views = objects(root, "bufferViews")
    for i, image in enumerate(objects(root, "images")):
        text(image, "uri", f"images[{i}]")  # a link to another file stays as it is; the deformation reads no image
        index(image, "bufferView", len(views), f"images[{i}]")
    for i, buffer in enumerate(objects(root, "buffers")):
        _check_buffer(buffer, i, binary_length)
    decoded = sum(_check_view(root, i, binary_length) for i in range(len(views)))
    for i in range(len(objects(root, "accessors"))):
        bare = _check_accessor(root, i, limits)
        if i in decoded_later:
            decoded += bare
        elif bare and i not in unread and root["accessors"][i]["count"] > limits.max_bare_elements:
            raise AssetTooLargeError(
                f"accessors[{i}] declares {root['accessors'][i]['count']} elements without data; "
                f"the limit is {limits.max_bare_elements}."
            )
    limits.check_bytes(decoded, "The compressed data decodes to")


def _refuse_external(uri: str | None, where: str) -> None:
    if uri is not None and uri[:5].lower() != "data:":
        name = uri if len(uri) <= 80 else uri[:77] + "..."
        raise AssetExternalError(f"{where} refers to another file: {name!r}.")


def outside_images(root: Json) -> list[str]:
    """Return the links of images that are in other files."""
    links = [image.get("uri", "") for image in root.get("images", [])]
    return [link for link in links if link and link[:5].lower() != "data:"]


def data_uri_bytes(uri: str) -> int:
    """Return an upper bound on the bytes of a data URI, without decoding it."""
    header, _, payload = uri.partition(",")
    return len(payload) * 3 // 4 if header.endswith(";base64") else len(payload)


def is_placeholder(root: Json, buffer: int, binary_length: int | None) -> bool:
    """Return whether a buffer has no data and serves only as the target of decoded meshopt views."""
    return "uri" not in root["buffers"][buffer] and not (buffer == 0 and binary_length is not None)


def _check_buffer(buffer: Json, i: int, binary_length: int | None) -> None:
    where = f"buffers[{i}]"
    length = integer(buffer, "byteLength", where, minimum=1)
    uri = text(buffer, "uri", where)
    _refuse_external(uri, where)
    if uri is not None:
        held = data_uri_bytes(uri)
    elif i == 0 and binary_length is not None:
        held = binary_length
    else:
        return  # a placeholder; uncompressed views into it are refused elsewhere
    if length > held:
        raise AssetTruncatedError(f"{where}.byteLength is {length}, but its data has {held} bytes.")


def compressed_view(root: Json, view: int) -> tuple[str, CompressedView] | None:
    """Return the name and checked members of a buffer view's meshopt extension, or None if it has none."""
    data = root["bufferViews"][view]
    where = f"bufferViews[{view}]"
    name = next((name for name in MESHOPT_EXTENSIONS if extension(data, name, where) is not None), None)
    if name is None:
        return None
    body = member(member(data, "extensions", where), name, where)
    where = f"{where}.extensions.{name}"
    buffers = root.get("buffers", [])
    buffer = index(body, "buffer", len(buffers), where)
    if buffer is None:
        raise AssetError(f"{where}.buffer is missing.")
    compressed = CompressedView(
        buffer=buffer,
        offset=integer(body, "byteOffset", where, default=0),
        length=integer(body, "byteLength", where, minimum=1),
        stride=integer(body, "byteStride", where, minimum=1, maximum=256),
        count=integer(body, "count", where, minimum=1),
        mode=text(body, "mode", where) or "",
        filter=text(body, "filter", where) or "NONE",
    )
    if compressed.mode not in {"ATTRIBUTES", "TRIANGLES", "INDICES"}:
        raise AssetUnsupportedError(
            f"{where}.mode is {compressed.mode!r}.", advice="Decompress it: gltf-transform copy in.glb out.glb"
        )
    strides = range(4, 257, 4) if compressed.mode == "ATTRIBUTES" else (2, 4)
    filters = (
        _FILTER_STRIDES.get(compressed.filter, ())
        if compressed.mode == "ATTRIBUTES" or compressed.filter == "NONE"
        else ()
    )
    if (
        compressed.stride not in strides
        or compressed.stride not in filters
        or (compressed.mode == "TRIANGLES" and compressed.count % 3)
    ):
        raise AssetError(f"{where} has an invalid combination of mode, filter, byteStride and count.")
    if compressed.stride * compressed.count != integer(data, "byteLength", f"bufferViews[{view}]", minimum=1):
        raise AssetError(f"{where}: byteStride times count does not equal the buffer view's byteLength.")
    if compressed.offset + compressed.length > integer(buffers[buffer], "byteLength", f"buffers[{buffer}]", minimum=1):
        raise AssetTruncatedError(f"{where} extends past the end of buffer {buffer}.")
    return name, compressed


def _check_view(root: Json, i: int, binary_length: int | None) -> int:
    """Check one buffer view and return how many bytes decoding it will add."""
    view, where = root["bufferViews"][i], f"bufferViews[{i}]"
    buffers = root.get("buffers", [])
    buffer = index(view, "buffer", len(buffers), where)
    if buffer is None:
        raise AssetError(f"{where}.buffer is missing.")
    length = integer(view, "byteLength", where, minimum=1)
    end = integer(view, "byteOffset", where, default=0) + length
    integer(view, "byteStride", where, default=4, minimum=1, maximum=256)
    if end > buffers[buffer]["byteLength"]:
        raise AssetTruncatedError(
            f"{where} ends at byte {end}, but buffer {buffer} has {buffers[buffer]['byteLength']} bytes."
        )
    if not is_placeholder(root, buffer, binary_length):
        return 0
    compressed = compressed_view(root, i)
    if compressed is None or is_placeholder(root, compressed[1].buffer, binary_length):
        raise AssetTruncatedError(f"{where} is in buffer {buffer}, which has no data.")
    return length


def _check_accessor(root: Json, i: int, limits: Limits) -> int:
    """Check one accessor and return how many of its declared bytes are not in the file."""
    accessor, where = root["accessors"][i], f"accessors[{i}]"
    count = integer(accessor, "count", where, minimum=1)
    if count > limits.max_accessor_elements:
        raise AssetTooLargeError(
            f"{where} declares {count} elements; the limit is {limits.max_accessor_elements} "
            "(MESHDEFORM_MAX_ACCESSOR_ELEMENTS)."
        )
    component = integer(accessor, "componentType", where)
    kind = text(accessor, "type", where) or ""
    if component not in COMPONENT_BYTES or kind not in TYPE_COMPONENTS:
        raise AssetError(f"{where} has an unknown componentType or type.")
    if not isinstance(accessor.get("normalized", False), bool):
        raise AssetError(f"{where}.normalized must be true or false.")
    size = COMPONENT_BYTES[component] * TYPE_COMPONENTS[kind]
    if "bufferView" in accessor:
        _check_fits(root, accessor, where, count, size)
    if "sparse" in accessor:
        _check_sparse(root, accessor, where, count, size)
    return 0 if "bufferView" in accessor else count * size


def _check_fits(root: Json, holder: Json, where: str, count: int, size: int, *, strided: bool = True) -> None:
    views = root.get("bufferViews", [])
    at = index(holder, "bufferView", len(views), where)
    if at is None:
        raise AssetError(f"{where}.bufferView is missing.")
    stride = views[at].get("byteStride", size) if strided else size
    end = integer(holder, "byteOffset", where, default=0) + stride * (count - 1) + size
    if end > views[at]["byteLength"]:
        raise AssetTruncatedError(
            f"{where} needs {end} bytes, but buffer view {at} has {views[at]['byteLength']}.",
            advice="The accessor's count, byteOffset or the view's byteStride is wrong; export the file again.",
        )


def _check_sparse(root: Json, accessor: Json, where: str, count: int, size: int) -> None:
    where = f"{where}.sparse"
    sparse = member(accessor, "sparse", where)
    entries = integer(sparse, "count", where, minimum=1, maximum=count)
    indices = member(sparse, "indices", where)
    component = integer(indices, "componentType", f"{where}.indices")
    if component not in (UNSIGNED_BYTE, UNSIGNED_SHORT, UNSIGNED_INT):
        raise AssetError(f"{where}.indices.componentType must be an unsigned integer type.")
    _check_fits(root, indices, f"{where}.indices", entries, COMPONENT_BYTES[component], strided=False)
    _check_fits(root, member(sparse, "values", where), f"{where}.values", entries, size, strided=False)
